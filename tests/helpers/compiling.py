"""A connected machine whose laws are compiled: what it does not reach, a test of compiled laws must not pass over."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from helpers.generating import Fragile, wired
from umo import Compound
from umo.cycle.connect import connect
from umo.generate import compiled_laws
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.testing import VirtualTimer
from umo.wiring import resolve


@contextmanager
def observed() -> Iterator[list[CompiledLaws]]:
    """The laws that are compiled in this process meanwhile; at its end all are compiled, and there are some."""
    found: list[CompiledLaws] = []

    class Observed(CompiledLaws):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            found.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_laws, "CompiledLaws", Observed)
        yield found
    assert [each.state for each in found] == ["compiled"] * len(found) != []


class CompiledRun:
    """A connected machine, past the comparison of its laws: they are compiled, or the test fails."""

    def __init__(self, machine: Compound, box: Fragile | None = None, state: str = "compiled", **more: Any) -> None:
        """`state`: that of the laws after the comparison; `more`: tables of the wiring."""
        self.box = Fragile() if box is None else box
        wiring = resolve(machine, wired(machine, self.box, VirtualTimer()) | more)
        prepared = prepare(machine, wiring)
        self.connection = connect(machine, wiring)
        self.m: Any = self.connection.__enter__()
        try:
            self.laws = self.connection.machine.attach(CompiledLaws(prepared))
            inhibitions = len(self.connection.machine.claims.inhibitions)
            self.step((COMPARED + 1) * (len(self.laws._python) + inhibitions))
            assert self.laws.state == state, self.events
        except BaseException:
            self.connection.__exit__(None, None, None)
            raise

    def step(self, periods: int = 1) -> None:
        for _ in range(periods):
            self.m.timer.read()
            self.m.sample()
            self.m.control()
            self.m.update()

    @property
    def events(self) -> str:
        return "; ".join(each.text for each in self.connection.machine.events)

    def __enter__(self) -> CompiledRun:
        return self

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(None, None, None)

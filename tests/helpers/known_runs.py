"""A machine in which things are set, in Python and with compiled laws: both write the same."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from helpers.generating import Fragile, wired
from helpers.known_things import WAYS, loaded
from umo.cycle.connect import connect
from umo.cycle.sequences import next_period
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.testing import VirtualTimer
from umo.wiring import resolve

PERIODS = COMPARED + 12
AFTER = COMPARED + 5
"""A period in which the laws are compiled."""
BY = "client", "sequence", "observer", "after sample"
"""Who sets it: between two periods, in the sequences of one, after one, between `sample` and `control`."""
Setting = tuple[str, int, str]
"""The way, the period and who."""


class Played:
    """One machine, compiled or not, in which things are set."""

    def __init__(self, compiled: bool, set_at: list[Setting]) -> None:
        self._settings = set_at
        self.refused: list[str] = []
        self.module = loaded()
        machine = self.module.tank()
        box = Fragile()
        box.set("level", 20)
        wiring = resolve(machine, wired(machine, box, VirtualTimer()))
        self.laws: CompiledLaws | None = None
        with ExitStack() as stack:
            prepared = prepare(machine, wiring) if compiled else None
            self._connection = connect(machine, wiring)
            self.m: Any = stack.enter_context(self._connection)
            if prepared is not None:
                self.laws = self._connection.machine.attach(CompiledLaws(prepared))
            self._connection.machine.observers.append(lambda frame: self._act("observer"))
            self.m.cycle.start(self._sequence())
            self.written = [self._period(number) for number in range(PERIODS)]
            self.state = "python" if self.laws is None else self.laws.state
        self.events = "; ".join(each.text for each in self._connection.machine.events)

    async def _sequence(self) -> None:
        while True:
            self._act("sequence")
            await next_period()

    def _period(self, number: int) -> str:
        """What is written, or the class of the error."""
        self._number = number
        self._act("client")
        self.m.timer.read()
        self.m.sample()
        self._act("after sample")
        try:
            self.m.control()
        except Exception as error:
            return type(error).__name__
        finally:
            self.m.update()
        return f"{self.m.a.pending:.6f} {self.m.b.pending:.6f} {self.m.total:.6f}"

    def _act(self, who: str) -> None:
        for way, number, by in self._settings:
            if (number, by) == (self._number, who):
                try:
                    WAYS[way](self.module, self.m)
                except (AttributeError, LookupError, TypeError, ValueError) as error:  # it was deleted before
                    self.refused.append(type(error).__name__)


def check(set_at: list[Setting]) -> Played:
    python, compiled = Played(False, set_at), Played(True, set_at)
    assert compiled.written == python.written, f"{compiled.state}: {compiled.events}"
    assert compiled.refused == python.refused
    return compiled

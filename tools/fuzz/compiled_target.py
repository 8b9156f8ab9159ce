"""Compiled laws (`compile = true`), which work on the memory of Python; the host sets whatever it likes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tools.fuzz.machine import Side, refilled, restored
from tools.fuzz.program import Program
from tools.fuzz.stimuli import Stimulus, ticks
from tools.fuzz.target import Beside, Refused, Target
from tools.fuzz.verdict import same
from umo.generate import law_library
from umo.generate.compiled_laws import CompiledLaws, NotCompiled, PreparedLaws
from umo.generate.lower.lowered_rings import DequeFields

COLUMNS = "values", "quality", "pending", "raws", "restrictions"


class CompiledTarget(Target):
    name = "compiled"

    def beside(self, python: Side, programs: Sequence[Program], stack: ExitStack) -> CompiledBeside:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(law_library, "FLAGS", (*law_library.FLAGS, *self._flags))
        patch.setattr(law_library, "_cache", self.new_folder)
        side = stack.enter_context(Side([each.loaded() for each in programs], ticks(self._periods)))
        try:
            return CompiledBeside(python, side)
        except NotCompiled as error:
            raise Refused(programs, error.reasons) from None

    def new_folder(self) -> Path:
        folder = super().new_folder()
        folder.mkdir()
        return folder


class CompiledBeside(Beside):
    def __init__(self, python: Side, side: Side) -> None:
        self._python, self._side = python, side
        machine = side.connection.machine
        self._laws = machine.attach(CompiledLaws(PreparedLaws(side.wired, "", Path())))
        self._laws._bind()  # what the comparison of the first periods would find is found here
        self._state = self._laws.state
        side.observe()
        slots: dict[int, list[int]] = {number: [] for number in range(len(side.parts))}
        for slot, item in enumerate(side.connection.image.items):
            words = item.path.split(".")
            if words[0] == "parts":
                slots[int(words[1])].append(slot)
        self._slots = slots
        self._fields: dict[int, list[tuple[Any, Any, str, str]]] = {number: [] for number in slots}
        """By part: the object in Python, the one whose fields are in C, the name and the path of each field."""
        self._names: dict[int, set[str]] = {number: set() for number in slots}
        """Of fields, as a part has them."""
        self._deques: dict[int, list[tuple[deque[Any], deque[Any], str]]] = {number: [] for number in slots}
        """By part: those in Python, those whose elements C has, too, and their paths."""
        for struct in self._laws._translation.structs:
            held = struct.owner.held if isinstance(struct.owner, DequeFields) else struct.owner
            number, inner = side.place(held, struct.path)
            path = f"parts.{number}.{inner}".rstrip(".")
            if number < 0 or (owner := python.at(path)) is None:
                continue
            if held is not struct.owner:
                self._deques[number].append((owner, held, path))
                continue
            self._fields[number] += [(owner, struct.owner, name, path) for name in struct.fields]
            self._names[number] |= {f"{inner}.{name}" if inner else name for name in struct.fields}

    def set(self, number: int, name: str, value: Any) -> bool:
        if name not in self._names[number]:
            return False
        self._side.set(number, name, self._side.own(number, value))
        return True

    def set_anything(self, number: int, way: Callable[[Any, Any], object]) -> bool:
        way(self._side.parts[number], self._side.modules[number])
        return True

    def clear(self, number: int) -> bool:
        return self._side.clear(number)

    def acknowledge(self) -> None:
        self._side.m.acknowledge()

    def step(self, ticks: int, given: Sequence[Stimulus]) -> str | None:
        self._side.give(given)
        return self._side.step()

    def errors(self) -> dict[int, str]:
        return self._side.errors

    def restore(self, number: int) -> None:
        for owner, other, name, _ in self._fields[number]:
            restored(owner, name, self._python.own(number, _plain(getattr(other, name))))
        for held, beside, _ in self._deques[number]:
            refilled(held, beside)

    def difference(self, number: int) -> str:
        python, c = self._python, self._side
        if python.in_fault(number) != c.in_fault(number):
            return f"in fault: Python {python.in_fault(number)}, C {c.in_fault(number)}"
        for slot in self._slots[number]:
            one, other = ([column[slot] for column in _columns(each)] for each in (python, c))
            if not same(one, other):
                return f"{c.connection.image.items[slot].path}: Python {one}, C {other}"
        for owner, other, name, path in self._fields[number]:
            one, two = getattr(owner, name), _plain(getattr(other, name))
            if not same(one, two):
                return f"{path}.{name}: Python {one!r}, C {two!r}"
        for held, beside, path in self._deques[number]:
            if not same([*held], [*beside]):
                return f"{path}: Python {held!r}, C {beside!r}"
        return ""

    def gave_up(self) -> str:
        if self._laws.state == "compiled":
            return ""
        return "; ".join(each.text for each in self._side.connection.machine.events if "not compiled" in each.text)


def _columns(side: Side) -> list[Any]:
    return [getattr(side.connection.image.columns, name) for name in COLUMNS]


def _plain(value: Any) -> Any:
    return [*value] if type(value).__name__ == "BoundList" else value

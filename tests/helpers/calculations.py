"""Methods of a law as the control of a machine: in Python and compiled side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from helpers.machines import timer
from tools.compiled_machine import CompiledMachine, compiled
from umo import Compound, DigitalSensor
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import laid_out
from umo.generate.struct_memory import StructMemory
from umo.generate.translation import Translation
from umo.generate.translator import translate
from umo.testing import VirtualTimer


class Calculators(Compound):
    """All methods in one machine: it is compiled once."""

    timer: DigitalSensor
    parts: list[Compound]


def calculator(law: Callable[[], Any], work: Callable[[Any], None]) -> Any:
    """A part whose control is this method of its law, while the law is `chosen`."""

    class Calculator(Compound):
        def setup(self) -> None:
            self.law = law()

        def control(self) -> None:
            if self.law.chosen:
                work(self.law)

    return Calculator()


def translated(parts: Sequence[Compound], folder: Path | None = None) -> Translation:
    """The translation of a machine of these calculators. `folder`: its C is written there."""
    machine = Calculators(timer=timer(), parts=list(parts))
    wiring = {"drivers": {"clock": VirtualTimer()}, "wire": {"timer": {"driver": "clock", "period": "1 ms"}}}
    with laid_out(machine, wiring) as model:
        translation = translate(machine, model.conditions, model.steps, TARGETS["host"])
        if folder is not None:
            write_folder(files_of(model, translation, TARGETS["host"]), folder)
        return translation


class Calculation(NamedTuple):
    """One method: its law in Python, and the memory of the same law in C."""

    law: Any
    memory: StructMemory
    step: Callable[[], str | None]
    """A period of the C; the class of its error."""


class CompiledMethods:
    """The methods of a class of laws, which has an attribute `chosen`."""

    def __init__(self, law: Callable[[], Any], names: Sequence[str], folder: Path) -> None:
        self._names = list(names)
        self._parts = [calculator(law, getattr(law, name)) for name in names]
        translation = translated(self._parts, folder)
        self._compiled = CompiledMachine(compiled(folder), 0, 0)
        self._kinds = {each.number: each.kind for each in translation.faults} | {0: None}
        structs = enumerate(translation.structs)
        self._memories = {each.path: self._compiled.struct(number, each) for number, each in structs}
        self._compiled.begin([])

    @contextmanager
    def chosen(self, name: str) -> Iterator[Calculation]:
        """Only this method is called in each period."""
        place = self._names.index(name)
        law, memory = self._parts[place].law, self._memories[f"parts.{place}.law"]
        law.chosen = True
        try:
            yield Calculation(law, memory, lambda: self._kinds[self._compiled.step(1, [])])
        finally:
            law.chosen = False
            memory.write("chosen", False)

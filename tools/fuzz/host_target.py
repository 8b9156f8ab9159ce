"""The generated controller as a library of this computer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

from tools.compiled_machine import CompiledMachine, compiled
from tools.fuzz.machine import Side, part_of, refilled, restored
from tools.fuzz.program import Program
from tools.fuzz.stimuli import ACTUATORS, SENSORS, Stimulus
from tools.fuzz.target import Beside, Refused, Target
from tools.fuzz.verdict import same
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import model_of
from umo.generate.lower.lowered_rings import DequeFields
from umo.generate.struct_memory import StructMemory
from umo.generate.translation import RUNTIME_FAULTS
from umo.generate.translator import translate
from umo.objects import Quality


class HostTarget(Target):
    name = "host"

    def beside(self, python: Side, programs: Sequence[Program], stack: ExitStack) -> HostBeside:
        model = model_of(python.connection.machine, python.wired)
        translation = translate(python.m, model.conditions, model.steps, TARGETS["host"])
        if reasons := [*map(str, [*translation.problems, *translation.on_host])]:
            raise Refused(programs, reasons)
        folder = self.new_folder()
        write_folder(files_of(model, translation, TARGETS["host"]), folder)
        library = compiled(folder, *self._flags)
        return HostBeside(python, model, translation, CompiledMachine(library, model.inputs, len(model.outputs)))


class HostBeside(Beside):
    def __init__(self, python: Side, model: Any, translation: Any, c: CompiledMachine) -> None:
        self._python, self._model, self._c = python, model, c
        self._kinds: dict[int, str | None] = {0: None}
        self._kinds |= {number: kind for number, (_, kind, _) in enumerate(RUNTIME_FAULTS, 1)}
        self._kinds |= {each.number: each.kind for each in translation.faults}
        self._inputs = [one.path for one in model.objects[: model.inputs]]
        synchronous = [model.objects[slot] if model.objects[slot].synchronous else None for slot in model.outputs]
        self._outputs = [each.path if each is not None else "" for each in synchronous]
        """By place; what is not synchronous accepts everything."""
        self._equipment = [part_of(each.path)[0] for each in model.equipment]
        self._place = {part: place for place, part in enumerate(self._equipment)}
        memories = [c.struct(number, each) for number, each in enumerate(translation.structs)]
        parts = range(len(python.parts))
        self._memories: dict[int, list[tuple[StructMemory, Any]]] = {n: [] for n in (-1, *parts)}
        """By part: the fields in C, and the object that has them in Python."""
        self._fields: dict[int, dict[str, StructMemory]] = {n: {} for n in (-1, *parts)}
        """By part, and by the name of a field as the part has it, such as `part.gain`."""
        for each in memories:
            number, inner = self.place(each)
            self._memories[number].append((each, self.owner(each)))
            self._fields[number] |= {f"{inner}.{name}" if inner else name: each for name in each.fields}
        self._slots = {each.path: slot for slot, each in enumerate(python.connection.image.items)}
        self._objects = {n: [one for one in model.objects if part_of(one.path)[0] == n] for n in parts}
        self._before = [0] * len(parts)
        self.begin()

    def begin(self) -> None:
        self._c.begin([0] * self._model.inputs)

    def place(self, memory: StructMemory) -> tuple[int, str]:
        """The number of the part that has these fields, and the path of their object in it."""
        return self._python.place(memory._struct.owner, memory.path)

    def owner(self, memory: StructMemory) -> Any:
        """The object in Python that has these fields."""
        return memory._struct.owner

    def set(self, number: int, name: str, value: Any) -> bool:
        memory = self._fields[number].get(name)
        if memory is None:
            return False
        memory.write(name.rpartition(".")[2], value)
        return True

    def clear(self, number: int) -> bool:
        return self._c.clear(self._place[number])

    def acknowledge(self) -> None:
        self._c.acknowledge()

    def step(self, ticks: int, given: Sequence[Stimulus]) -> str | None:
        raws, failed, deaf = {}, {}, {}
        for number, each in enumerate(given):
            for name, raw, no in zip(SENSORS, each.raws, each.failed, strict=True):
                raws[f"parts.{number}.{name}"], failed[f"parts.{number}.{name}"] = raw, no
            deaf |= {f"parts.{number}.{name}": no for name, no in zip(ACTUATORS, each.deaf, strict=True)}
        self._before = self._faults()
        at = [path[path.index("parts.") :] for path in self._inputs]
        refused = [deaf.get(path[path.find("parts.") :], False) for path in self._outputs]
        fault = self.period(ticks, [raws[path] for path in at], [failed[path] for path in at], refused)
        self._now = self._faults()
        return self._kinds[fault]

    def period(self, ticks: int, raws: Sequence[int], failed: Sequence[bool], deaf: Sequence[bool]) -> int:
        """The fault of one period in C."""
        fault = self._c.step(ticks, raws, failed) or self._c.sent(deaf)
        while not fault and self._c.changed:
            fault = self._c.sent()  # the circuit takes every default
        return fault

    def _faults(self) -> list[int]:
        return [self._c.equipment_fault(self._place[n]) for n in range(len(self._place))]

    def errors(self) -> dict[int, str]:
        pairs = enumerate(zip(self._before, self._now, strict=True))
        kinds = {n: str(self._kinds[now]) for n, (before, now) in pairs if now and not before}
        return {n: kind for n, kind in kinds.items() if kind != "DriverError"}  # of what is read and sent

    def restore(self, number: int) -> None:
        for each, owner in self._memories[number]:
            if isinstance(owner, DequeFields):
                refilled(owner.held, self._python.own(number, each.read("at"))[: each.read("count")])
                continue
            for name in each.fields:
                restored(owner, name, self._python.own(number, each.read(name)))

    def difference(self, number: int) -> str:
        image, c = self._python.connection.image, self._c
        if self._python.in_fault(number) != bool(self._now[number]):
            return f"in fault: Python {self._python.in_fault(number)}, C {self._kinds[self._now[number]]}"
        for one in self._objects[number]:
            slot, at = one.slot, self._slots[one.path[one.path.index("parts.") :]]
            python, own = [image.values[at], image.quality[at]], [c.value(slot), c.quality(slot)]
            if one.output:
                place = self._model.outputs.index(slot)
                python += [image.pending[at], image.raws[at], self._python.inhibited(at)]
                own += [c.pending(place), c.raw(slot), c.inhibited(place)]
            if one.velocity is not None and image.quality[at] != Quality.BAD:
                python.append(image.velocity(at))
                own.append(c.velocity(slot))
            if not same(python, own):
                return f"{one.path}: Python {python}, C {own}"
        return next(_differences(self._memories[number]), "")


def _differences(memories: Sequence[tuple[StructMemory, Any]]) -> Iterator[str]:
    for each, owner in memories:
        for name in each.fields if owner is not None else ():
            python, c = getattr(owner, name), each.read(name)
            if not same(python, c):
                yield f"{each.path}.{name}: Python {python!r}, C {c!r}"

"""Small control programs in Python and in generated C side by side: many are compiled at once, each is played alone.

A program is an object with `control()`; what else it has is made by its class from a `Rig`, a machine with a sensor and
three actuators. Every program is translated by itself. Those that are not refused become one library, in which the
names of each have a prefix.
"""

from __future__ import annotations

import math
import re
import struct
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from helpers.machines import timer
from tools.compiled_machine import CompiledMachine, compiled
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.cycle.connect import connect
from umo.errors import DeclarationError
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import ControllerLaw, ControllerModel, model_of
from umo.generate.struct_memory import StructMemory
from umo.generate.translation import RUNTIME_FAULTS, CFunction, ControllerLimit, Translation
from umo.generate.translator import translate
from umo.generate.value_kinds import parts_of
from umo.objects import Quality
from umo.states import OnOff

HOST = TARGETS["host"]
STRUCTS = 64
"""Structs of one program at most."""
DEFINED = re.compile(
    r"^\} (\w+);|^static (?:const UMO_FLASH )?\w+ \*?(\w+)(?:\(|\[)|^(?:static )?void \*?(\w+)\(|"
    r"^    machine_of_\w+ (\w+);|^    (FAULT_\w+) =",
    re.MULTILINE,
)
"""Names that the C of a program defines outside of its functions."""
DISPATCH = """
int32_t chosen_program = 0;

static umo_fault chosen_law(umo_machine *m)
{{
    switch (chosen_program) {{
{laws}    default:
        return UMO_OK;
    }}
}}
"""
INIT = """
static void init_objects(umo_machine *m)
{{
    (void)m;
{inits}}}

void *machine_struct(umo_machine *m, int16_t number)
{{
    switch (number / {structs}) {{
{cases}    default:
        return NULL;
    }}
}}
"""


class Rig(Compound):
    """What the programs read and write."""

    timer: DigitalSensor
    x: DigitalSensor
    a: DigitalActuator
    b: DigitalActuator
    fan: BinaryActuator[OnOff]


def rig() -> Rig:
    def actuator() -> DigitalActuator:
        return DigitalActuator("V", default=0.0, minimum=-1e9, maximum=1e9, resolution=1.0)

    return Rig(
        timer=timer(),
        x=DigitalSensor("mm", minimum=-1000.0, maximum=1000.0, resolution=1.0),
        a=actuator(),
        b=actuator(),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )


@contextmanager
def connected_rig() -> Iterator[tuple[Rig, ControllerModel]]:
    """A rig, and what a controller of it is made of."""
    wire: dict[str, Any] = {name: {"driver": "simulated"} for name in ("x", "a", "b", "fan")}
    running = connect(rig(), {"drivers": {}, "wire": wire | {"timer": {"driver": "simulated", "period": "1 ms"}}})
    with running as machine:
        yield machine, model_of(running.machine, running.wired)


class Difference(NamedTuple):
    """What is not the same in a period."""

    inputs: Any
    what: str
    python: Any
    c: Any


class Played(NamedTuple):
    """How a program has been: "refused", "equal", "different" or "not compiled"."""

    outcome: str
    reasons: tuple[str, ...] = ()
    """Refused: why."""
    difference: Difference | None = None
    periods: int = 0
    faults: int = 0
    """Periods that ended with the same error in both."""
    limits: int = 0
    """Periods that ended in C at a limit of the controller: a whole number left 32 bits."""


class Translated(NamedTuple):
    """A program that was translated; `translation` is None where that has failed."""

    program: Any
    translation: Translation | None
    reasons: tuple[str, ...]


def translated(program: Any, machine: Rig) -> Translated:
    """The translation of one program; the reasons why it is refused."""
    found = translate(machine, [], [program.control], HOST)
    reasons = tuple(map(str, [*found.problems, *found.on_host]))
    return Translated(program, None if reasons else found, reasons)


class SideBySide:
    """Programs in one library."""

    def __init__(self, programs: Sequence[Translated], machine: Rig, model: ControllerModel, folder: Path) -> None:
        self._machine, self._model, self._programs = machine, model, programs
        self._image = machine._machine.whole.image
        parts = [_renamed(number, each.translation) for number, each in enumerate(programs) if each.translation]
        model.laws = [ControllerLaw(machine._enter_fault, -1)]
        whole = _whole(parts)
        whole.entry = {machine._enter_fault: CFunction("chosen_law")}
        write_folder(files_of(model, whole, HOST), folder)
        library = compiled(folder, "-O0")
        self._c = CompiledMachine(library, model.inputs, len(model.outputs))
        self._chosen = self._c.number("chosen_program")

    def play(self, number: int, trials: Sequence[Sequence[Mapping[str, Any]]]) -> Played:
        """One program with these inputs: of each trial the periods, of each period the attributes and `x` that it is
        given. A trial begins with the program as it was made, and ends at the first error."""
        one = self._programs[number]
        assert one.translation is not None
        self._chosen.value = number
        kinds = {each.number: each.kind for each in one.translation.faults}
        structs = one.translation.structs
        memories = [self._c.struct(number * STRUCTS + n, each) for n, each in enumerate(structs)]
        self._owners = {id(memory): each.owner for memory, each in zip(memories, structs, strict=True)}
        kept = Kept(one.program)
        counts = {"periods": 0, "faults": 0, "limits": 0}
        for periods in trials:
            kept.restore()
            self._begin(memories)
            for given in periods:
                counts["periods"] += 1
                fault = self._step(one.program, memories, given)
                python, c = fault[0], kinds.get(fault[1], fault[1])
                if c == ControllerLimit.__name__:
                    counts["limits"] += 1
                    break
                if c != (python or 0) and not _alike(python, fault[1]):
                    kept.restore()
                    return Played("different", difference=Difference(periods, "error", python, c), **counts)
                found = self._difference(memories)
                if found is not None:
                    kept.restore()
                    return Played("different", difference=Difference(periods, *found), **counts)
                if python is not None:
                    counts["faults"] += 1
                    break
        kept.restore()
        return Played("equal", **counts)

    def _begin(self, memories: Sequence[StructMemory]) -> None:
        self._c.restart()
        self._c.begin([0] * self._model.inputs)
        for each in memories:
            each.push()
        m = self._machine
        m.a.reset(), m.b.reset(), m.fan.reset()

    def _step(self, program: Any, memories: Sequence[StructMemory], given: Mapping[str, Any]) -> tuple[str | None, int]:
        x = 0
        for name, value in given.items():
            if name == "x":
                x = value
                continue
            setattr(program, name, value)
            for each in memories:
                if self._owners[id(each)] is program and name in each.fields:
                    each.write(name, value)
        slot = self._image.slot_of[id(self._machine.x)]
        self._image.columns.values[slot] = float(x)
        self._image.columns.quality[slot] = Quality.GOOD
        python = None
        try:
            with np.errstate(all="ignore"):
                program.control()
        except Exception as error:  # whatever it is, C has to have the same
            python = type(error).__name__
        names = [each.path for each in self._model.objects[: self._model.inputs]]
        fault = self._c.step(1, [x if name == "x" else 0 for name in names])
        self._c.sent()
        return python, fault

    def _difference(self, memories: Sequence[StructMemory]) -> tuple[str, Any, Any] | None:
        m = self._machine
        pending = {"a": m.a.pending, "b": m.b.pending, "fan": float(m.fan.pending is OnOff.ON)}
        for place, slot in enumerate(self._model.outputs):
            path = self._model.objects[slot].path
            if bits(pending[path]) != bits(self._c.pending(place)):
                return path, pending[path], self._c.pending(place)
        for each in memories:
            for name in each.fields:
                python, c = getattr(self._owners[id(each)], name), each.read(name)
                if not same(python, c):
                    return f"{each.path}.{name}", python, c
        return None


def _alike(python: str | None, fault: int) -> bool:
    """Whether a fault of the runtime has the class of this error."""
    return 0 < fault <= len(RUNTIME_FAULTS) and RUNTIME_FAULTS[fault - 1][1] == python


class Kept:
    """The attributes of a program and of the objects that it made, as they were."""

    def __init__(self, program: Any) -> None:
        self._objects: dict[int, tuple[Any, dict[str, Any]]] = {}
        self._contents: dict[int, tuple[Any, Any]] = {}
        self._keep(program)

    def _keep(self, value: Any) -> None:
        if id(value) in self._objects or id(value) in self._contents:
            return
        if isinstance(value, list | np.ndarray | deque):
            self._contents[id(value)] = value, value.copy()
            for each in value if isinstance(value, list | deque) else ():
                self._keep(each)
        elif type(value).__module__.partition(".")[0] not in ("umo", "builtins", "numpy", "enum") and hasattr(
            value, "__dict__"
        ):
            if isinstance(value, type | Enum) or callable(value):
                return
            self._objects[id(value)] = value, dict(vars(value))
            for each in vars(value).values():
                self._keep(each)

    def restore(self) -> None:
        for one, attributes in self._objects.values():
            vars(one).clear()
            vars(one).update(attributes)
        for one, content in self._contents.values():
            if isinstance(one, deque):
                one.clear()
                one.extend(content)
            else:
                one[:] = content


def bits(value: Any) -> Any:
    """A number as what is compared: all NaN are one."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and not isinstance(value, Enum) and abs(value) < 2**53:
        value = float(value)
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("d", value)
    return value


def same(python: Any, c: Any) -> bool:
    """Whether two values are the same; numbers of several classes are."""
    if python.__class__ is c.__class__ and c.__class__ in (float, int) and python == c != 0:
        return True  # nearly always
    if is_dataclass(python) and type(python) is type(c):
        python, c = parts_of(python), parts_of(c)
    if isinstance(python, np.ndarray) or isinstance(c, np.ndarray) or isinstance(python, list | tuple):
        if isinstance(python, int | float) or isinstance(c, int | float | type(None)):
            return False
        one, other = list(python), list(c)
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(python, bool | np.bool_) != isinstance(c, bool) and isinstance(c, bool):
        return False
    return bool(bits(python) == bits(c))


def _renamed(number: int, translation: Translation) -> Translation:
    """The same with names of its own."""
    init = f"{translation.init}\n{translation.access}"
    texts = translation.header, translation.members, translation.source, translation.fault_names, init
    names = {name for text in texts for found in DEFINED.findall(text) for name in found if name}
    word = re.compile(rf"\b(?:{'|'.join(map(re.escape, sorted(names)))})\b") if names else re.compile(r"(?!)")
    header, members, source, faults, init = (word.sub(lambda found: f"p{number}_{found[0]}", text) for text in texts)
    (entry,) = translation.entry.values()
    law = word.sub(lambda found: f"p{number}_{found[0]}", entry.name)
    init = init.replace(f"void *p{number}_machine_struct", f"static void *p{number}_machine_struct")
    entries = {"": CFunction(law)}
    return Translation(header=header, members=members, source=source, fault_names=faults, init=init, entry=entries)


def _whole(parts: Sequence[Translation]) -> Translation:
    """The programs as one."""
    laws = "".join(f"    case {n}:\n        return {each.entry[''].call()};\n" for n, each in enumerate(parts))
    inits = "".join(f"    p{n}_init_objects(m);\n" for n, _ in enumerate(parts))
    has = [n for n, each in enumerate(parts) if "machine_struct(" in each.init]
    cases = "".join(
        f"    case {n}:\n        return p{n}_machine_struct(m, (int16_t)(number % {STRUCTS}));\n" for n in has
    )
    return Translation(
        header="\n".join(each.header for each in parts),
        members="".join(each.members for each in parts),
        source="\n".join(each.source for each in parts) + DISPATCH.format(laws=laws),
        fault_names="".join(each.fault_names for each in parts),
        init="\n".join(each.init for each in parts) + INIT.format(inits=inits, cases=cases, structs=STRUCTS),
    )


def played(
    makers: Sequence[Callable[[Rig], Any]], trials: Callable[[int], Sequence[Sequence[Mapping[str, Any]]]], folder: Path
) -> list[Played]:
    """Each program with its trials. A batch that does not compile is compiled program by program."""
    with connected_rig() as (machine, model):
        given = [translated(make(machine), machine) for make in makers]
        found: dict[int, Played] = {
            n: Played("refused", each.reasons) for n, each in enumerate(given) if each.translation is None
        }
        rest = [n for n in range(len(given)) if n not in found]
        found |= dict(_together(rest, given, machine, model, trials, folder))
    return [found[n] for n in range(len(makers))]


def _together(
    rest: list[int], given: Sequence[Translated], machine: Rig, model: ControllerModel, trials: Any, folder: Path
) -> Iterator[tuple[int, Played]]:
    if not rest:
        return
    try:
        both = SideBySide([given[n] for n in rest], machine, model, folder / f"programs-{rest[0]}-{len(rest)}")
    except DeclarationError as error:
        if len(rest) == 1:
            yield rest[0], Played("not compiled", (str(error),))
            return
        half = len(rest) // 2
        yield from _together(rest[:half], given, machine, model, trials, folder)
        yield from _together(rest[half:], given, machine, model, trials, folder)
        return
    for place, n in enumerate(rest):
        yield n, both.play(place, trials(n))

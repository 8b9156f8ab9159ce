"""Compiled laws of a connected machine, beside the same machine in Python: equal in all that Python sees."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from random import Random
from typing import Any

import pytest

from helpers.compiling import CompiledRun
from helpers.controllers import MACHINES, Tried
from helpers.generating import Fragile, needs_a_compiler, random_inputs, set_inputs, told_by
from helpers.machines import actuator, sensor, timer
from helpers.tiers import first
from umo import Compound, DigitalActuator, DigitalSensor
from umo.cycle.connect import connect
from umo.errors import BadInput
from umo.generate.bound_fields import BoundList
from umo.generate.compiled_laws import CompiledLaws, prepare
from umo.generate.controller_model import laid_out
from umo.objects import atoms
from umo.objects.sensors import Sensor
from umo.testing import VirtualTimer
from umo.wiring import resolve

pytestmark = needs_a_compiler


@dataclass
class Two:
    """Two machines of one kind with circuits of their own: the laws of the second are compiled."""

    tried: Tried
    missed: list[int]
    machines: list[Any] = field(default_factory=list)
    boxes: list[Fragile] = field(default_factory=list)
    connections: list[connect[Any]] = field(default_factory=list)
    stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Two:
        for compiled in (False, True):
            machine, box = self.tried.make(), Fragile()
            wiring = self.tried.wiring(machine, box, VirtualTimer(self.missed))
            wired = resolve(machine, wiring)
            prepared = prepare(machine, wired) if compiled else None
            with laid_out(machine, wired) as model:
                self.model = model
            inputs = [each.path for each in atoms(machine) if isinstance(each, Sensor) and each.path != "timer"]
            set_inputs(box, inputs, [0] * len(inputs), [False] * len(inputs))
            connection = connect(machine, wired)
            self.stack.enter_context(connection)
            if prepared is not None:
                self.laws = connection.machine.attach(CompiledLaws(prepared))
            self.machines.append(machine)
            self.boxes.append(box)
            self.connections.append(connection)
        return self

    def __exit__(self, *error: Any) -> None:
        self.stack.__exit__(*error)

    def step(self, raws: list[int], failed: list[bool]) -> None:
        told = []
        for m, box in zip(self.machines, self.boxes, strict=True):
            set_inputs(box, [each.path for each in self.model.objects[: self.model.inputs]], raws, failed)
            told.append(_period(m))
        assert told[0] == told[1]

    def clear(self) -> None:
        told = [told_by(partial(each.machine.equipment.clear, each.root)) for each in self.connections]
        assert told[0] == told[1]
        for m in self.machines:
            m.acknowledge()

    def difference(self) -> str:
        first, second = (each.image for each in self.connections)
        for name in ("values", "quality", "pending", "raws", "restrictions", "equipment", "axes"):
            if getattr(first.columns, name).tobytes() != getattr(second.columns, name).tobytes():
                return name
        for struct in self.laws._translation.structs:
            one = _at(self.machines[0], struct.path)
            if one is None:
                continue  # inside of a law or a Vector, and not changed
            for name in struct.fields:
                a, b = (repr(_plain(getattr(each, name))) for each in (one, struct.owner))
                if a != b:
                    return f"{struct.path}.{name}: Python has {a}, C has {b}"
        return ""


def _period(m: Any) -> str | None:
    m.timer.read()
    return told_by(m.sample) or told_by(m.control) or told_by(m.update)


def _at(machine: Any, path: str) -> Any:
    found = machine
    for part in filter(None, path.split(".")):
        found = found[int(part)] if part.isdigit() else getattr(found, part, None)
    return found


def _plain(value: Any) -> Any:
    """As numbers of Python; an array of one element is taken for each."""
    if isinstance(value, BoundList):
        return list(value)
    if not hasattr(value, "tolist"):
        return value
    listed = value.tolist()
    return listed[0] if isinstance(listed, list) and len(set(map(repr, listed))) == 1 else listed


OTHERS = ("rates", "equipment", "converter", "batch", "conveyor", "objects")


@pytest.mark.parametrize(
    ("name", "steps"), first(2, [("laws", 600), ("rates", 1_000), *((name, 10_000) for name in OTHERS)])
)
def test_thousands_of_random_periods_are_the_same(name: str, steps: int) -> None:
    random = Random(name)
    with Two(MACHINES[name], [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]) as two:
        following = random_inputs(two.model, random)
        for number in range(steps):
            two.step(*following())
            if random.random() < 0.1:
                two.clear()
            assert (number, two.difference()) == (number, "")
        assert two.laws.state == "compiled"


class Moved(Compound):
    timer: DigitalSensor
    slide: DigitalSensor
    speed: DigitalActuator

    def control(self) -> None:
        self.speed.write(self.slide.velocity)


def test_the_velocity_of_a_sensor_that_is_bad_raises_as_in_python() -> None:
    slide = sensor(on_error="mark", velocity=0.0)
    with CompiledRun(Moved(timer=timer(), slide=slide, speed=actuator(minimum=-1e6, maximum=1e6))) as run:
        set_inputs(run.box, ["slide"], [0], [True])
        run.m.timer.read()
        run.m.sample()
        with pytest.raises(BadInput, match="slide"):
            run.m.control()

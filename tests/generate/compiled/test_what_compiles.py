"""What translates for controllers and is Python's where laws are compiled is refused with its line."""

from __future__ import annotations

import inspect

import pytest

from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.machines import timer
from umo import Compound, DigitalActuator, DigitalSensor
from umo.generate.compiled_laws import NotCompiled, prepare
from umo.testing import VirtualTimer
from umo.wiring import resolve

pytestmark = needs_a_compiler


class Tank(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    motor: DigitalActuator


class Resetting(Tank):
    def control(self) -> None:
        self.motor.reset()


class Timed(Tank):
    def control(self) -> None:
        self.motor.write(self.level.time)


@pytest.mark.parametrize(("kind", "name"), [(Resetting, "reset"), (Timed, "time")])
def test_what_only_python_does_with_an_object_is_refused_with_its_line(kind: type[Tank], name: str) -> None:
    level = DigitalSensor("%", minimum=0.0, maximum=100.0, resolution=0.1)
    motor = DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01)
    machine = kind(timer=timer(), level=level, motor=motor)
    line = inspect.getsourcelines(kind.control)[1] + 1
    with pytest.raises(
        NotCompiled, match=rf"test_what_compiles.py:{line}: .*`{name}` of an object is evaluated by Python"
    ):
        prepare(machine, resolve(machine, wired(machine, Fragile(), VirtualTimer())))

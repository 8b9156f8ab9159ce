"""Compiled laws are writers of their actuators as laws in Python are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from helpers.conversions import BUILT
from helpers.generating import needs_a_compiler
from helpers.machines import actuator, relay, sensor, timer, wired
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Vector, connect
from umo.control import next_period, value_of
from umo.cycle.events import MISTAKE
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import resolve

pytestmark = [needs_a_compiler, BUILT]
HERE = Path(__file__)


class Unit(Compound):
    heater: DigitalActuator
    fan: BinaryActuator[OnOff]
    temperature: DigitalSensor

    def control(self) -> None:
        self.heater.write(0.1 * value_of(self.temperature) + 1.0)
        self.fan.write(OnOff.ON)


class Oven(Compound):
    timer: DigitalSensor
    unit: Unit
    zones: list[DigitalActuator]
    boost: bool = False

    def setup(self) -> None:
        self.all_zones = Vector(self.zones)

    def control(self) -> None:
        if self.boost:
            self.unit.heater.write(9.0)
        self.all_zones.write(np.array([1.0, 2.0]))


@contextmanager
def compiled() -> Iterator[tuple[Oven, Any]]:
    """An oven whose laws are compiled already."""
    unit = Unit(heater=actuator(), fan=relay(), temperature=sensor())
    m = Oven(timer=timer(), unit=unit, zones=[actuator(), actuator()])
    found = resolve(m, wired(m, Scripted(), clock=VirtualTimer()))
    prepared = prepare(m, found)
    connection = connect(m, found)
    with connection:
        laws = connection.machine.attach(CompiledLaws(prepared))
        periods(m, COMPARED * 3)
        assert laws.state == "compiled"
        yield m, connection
        assert laws.state == "compiled"


def told(connection: Any) -> dict[str, str]:
    return {each.path: each.text for each in connection.machine.events if each.asked == MISTAKE}


def place_of(law: Any) -> str:
    return f"{HERE.name}:{law.__code__.co_firstlineno} in control)"


def test_nobody_is_accused_when_laws_are_compiled() -> None:
    with compiled() as (m, connection):
        periods(m, 5)
        assert told(connection) == {}


def test_two_compiled_laws_of_one_actuator_are_told_with_the_places_of_both() -> None:
    with compiled() as (m, connection):
        m.boost = True
        periods(m, 3)
        text = told(connection)["unit.heater"]
        assert place_of(Unit.control) in text
        assert place_of(Oven.control) in text
        assert (m.unit.heater.read(), list(told(connection))) == (1.0, ["unit.heater"])


async def interfere(m: Oven) -> None:
    while True:
        m.unit.heater.write(5.0)
        m.unit.fan.write(OnOff.OFF)
        m.zones[1].write(7.0)
        await next_period()


def test_a_sequence_and_compiled_laws_are_told() -> None:
    with compiled() as (m, connection):
        m.cycle.start(interfere(m))
        periods(m, 3)
        found = told(connection)
        assert set(found) == {"unit.heater", "unit.fan", "zones.1"}
        assert all("sequence interfere (" in text and " and control of " in text for text in found.values())

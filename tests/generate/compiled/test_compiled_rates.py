"""Compiled laws of parts with rates of their own: what a period has beside the laws, which random periods compare."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from helpers.compiling import CompiledRun
from helpers.conversions import BUILT
from helpers.generating import needs_a_compiler, wired
from helpers.in_c import FragileInC, TimerInC
from helpers.machines import actuator, sensor, timer
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import next_period
from umo.cycle.connect import connect
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.generate.period_in_c import PeriodInC
from umo.wiring import resolve

pytestmark = needs_a_compiler


class Mixer(Compound, every=10):
    level: DigitalSensor
    motor: DigitalActuator

    def setup(self) -> None:
        self.speeds, self.acted = {"slow": 1.0}, 0

    def control(self) -> None:
        self.acted += 1
        self.motor.write(self.speeds["slow"] + 0.0 * self.level.read())

    async def hurry(self) -> None:
        await next_period()
        self.speeds["slow"] = 4.0


class Plant(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    valve: DigitalActuator
    mixer: Mixer

    def setup(self) -> None:
        self.seen = 0.0

    def control(self) -> None:
        self.seen += self.dt + 100.0 * self.mixer.dt
        self.valve.write(0.1 * self.level.read())


def plant() -> Plant:
    mixer = Mixer(level=sensor(), motor=actuator())
    return Plant(timer=timer(), level=sensor(), valve=actuator(), mixer=mixer)


def test_each_law_is_compared_in_periods_of_its_own() -> None:
    with CompiledRun(plant(), state="compared") as run:
        run.step(9 * (COMPARED + 1))
        assert run.laws.state == "compiled"


def test_a_sequence_of_a_part_that_sets_what_is_known_is_seen_before_the_laws_of_the_same_period() -> None:
    with CompiledRun(plant(), state="compared") as run:
        run.step(9 * (COMPARED + 1))
        run.m.mixer.cycle.start(run.m.mixer.hurry())
        while run.laws.state == "compiled":
            run.step()
        assert run.m.mixer.motor.read() == 4.0
        assert "mixer.speeds was set" in run.events


@contextmanager
def in_c() -> Iterator[tuple[Any, PeriodInC, FragileInC]]:
    machine, box, clock = plant(), FragileInC(), TimerInC()
    wiring = resolve(machine, wired(machine, box, clock))
    prepared, connection = prepare(machine, wiring), connect(machine, wiring)
    with connection:
        laws = connection.machine.attach(CompiledLaws(prepared))
        period = connection.machine.attach(PeriodInC())
        while clock.reads < 15 * COMPARED:
            period.run(1, None)
        assert laws.state == "compiled"
        yield machine, period, box


@BUILT
def test_the_periods_between_those_of_a_part_are_in_c_and_its_own_end_with_it() -> None:
    with in_c() as (m, period, box):
        before = m.mixer.acted
        period.run(50, None)  # the period of the part
        assert [period.run(50, None) for _ in range(5)] == [10] * 5
        assert m.mixer.acted in (before + 5, before + 6)
        assert period.reasons == {}
        assert box.moved_in_c > 200

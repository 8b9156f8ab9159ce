"""What fails in one period is settled together: one reset, nothing of it runs on meanwhile (docs/decisions/0061)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.machines import actuator, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, TaskFailed, connect
from umo.control import next_period
from umo.cycle.to_defaults import ToDefault
from umo.operation import PackML
from umo.testing import Scripted

ZONES = 12


class States(PackML):
    """Those of a zone."""

    broken = False

    def supervise(self) -> None:
        super().supervise()
        if self.broken:
            raise ValueError("its states are broken")


class Zone(Compound, equipment=True):
    heater: DigitalActuator
    fan: DigitalActuator
    probe: DigitalSensor
    broken = False
    steps = 0

    def setup(self) -> None:
        self.unit = States(self)

    def control(self) -> None:
        if self.broken:
            raise ValueError("its law is broken")


class Hall(Compound):
    timer: DigitalSensor
    zones: list[Zone]


class Rig:
    """A connected hall with a driver of its actuators and another of its sensors."""

    def __init__(self) -> None:
        zones = [Zone(heater=actuator(), fan=actuator(synchronous=False), probe=sensor()) for _ in range(ZONES)]
        self.m = Hall(timer=timer(), zones=zones)
        self.box, self.probes = Scripted(), Scripted()
        wiring = wired(self.m, self.box)
        wiring["drivers"]["probes"] = self.probes
        for number in range(ZONES):
            wiring["wire"][f"zones.{number}.probe"]["driver"] = "probes"
        self.connection = connect(self.m, wiring)
        self.calls = 0

    def __enter__(self) -> Rig:
        self.connection.__enter__()
        image: Any = self.connection.machine.image
        settle = image.settle

        def counted(slots: Any, way: ToDefault) -> Any:
            self.calls += way is ToDefault.RESET
            return settle(slots, way)

        image.settle = counted
        return self

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(*error)

    def period(self) -> None:
        m = self.m
        m.timer.read()
        m.sample()
        m.control()
        m.update()

    def drive(self) -> None:
        for zone in self.m.zones:
            zone.heater.write(5.0)
            zone.fan.write(3.0)
        self.period()

    def driven(self) -> set[float]:
        return {each.read() for zone in self.m.zones for each in (zone.heater, zone.fan)}


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


async def fails(zone: Zone) -> None:
    await next_period()
    raise ValueError("its sequence is broken")


async def steps(zone: Zone) -> None:
    while True:
        zone.steps += 1
        await next_period()


def by_laws(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.broken = True


def by_sequences(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.cycle.start(fails(zone))
    rig.period()


def by_states(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.unit.broken = True


def by_aborts(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.unit.abort()


def by_sensors(rig: Rig) -> None:
    for zone in rig.m.zones:
        rig.probes.set(zone.probe.path, OSError("no answer"))


@pytest.mark.parametrize("fail", [by_laws, by_sequences, by_states, by_aborts, by_sensors])
def test_what_fails_in_one_period_is_at_its_defaults_in_that_period_by_one_reset(
    rig: Rig, fail: Callable[[Rig], None]
) -> None:
    rig.drive()
    assert rig.driven() == {5.0, 3.0}
    fail(rig)
    rig.calls = 0
    rig.period()
    assert all(zone.cycle.fault for zone in rig.m.zones)
    assert rig.driven() == {0.0}
    assert rig.calls == 1


def test_no_sequence_of_equipment_takes_a_step_after_one_of_it_has_failed(rig: Rig) -> None:
    zone, other = rig.m.zones[:2]
    zone.cycle.start(fails(zone))
    tasks = [each.cycle.start(steps(each)) for each in (zone, other, zone)]
    rig.period()
    rig.period()
    assert (zone.steps, other.steps) == (2, 2)
    rig.period()
    assert (zone.steps, other.steps) == (2, 3)
    assert [task.done for task in tasks] == [True, False, True]


@pytest.mark.parametrize("clears", [False, True])
def test_who_is_told_of_a_failure_finds_the_fault_in_the_same_step(rig: Rig, clears: bool) -> None:
    zone, found = rig.m.zones[0], []

    async def supervises() -> None:
        try:
            await task
        except TaskFailed:
            found.append((bool(zone.cycle.fault), zone.heater.write(4.0), zone.fan.write(4.0)))
            if clears:
                found.append((rig.m.cycle.clear(), zone.cycle.fault, zone.heater.read(), zone.heater.write(4.0)))

    rig.drive()
    task = zone.cycle.start(fails(zone))
    rig.m.cycle.start(supervises())
    rig.period()
    assert not found
    rig.period()
    assert found == [(True, False, False), *([(["zones.0"], None, 0.0, True)] if clears else [])]
    assert (zone.heater.read(), zone.fan.read()) == ((4.0 if clears else 0.0), 0.0)


def test_what_a_fault_has_left_of_others_runs_on(rig: Rig) -> None:
    rig.drive()
    zone, other = rig.m.zones[:2]
    other.cycle.start(steps(other))
    zone.cycle.start(fails(zone))
    for _ in range(5):
        rig.period()
    assert (other.steps, other.cycle.fault, other.heater.read()) == (5, None, 5.0)
    assert (zone.heater.read(), zone.fan.read()) == (0.0, 0.0)

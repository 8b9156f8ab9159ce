"""What ends with equipment: sequences that others await or cancel, cleaning up that fails, laws of the same period."""

from __future__ import annotations

import gc
from contextlib import suppress
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, timer
from helpers.reactors import Commanded, Plant, Reactor, Rig, fail_law, fail_sensor, reactor
from umo import Compound, TaskFailed
from umo.control import ServoAxis, first, next_period, timeout, wait
from umo.errors import EquipmentFault
from umo.states import OnOff


async def spilling() -> None:
    """It fails while cleaning up."""
    try:
        await wait(1.0)
    finally:
        raise ValueError("it has spilt")


async def fails_after(periods: int) -> None:
    for _ in range(periods):
        await next_period()
    raise TaskFailed("no feed")


async def parent(a: Compound) -> None:
    await handles(a.cycle.start(fails_after(2)), [], 1.0)


async def handles(task: Any, told: list[str], then: float = 0.0) -> None:
    try:
        await task
    except TaskFailed as error:
        told.append(str(error))
    await wait(then)


# Whose failure it is --------------------------------------------------------------------------------------


def test_the_cleaning_up_of_a_sequence_that_the_machine_cancels_is_a_fault_of_its_own_equipment() -> None:
    told: list[str] = []

    async def main(m: Plant) -> None:
        try:
            async with timeout("3 ms"):
                await m.a.cycle.start(spilling())
        except TaskFailed as error:
            told.append(str(error))

    with Rig() as rig:
        rig.m.cycle.start(main(rig.m))
        rig.periods(8)
        assert "it has spilt" in rig.m.a.cycle.fault
        assert len(told) == 1
        assert told[0].startswith("the block did not end within 0.003 s")


def test_the_loser_of_first_that_fails_in_its_cleaning_up_is_a_fault_of_its_own_equipment() -> None:
    async def use(a: Compound) -> None:
        await first(wait("3 ms"), a.cycle.start(spilling()))

    with Rig() as rig:
        rig.m.b.cycle.start(use(rig.m.a))
        rig.periods(8)
        assert "it has spilt" in rig.m.a.cycle.fault
        assert rig.m.b.cycle.fault is None


def test_a_cleaning_up_that_fails_in_equipment_in_fault_is_told() -> None:
    with Rig() as rig:
        rig.m.a.cycle.start(spilling())
        rig.periods(2)
        fail_law(rig)
        rig.periods(1)
        assert any("a: while cleaning up: ValueError: it has spilt" in text for text in rig.texts)


@pytest.mark.parametrize("inside_first", [True, False])
def test_a_failure_that_one_of_two_awaiters_handles_inside_is_no_fault(inside_first: bool) -> None:
    inside: list[str] = []
    outside: list[str] = []
    with Rig() as rig:
        task = rig.m.a.cycle.start(fails_after(3))
        awaiters = [(rig.m.a, handles(task, inside, 0.02)), (rig.m, handles(task, outside))]
        for part, sequence in awaiters if inside_first else reversed(awaiters):
            part.cycle.start(sequence)
            rig.periods(1)
        rig.periods(6)
        assert rig.m.a.cycle.fault is None
        assert [len(inside), len(outside)] == [1, 1]


@pytest.mark.parametrize("periods", range(1, 6))
def test_a_run_that_ends_before_a_failure_is_taken_has_not_failed(periods: int) -> None:
    with Rig() as rig:
        rig.m.a.cycle.start(parent(rig.m.a))
        rig.periods(periods)


@pytest.mark.parametrize("periods", range(2, 7))
def test_a_failure_that_nobody_has_taken_before_a_fault_ends_with_the_fault(periods: int) -> None:
    with Commanded() as rig:
        rig.m.a.cycle.start(parent(rig.m.a))
        rig.periods(periods)
        rig.do("mode", value="manual")
        fail_sensor(rig)
        rig.periods(2)
        rig.boxes["of_a"].set("a.thermometer", 5)
        rig.periods(1)
        rig.do("clear")
        rig.do("mode", value="automatic")
        rig.periods(3)
        assert rig.m.a.cycle.fault is None


# The same period ------------------------------------------------------------------------------------------


def test_a_cleaning_up_that_clears_the_machine_spares_no_sequence_of_other_equipment_in_fault() -> None:
    async def cleaner(m: Plant) -> None:
        try:
            await wait(100.0)
        finally:
            m.cycle.clear()

    def broken() -> None:
        raise ValueError("the law is broken")

    with Rig() as rig:
        m = rig.m
        m.a.cycle.start(cleaner(m))
        task = m.b.cycle.start(m.b.heat())
        rig.periods(3)
        m.a.law = m.b.law = broken
        rig.periods(1)
        m.a.law = m.b.law = None
        rig.periods(1)
        assert (task.done, m.b.heater.read()) == (True, 0.0)


def test_a_law_of_equipment_is_not_called_any_more_in_the_period_of_its_fault() -> None:
    class Driving(Plant):
        def control(self) -> None:
            self.a.drain.write(OnOff.ON)

    with Rig(Driving(timer=timer(), lamp=relay(), level=sensor(), a=reactor(), b=reactor())) as rig:
        box, m = rig.boxes["of_a"], rig.m
        rig.periods(2)
        acted = m.a.acted
        m.a.drain.write(OnOff.OFF)
        box.at(len(box.calls) + 1, OSError("the coil is broken"))  # after read_many
        rig.periods(1)
        assert "the coil is broken" in m.a.cycle.fault
        assert m.a.acted == acted
        m.a.cycle.clear()
        rig.periods(1)
        assert m.a.acted == acted + 1


def test_an_axis_whose_disable_fails_does_not_keep_the_rest_of_the_equipment_from_ending() -> None:
    class Table(ServoAxis):
        def disable(self) -> None:
            super().disable()
            if self.cycle.connected:
                raise ValueError("the brake does not answer")

    class Turning(Reactor, equipment=True):
        table: ServoAxis

    limits = {"velocity": 50.0, "acceleration": 500.0, "jerk": 1e4, "window": 1.0, "following_error": 0.5}
    table = Table(motor=actuator(), encoder=sensor(minimum=-100.0), gain=0.1, **limits)
    with Rig(a=reactor(Turning, table=table)) as rig:
        task = rig.m.a.cycle.start(rig.m.a.heat())
        rig.periods(2)
        fail_law(rig)
        rig.periods(2)
        assert "the law is broken" in rig.m.a.cycle.fault
        assert task.done
        assert any("a: while cleaning up: ValueError: the brake does not answer" in text for text in rig.texts)


def test_a_refused_start_keeps_nothing_while_the_collector_is_off() -> None:
    async def again(m: Plant) -> None:
        while True:
            with suppress(EquipmentFault):
                m.a.cycle.start(m.a.heat())
            await next_period()

    gc.collect()  # what other tests have left
    gc.disable()
    try:
        with Rig() as rig:
            rig.m.a.cycle.start(fails_after(0))
            rig.periods(1)
            rig.m.cycle.start(again(rig.m))
            rig.periods(20)
            assert not [each for each in gc.get_objects() if isinstance(each, EquipmentFault)]
    finally:
        gc.enable()

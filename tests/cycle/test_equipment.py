"""Equipment: what fails in it stays in it, whoever awaits it is told, and `clear` brings it back."""

from __future__ import annotations

import gc
import logging
import re
import weakref
from collections.abc import Iterator, Sequence
from math import nan
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.reactors import (
    AT_DEFAULT,
    DRIVEN,
    FAILURES,
    REASONS,
    Plant,
    Reactor,
    Rig,
    Valve,
    driven,
    fail_law,
    fail_sensor,
    fail_sequence,
    failing,
    reactor,
    run_both,
)
from umo import (
    Compound,
    DigitalActuator,
    DigitalSensor,
    TaskFailed,
    connect,
)
from umo.control import next_period, until, value_of, wait
from umo.errors import Cancelled, DriverError, EquipmentFault
from umo.states import OnOff
from umo.testing import Scripted


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


@pytest.mark.parametrize(("fail", "reason"), [*zip(FAILURES, REASONS, strict=True)])
def test_what_fails_in_equipment_brings_it_to_its_defaults_and_nothing_else(rig: Rig, fail: Any, reason: str) -> None:
    run_both(rig)
    acted = rig.m.acted
    fail(rig)
    rig.periods(2)
    a, b = rig.m.a, rig.m.b
    assert reason in (a.cycle.fault or "")
    assert (a.cleaned, b.cleaned) == (1, 0)
    assert driven(a) == AT_DEFAULT
    assert (b.cycle.fault, rig.m.cycle.fault, driven(b), rig.m.lamp.read()) == (None, None, DRIVEN, OnOff.ON)
    rig.periods(5)
    assert rig.m.acted == acted + 7
    assert [text for text in rig.texts if "fault" in text] == [f"a: in fault: {a.cycle.fault}"]


@pytest.mark.parametrize("where", ["law", "sequence"])
def test_the_reason_of_a_mistake_that_umo_finds_in_equipment_has_its_place_and_the_log_its_traceback(
    rig: Rig, where: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "umo")

    def mistaken() -> None:
        rig.m.a.heater.write(nan)

    async def phase() -> None:
        mistaken()

    run_both(rig)
    if where == "law":
        rig.m.a.law = mistaken
    else:
        rig.m.a.cycle.start(phase())
    rig.periods(2)
    assert re.fullmatch(r"a\.heater: nan is not finite \(\S*test_equipment\.py:\d+ in mistaken\)", rig.m.a.cycle.fault)
    (record,) = (each for each in caplog.records if each.levelno == logging.DEBUG)
    assert record.message == "a: in fault" and "rig.m.a.heater.write(nan)" in caplog.text


@pytest.mark.parametrize("fail", FAILURES)
def test_a_failure_of_the_machine_itself_ends_the_run(fail: Any) -> None:
    class Whole(Reactor, equipment=False):
        pass

    rig = Rig(a=reactor(Whole))
    with pytest.raises((ValueError, DriverError, TaskFailed)), rig:
        run_both(rig)
        fail(rig)
        rig.periods(2)


@pytest.mark.parametrize("error", [SystemExit(0), KeyboardInterrupt(), Cancelled()])
def test_a_law_or_sequence_that_would_end_the_program_is_a_fault_like_any_other(rig: Rig, error: BaseException) -> None:
    def exits() -> None:
        raise error

    async def phase() -> None:
        exits()

    rig.m.a.law = exits
    rig.m.b.cycle.start(phase())
    rig.periods(2)
    assert type(error).__name__ in (rig.m.a.cycle.fault or "")
    assert rig.m.b.cycle.fault is not None


def test_equipment_in_fault_is_reset_in_its_stop_order_and_then_sent_its_defaults_in_each_period(rig: Rig) -> None:
    run_both(rig)
    box = rig.boxes["of_a"]
    before = len(box.calls)
    fail_law(rig)
    rig.periods(3)
    resets = [call.channels[0] for call in box.calls[before:] if call.segment == "reset"]
    assert resets == ["a.heater", "a.stirrer", "a.drain", "a.outlet.coil"]
    assert [call.raws for call in box.segments("write_many")[-2:]] == [(0, 0, 0)] * 2


def test_what_is_written_to_equipment_in_fault_is_refused_and_says_why(rig: Rig) -> None:
    run_both(rig)
    fail_sequence(rig)
    rig.periods(1)
    heater = rig.m.a.heater
    assert (heater.write(3.0), heater.inhibited) == (False, "a is in fault")
    assert rig.m.a.drain.write(OnOff.ON) is False
    assert rig.m.a.outlet.coil.write(OnOff.ON) is False
    assert heater.write(0.0)
    rig.periods(2)
    assert driven(rig.m.a) == AT_DEFAULT


def test_the_laws_of_equipment_in_fault_are_not_called_and_it_is_still_sampled(rig: Rig) -> None:
    fail_sequence(rig)
    rig.periods(1)
    acted = rig.m.a.acted
    rig.boxes["of_a"].set("a.thermometer", 40)
    rig.periods(3)
    assert rig.m.a.acted == acted
    assert rig.m.a.thermometer.read() == 20.0


def test_a_law_that_fails_keeps_no_other_law_from_acting(rig: Rig) -> None:
    fail_law(rig)
    acted = rig.m.b.acted
    rig.periods(1)
    assert rig.m.b.acted == acted + 1


def test_a_failure_of_an_inner_equipment_is_not_that_of_the_outer_one(rig: Rig) -> None:
    run_both(rig)

    async def stuck() -> None:
        raise TaskFailed("the valve is stuck")

    rig.m.a.outlet.cycle.start(stuck())
    rig.periods(2)
    assert (rig.m.a.outlet.cycle.fault, rig.m.a.cycle.fault) == ("the valve is stuck", None)
    assert driven(rig.m.a) == (2.0, 5.0, OnOff.ON, OnOff.OFF)
    fail_law(rig)
    rig.periods(2)
    assert rig.m.a.outlet.cycle.clear() == ["a", "a.outlet"]


def test_a_fault_of_the_outer_equipment_takes_the_inner_with_it(rig: Rig) -> None:
    run_both(rig)
    fail_law(rig)
    rig.periods(1)
    assert rig.m.a.outlet.cycle.fault is not None
    with pytest.raises(EquipmentFault, match=r"a is in fault: ValueError: the law is broken"):
        rig.m.a.outlet.cycle.start(rig.m.a.heat())


def test_a_driver_that_fails_as_a_whole_puts_only_the_equipment_on_it_in_fault(rig: Rig) -> None:
    run_both(rig)
    rig.boxes["of_a"].broken = OSError("unplugged")
    rig.periods(3)
    assert "unplugged" in (rig.m.a.cycle.fault or "")
    assert (rig.m.b.cycle.fault, driven(rig.m.b)) == (None, DRIVEN)
    assert any("a: has actuators not brought to their defaults yet: " in text for text in rig.texts)
    rig.boxes["of_a"].broken = None
    rig.periods(1)
    assert driven(rig.m.a) == AT_DEFAULT


def test_a_driver_with_objects_of_the_machine_itself_ends_the_run_when_it_fails() -> None:
    rig = Rig()
    with pytest.raises(DriverError, match="level"), rig:
        rig.boxes["box"].set("level", OSError("gone"))
        rig.periods(1)


def test_two_equipments_on_one_driver_fail_together() -> None:
    m = Plant(timer=timer(), lamp=relay(), level=sensor(), a=reactor(), b=reactor())
    box, own = Scripted(), Scripted()
    entries = {path: {"driver": "own"} for path in ("lamp", "level")}
    with connect(m, wired(m, box, entries=entries, own=own)):
        box.broken = OSError("unplugged")
        for _ in range(2):
            m.timer.read()
            m.sample()
            m.control()
            m.update()
        assert [bool(each.cycle.fault) for each in (m.a, m.b)] == [True, True]
        box.broken = None


# Who is told --------------------------------------------------------------------------------------------


def test_who_awaits_a_sequence_of_equipment_gets_its_error_and_goes_on(rig: Rig) -> None:
    told: list[str] = []

    async def phase() -> None:
        await next_period()
        raise TaskFailed("no feed")

    async def main() -> str:
        try:
            await rig.m.a.cycle.start(phase())
        except TaskFailed as error:
            told.append(str(error))
        return "went on"

    task = rig.m.cycle.start(main())
    rig.periods(5)
    assert (task.done, task.result) == (True, "went on")
    assert "phase failed: no feed" in told[0]
    assert rig.m.a.cycle.fault == "no feed"


def test_who_awaits_another_sequence_of_equipment_gets_its_fault(rig: Rig) -> None:
    told: list[str] = []

    async def main() -> None:
        try:
            await rig.m.a.cycle.start(rig.m.a.heat())
        except TaskFailed as error:
            told.append(str(error))

    rig.m.cycle.start(main())
    rig.periods(2)
    fail_sensor(rig)
    rig.periods(3)
    assert len(told) == 1
    assert "a is in fault" in told[0]
    assert "the wire is broken" in told[0]


def test_what_is_caught_within_the_equipment_is_no_fault(rig: Rig) -> None:
    async def phase() -> None:
        await next_period()
        raise TaskFailed("no feed")

    async def batch() -> str:
        try:
            await rig.m.a.cycle.start(phase())
        except TaskFailed:
            return "without feed"
        return "with feed"

    task = rig.m.a.cycle.start(batch())
    rig.periods(6)
    assert (task.result, rig.m.a.cycle.fault) == ("without feed", None)


def test_a_sequence_of_the_machine_that_somebody_awaits_can_be_caught(rig: Rig) -> None:
    """Findings E.3: it ended the run, against the documents."""

    async def phase() -> None:
        await next_period()
        raise TaskFailed("no feed")

    async def main() -> str:
        try:
            await rig.m.cycle.start(phase())
        except TaskFailed:
            return "caught"
        return "not caught"

    task = rig.m.cycle.start(main())
    rig.periods(5)
    assert task.result == "caught"


def test_a_sequence_of_the_machine_that_nobody_awaits_ends_the_run(rig: Rig) -> None:
    async def phase() -> None:
        raise TaskFailed("no feed")

    async def main() -> None:
        task = rig.m.cycle.start(phase())
        await wait(0.003)
        await task

    rig.m.cycle.start(main())
    with pytest.raises(TaskFailed, match="no feed"):
        rig.periods(4)


def test_an_error_that_nobody_takes_is_no_memory_that_stays(rig: Rig) -> None:
    class Marked:
        pass

    kept: list[weakref.ref[Marked]] = []

    async def phase() -> None:
        local = Marked()
        kept.append(weakref.ref(local))
        raise TaskFailed("no feed")

    gc.disable()
    try:
        for _ in range(3):
            rig.m.a.cycle.start(phase())
            rig.periods(2)
            rig.m.a.cycle.clear()
        assert [each() for each in kept] == [None] * 3
    finally:
        gc.enable()


def test_cleaning_up_that_fails_is_told_and_does_not_end_the_run(rig: Rig) -> None:
    async def untidy() -> None:
        try:
            await wait(1.0)
        finally:
            raise RuntimeError("cannot clean up")

    rig.m.a.cycle.start(untidy())
    rig.periods(1)
    fail_sensor(rig)
    rig.periods(2)
    assert any("while cleaning up: RuntimeError: cannot clean up" in text for text in rig.texts)


def test_what_cleans_up_cannot_drive_the_actuators_of_equipment_in_fault(rig: Rig) -> None:
    taken: list[bool] = []

    async def phase() -> None:
        try:
            await wait(1.0)
        except Cancelled:
            taken.append(rig.m.a.heater.write(9.0))
            raise

    rig.m.a.cycle.start(phase())
    rig.periods(1)
    fail_law(rig)
    rig.periods(2)
    assert taken == [False]
    assert driven(rig.m.a) == AT_DEFAULT


def test_a_write_of_the_machines_own_code_that_fails_at_a_device_is_a_fault_of_its_equipment(rig: Rig) -> None:
    box = rig.boxes["of_a"]
    rig.periods(1)
    box.at(len(box.calls), OSError("short circuit"))
    assert rig.m.a.drain.write(OnOff.ON) is False
    assert "short circuit" in (rig.m.a.cycle.fault or "")


def test_a_fault_while_connecting_is_a_failed_connection() -> None:
    rig = Rig()
    fail_sensor(rig)
    with pytest.raises(DriverError, match="the wire is broken"), rig:
        pass


# Clear ----------------------------------------------------------------------------------------------------


def test_clear_initialises_what_had_failed_and_the_actuators_and_the_equipment_works_again(rig: Rig) -> None:
    run_both(rig)
    fail_sensor(rig)
    rig.periods(2)
    box = rig.boxes["of_a"]
    box.set("a.thermometer", 50)
    rig.periods(1)
    before = len(box.calls)
    assert rig.m.a.cycle.clear() == ["a"]
    initialised = [call.channels[0] for call in box.calls[before:]]
    assert initialised == ["a.heater", "a.stirrer", "a.drain", "a.outlet.coil", "a.thermometer"]
    assert rig.m.a.cycle.fault is None
    task = rig.m.a.cycle.start(rig.m.a.heat(3))
    rig.periods(5)
    assert (task.result, rig.m.a.heater.read()) == ("warm", 5.0)
    assert "a: fault cleared" in rig.texts


def test_clear_is_refused_while_a_sensor_cannot_be_read(rig: Rig) -> None:
    fail_sensor(rig)
    rig.periods(2)
    with pytest.raises(EquipmentFault, match=r"cannot be cleared while a.thermometer cannot be read"):
        rig.m.a.cycle.clear()
    assert "the wire is broken" in (rig.m.a.cycle.fault or "")


def test_clear_fails_while_an_object_cannot_be_initialised(rig: Rig) -> None:
    fail_law(rig)
    rig.periods(1)
    box = rig.boxes["of_a"]
    box.at(len(box.calls) + 1, OSError("short circuit"))
    with pytest.raises(DriverError, match=r"could not be initialised.*short circuit"):
        rig.m.a.cycle.clear()
    assert "the law is broken" in (rig.m.a.cycle.fault or "")
    rig.m.a.law = None
    assert rig.m.a.cycle.clear() == ["a"]


def test_clear_of_a_part_frees_nothing_of_its_neighbour_in_fault(rig: Rig) -> None:
    """The outer equipment is cleared, an inner one stays in fault."""

    class Outlet(Valve, equipment=True):
        pass

    class Double(Reactor, equipment=True):
        other: Outlet

    with Rig(a=reactor(Double, other=Outlet(coil=relay()))) as own:
        m = own.m
        m.a.outlet.cycle.start(failing())
        own.periods(1)
        m.a.cycle.start(failing())
        own.periods(1)
        assert m.a.other.cycle.clear() == ["a"]
        assert (m.a.cycle.fault, m.a.outlet.cycle.fault) == (None, "no feed")
        assert m.a.outlet.coil.write(OnOff.ON) is False
        own.periods(2)
        assert m.a.outlet.coil.read() is OnOff.OFF


def test_clear_clears_nothing_if_one_of_several_cannot_be_cleared(rig: Rig) -> None:
    rig.m.a.cycle.start(failing())
    rig.boxes["of_b"].set("b.thermometer", OSError("the wire is broken"))
    rig.periods(2)
    with pytest.raises(
        EquipmentFault,
        match=r"b is in fault: the fault cannot be cleared while b.thermometer cannot "
        r"be read",
    ):
        rig.m.cycle.clear()
    assert rig.m.a.cycle.fault == "no feed"


def test_clear_clears_the_others_if_one_cannot_be_initialised(rig: Rig) -> None:
    for each in (rig.m.a, rig.m.b):
        each.cycle.start(failing())
    rig.periods(1)
    box = rig.boxes["of_b"]
    box.at(len(box.calls), OSError("short circuit"))
    with pytest.raises(DriverError, match="short circuit"):
        rig.m.cycle.clear()
    assert (rig.m.a.cycle.fault, rig.m.b.cycle.fault) == (None, "no feed")


def test_a_thousand_equipments_may_fail_in_one_period() -> None:
    class Zone(Compound, equipment=True):
        heater: DigitalActuator

        def control(self) -> None:
            raise ValueError("broken")

    class Zones(Compound):
        timer: DigitalSensor
        zones: Sequence[Zone]

    m = Zones(timer=timer(), zones=[Zone(heater=actuator()) for _ in range(1100)])
    with connect(m, wired(m, Scripted())):
        m.timer.read()
        m.control()
        assert all(zone.cycle.fault for zone in m.zones)
        assert len(m.cycle.clear()) == 1100


def test_clear_of_the_machine_clears_all_of_it(rig: Rig) -> None:
    for each in (rig.m.a, rig.m.b):
        each.cycle.start(failing())
    rig.periods(1)
    assert rig.m.cycle.clear() == ["a", "b"]
    assert rig.m.cycle.clear() == []


def test_an_incremental_sensor_that_had_failed_has_lost_its_reference(rig: Rig) -> None:
    with Rig(a=reactor(thermometer=sensor(incremental=True)), b=reactor(stirrer=actuator())) as own:
        own.m.a.thermometer.referenced()
        own.periods(1)
        own.m.a.cycle.start(failing())
        own.periods(1)
        own.m.a.cycle.clear()
        own.periods(1)
        assert value_of(own.m.a.thermometer) == 0.0  # it has not failed
        fail_sensor(own)
        own.periods(1)
        own.boxes["of_a"].set("a.thermometer", 7)
        own.periods(1)
        own.m.a.cycle.clear()
        own.periods(1)
        assert own.m.a.thermometer.quality.name == "UNREFERENCED"


def test_a_program_waits_for_clear_and_begins_again(rig: Rig) -> None:
    async def produce() -> int:
        tries = 0
        while True:
            tries += 1
            try:
                await rig.m.a.cycle.start(rig.m.a.heat(4))
                return tries
            except TaskFailed:
                await until(lambda: rig.m.a.cycle.fault is None)

    task = rig.m.cycle.start(produce())
    rig.periods(2)
    fail_sensor(rig)
    rig.periods(3)
    rig.boxes["of_a"].set("a.thermometer", 50)
    rig.periods(1)
    rig.m.a.cycle.clear()
    rig.periods(8)
    assert (task.done, task.result) == (True, 2)


def test_the_next_connection_begins_without_faults(rig: Rig) -> None:
    m = rig.m
    fail_sequence(rig)
    rig.periods(1)
    assert m.a.cycle.fault
    rig.connection.__exit__(None, None, None)
    rig.connection.__enter__()
    assert m.a.cycle.fault is None
    run_both(rig)

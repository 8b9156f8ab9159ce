"""Equipment: what fails in it stays in it, whoever awaits it is told, and `clear` brings it back."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import pytest

from helpers.letters import Letters
from helpers.machines import actuator, relay, sensor, timer, wired
from umo import (
    BinaryActuator,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Range,
    TaskFailed,
    Vector,
    action,
    connect,
)
from umo.control import ServoAxis, next_period, unless, until, value_of, wait
from umo.cycle.client_commands import ClientCommand, Mode
from umo.cycle.client_control import ClientControl
from umo.cycle.events import CommandState
from umo.cycle.journal import Journal, Kind
from umo.errors import AxisError, Cancelled, DeclarationError, DriverError, EquipmentFault, Interlocked
from umo.objects import atoms
from umo.states import OnOff
from umo.testing import Scripted


class Valve(Compound, equipment=True):
    """Equipment inside equipment."""

    coil: BinaryActuator[OnOff]


class Reactor(Compound, equipment=True, stop_order=("heater", "stirrer")):
    stirrer: DigitalActuator
    heater: DigitalActuator
    thermometer: DigitalSensor
    drain: BinaryActuator[OnOff]
    outlet: Valve

    def setup(self) -> None:
        self.law: Any = None
        self.acted = 0
        self.cleaned = 0

    def control(self) -> None:
        self.acted += 1
        if self.law is not None:
            self.law()

    async def heat(self, periods: int = 1000) -> str:
        try:
            self.heater.write(5.0)
            for _ in range(periods):
                await next_period()
            return "warm"
        finally:
            self.cleaned += 1


class Plant(Compound):
    timer: DigitalSensor
    lamp: BinaryActuator[OnOff]
    level: DigitalSensor
    a: Reactor
    b: Reactor

    def setup(self) -> None:
        self.acted = 0

    def control(self) -> None:
        self.acted += 1


def reactor(kind: type[Reactor] = Reactor, **changes: Any) -> Reactor:
    parts: dict[str, Any] = {
        "stirrer": actuator(),
        "heater": actuator(),
        "thermometer": sensor(),
        "drain": relay(synchronous=False),
        "outlet": Valve(coil=relay()),
    }
    return kind(**(parts | changes))


class Rig:
    """The plant; each reactor on a circuit of its own, the rest on a third."""

    def __init__(self, machine: Any = None, **changes: Any) -> None:
        self.boxes = {name: Scripted() for name in ("box", "of_a", "of_b")}
        parts = {"a": reactor(), "b": reactor()} | changes
        self.m: Any = machine or Plant(timer=timer(), lamp=relay(), level=sensor(), **parts)
        entries = {path: {"driver": f"of_{path[0]}"} for path in _paths(self.m) if path[:2] in ("a.", "b.")}
        drivers = {name: self.boxes[name] for name in ("of_a", "of_b")}
        self.connection = connect(self.m, wired(self.m, self.boxes["box"], entries=entries, **drivers))

    def __enter__(self) -> Rig:
        self.connection.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(*error)

    def periods(self, count: int = 1) -> None:
        for _ in range(count):
            self.m.timer.read()
            self.m.sample()
            self.m.control()
            self.m.update()

    @property
    def texts(self) -> list[str]:
        return [f"{event.path}: {event.text}" for event in self.connection.machine.events]


def _paths(machine: Compound) -> list[str]:
    return [item.path for item in atoms(machine)]


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


def run_both(rig: Rig) -> None:
    """Both reactors are driven."""
    for each in (rig.m.a, rig.m.b):
        each.cycle.start(each.heat())
        each.stirrer.write(2.0)
        each.drain.write(OnOff.ON)
        each.outlet.coil.write(OnOff.ON)
    rig.m.lamp.write(OnOff.ON)
    rig.periods(2)
    assert [driven(each) for each in (rig.m.a, rig.m.b)] == [(2.0, 5.0, OnOff.ON, OnOff.ON)] * 2


def driven(each: Reactor) -> tuple[Any, ...]:
    return each.stirrer.read(), each.heater.read(), each.drain.read(), each.outlet.coil.read()


AT_DEFAULT = (0.0, 0.0, OnOff.OFF, OnOff.OFF)
DRIVEN = (2.0, 5.0, OnOff.ON, OnOff.ON)


def fail_law(rig: Rig) -> None:
    def broken() -> None:
        raise ValueError("the law is broken")

    rig.m.a.law = broken


def fail_sensor(rig: Rig) -> None:
    rig.boxes["of_a"].set("a.thermometer", OSError("the wire is broken"))


def fail_actuator(rig: Rig) -> None:
    box = rig.boxes["of_a"]
    box.at(len(box.calls) + 1, OSError("short circuit"))  # after read_many, write_many


def fail_sequence(rig: Rig) -> None:
    async def phase() -> None:
        raise TaskFailed("no feed")

    rig.m.a.cycle.start(phase())


FAILURES = [fail_law, fail_sensor, fail_actuator, fail_sequence]
REASONS = ["the law is broken", "the wire is broken", "short circuit", "no feed"]


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
    assert any("not brought to their defaults yet" in text for text in rig.texts)
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
    assert any("in its cleaning up: RuntimeError: cannot clean up" in text for text in rig.texts)


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
    with pytest.raises(EquipmentFault, match=r"b is in fault: it cannot be cleared while b.thermometer cannot be read"):
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


async def failing() -> None:
    raise TaskFailed("no feed")


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


# Clients --------------------------------------------------------------------------------------------------


class Commanded(Rig):
    """With a client that has the lease."""

    def __init__(self, mode: Mode = Mode.AUTOMATIC, **changes: Any) -> None:
        super().__init__(**changes)
        self.letters, self.mode, self.number = Letters(), mode, 0
        self.now = 1.0
        """The clock of the signs of life, s."""

    def __enter__(self) -> Commanded:
        super().__enter__()
        machine = self.connection.machine
        machine.clients = ClientControl(machine, self.letters, self.letters, self.mode, lambda: self.now)
        self.do("lease")
        return self

    def do(self, do: str, path: str = "", **more: Any) -> tuple[str, str]:
        """Send it, and let a period pass; its last answer."""
        self.number += 1
        self.letters.signs = dict.fromkeys(("", path), (1, 1.0))
        self.letters.waiting.append(ClientCommand(self.number, "ann", "key", do, path, **more))
        self.periods()
        return self.answer(self.number)

    def answer(self, number: int) -> tuple[str, str]:
        events = self.connection.machine.events
        return next((str(each.state), each.text) for each in reversed(events) if each.command == number)


class Operated(Reactor, equipment=True):
    @action
    async def drain_it(self) -> None:
        """Drain."""
        self.drain.write(OnOff.ON)
        await wait(1.0)

    @action(harmless=True)
    def count(self) -> int:
        """Periods."""
        return self.acted

    @action(harmless=True)
    async def measure(self) -> float:
        """Temperature after a while."""
        await wait(1.0)
        return self.thermometer.read()


def test_a_client_clears_a_fault_in_automatic_mode() -> None:
    with Commanded() as rig:
        rig.m.a.cycle.start(failing())
        rig.periods(1)
        assert rig.do("clear", "a.heater") == ("done", '"cleared: a"')
        assert rig.m.a.cycle.fault is None
        assert rig.do("clear") == ("done", '"nothing was in fault"')


class Hot(Reactor, equipment=True):
    """Its heater latches, its stirrer waits."""

    hot = waits = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.hot, [self.heater], "over-temperature", latched=True)
        yield Interlock(lambda: self.waits, [self.stirrer, self.heater], "the lid is open")


def test_a_client_that_clears_a_fault_is_told_which_interlocks_still_inhibit_its_actuators() -> None:
    with Commanded(a=reactor(Hot), b=reactor(Hot)) as rig:
        a, b = rig.m.a, rig.m.b
        a.cycle.start(failing())
        a.hot, a.waits, b.waits = True, True, True
        rig.periods(2)
        still = "cleared: a; still inhibited: over-temperature"
        assert rig.do("clear", "a.drain") == ("done", f'"{still}; the lid is open"')
        a.hot, a.waits = False, False
        a.cycle.start(failing())
        rig.periods(2)
        assert rig.do("clear") == ("done", f'"{still} (latched: to be acknowledged)"')
        assert rig.do("clear", "a.drain") == ("done", '"nothing was in fault"')
        assert rig.do("clear", "b") == ("done", '"nothing was in fault; still inhibited: the lid is open"')
        rig.do("acknowledge", "a")
        a.cycle.start(failing())
        rig.periods(2)
        assert rig.do("clear", "a") == ("done", '"cleared: a"')


def test_an_interlock_that_begins_in_a_fault_is_told_when_the_fault_ends_if_it_still_inhibits() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a, journal = rig.m.a, Journal(100)
        a.cycle.start(failing())
        rig.periods(1)
        a.hot = a.waits = True
        rig.periods(1)
        a.waits = False
        rig.periods(1)
        a.hot = False
        rig.periods(1)
        assert [text for text in rig.texts if "inhibited" in text] == []
        rig.connection.image.transfer.journal = journal
        noted: list[tuple[int, Kind]] = []
        journal.add = lambda slot, kind, *_: noted.append((slot, kind))  # type: ignore[method-assign]
        a.cycle.clear()
        told = "a.heater: inhibited: over-temperature (latched: to be acknowledged)"
        assert rig.texts[-2:] == [told, "a: fault cleared"]
        assert (a.heater._slot, Kind.INTERLOCKED) in noted
        assert (a.stirrer._slot, Kind.INTERLOCKED) not in noted
        a.cycle.start(failing())
        rig.periods(2)
        a.cycle.clear()
        assert rig.texts.count(told) == 1


def test_a_latched_interlock_whose_condition_is_still_true_when_the_fault_ends_is_to_be_acknowledged() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a = rig.m.a
        a.cycle.start(failing())
        rig.periods(1)
        a.hot = True
        rig.periods(1)
        a.cycle.clear()
        rig.periods(2)
        assert [text for text in rig.texts if "inhibited" in text] == [
            "a.heater: inhibited until acknowledged: over-temperature"
        ]


def test_an_interlock_that_began_before_the_fault_is_told_once() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a = rig.m.a
        a.waits = True
        rig.periods(1)
        a.cycle.start(failing())
        rig.periods(2)
        a.cycle.clear()
        rig.periods(2)
        assert len([text for text in rig.texts if "the lid is open" in text]) == 2  # two actuators


class Strict(Reactor, equipment=True):
    """To write its heater while it is hot is a program error."""

    hot = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.hot, [self.heater], "too hot", effect="stop")


def test_a_write_in_a_fault_is_refused_and_raises_nothing_whatever_interlock_inhibits_as_well() -> None:
    with Rig(a=reactor(Strict), b=reactor(Strict)) as rig:
        a, b = rig.m.a, rig.m.b
        both = Vector([a.heater, b.heater])
        a.cycle.start(failing())
        a.hot = True
        rig.periods(2)
        assert a.heater.write(1.0) is False
        assert both.write([1.0, 2.0]) is False
        rig.periods(1)
        assert both.read().tolist() == [0.0, 2.0]
        a.cycle.clear()
        with pytest.raises(Interlocked, match="too hot"):
            a.heater.write(1.0)


def test_a_client_is_told_why_a_fault_cannot_be_cleared() -> None:
    with Commanded() as rig:
        fail_sensor(rig)
        rig.periods(1)
        state, text = rig.do("clear", "a")
        assert state == "refused"
        assert text == "EquipmentFault: a is in fault: it cannot be cleared while a.thermometer cannot be read"


def test_an_action_of_equipment_that_comes_into_fault_ends_and_another_is_refused() -> None:
    with Commanded(Mode.MANUAL, a=reactor(Operated)) as rig:
        assert rig.do("call", "a.drain_it")[0] == "begun"
        number = rig.number
        rig.periods(2)
        assert rig.m.a.drain.read() is OnOff.ON
        fail_sensor(rig)
        rig.periods(2)
        state, text = rig.answer(number)
        assert (state, "a is in fault" in text, rig.m.a.drain.read()) == ("cancelled", True, OnOff.OFF)
        assert rig.do("call", "a.drain_it")[0] == "refused"
        assert rig.do("call", "a.count")[0] == "done"
        assert rig.do("call", "a.measure") == ("refused", f"EquipmentFault: a is in fault: {rig.m.a.cycle.fault}")


def test_a_sequence_that_an_action_of_another_part_has_started_in_equipment_ends_with_its_fault() -> None:
    class Both(Plant):
        @action
        def start_both(self) -> None:
            """Heat."""
            for each in (self.a, self.b):
                each.cycle.start(each.heat())

    m = Both(timer=timer(), lamp=relay(), level=sensor(), a=reactor(), b=reactor())
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", "start_both")
        rig.periods(3)
        assert (m.a.heater.read(), m.b.heater.read()) == (5.0, 5.0)
        fail_sensor(rig)
        rig.periods(3)
        assert (m.a.heater.read(), m.a.cleaned, m.b.heater.read(), m.b.cleaned) == (0.0, 1, 5.0, 0)


def test_a_clients_write_that_a_device_refuses_is_refused_and_a_fault_of_its_equipment() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("short circuit"))  # after read_many
        state, text = rig.do("write", "a.drain", value="ON")
        assert (state, text) == ("refused", "CommandRefused: a.drain is inhibited: a is in fault")
        rig.periods(3)
        assert rig.answer(rig.number) == (state, text)  # and nothing else later
        assert "short circuit" in (rig.m.a.cycle.fault or "")


class Cooking(Reactor, equipment=True):
    @action
    async def cook(self) -> None:
        """Drive the heater, and a valve."""
        while True:
            self.heater.write(5.0)
            self.drain.write(OnOff.ON)
            await next_period()

    @action
    async def heat_it(self) -> None:
        """Heat."""
        await self.heat()

    @action
    def begin(self) -> None:
        """Heat in a sequence that nobody awaits; then drive a valve."""
        self.cycle.start(self.heat())
        self.drain.write(OnOff.ON)

    @action(velocity=Range("rpm", 0.0, 9.0), release="let_go")
    def stir(self, velocity: float) -> None:
        """Stir."""
        self.stirrer.write(velocity)

    def let_go(self) -> None:
        self.stirrer.write(0.0)

    async def on_resume(self) -> None:
        for _ in range(20):
            self.heater.write(3.0)
            await next_period()


@pytest.mark.parametrize("name", ["cook", "begin"])
def test_an_action_whose_own_write_puts_its_equipment_in_fault_has_ended_also_after_clear(name: str) -> None:
    with Commanded(Mode.MANUAL, a=reactor(Cooking)) as rig:
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 1, OSError("the coil is broken"))  # after read_many
        rig.do("call", f"a.{name}")
        rig.periods(2)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        told = [each for each in rig.connection.machine.events if each.command == rig.number]
        assert str(told[-1].state) in ("refused", "cancelled")
        rig.do("clear", "a")
        rig.periods(3)
        assert driven(rig.m.a) == AT_DEFAULT


def test_what_a_client_keeps_up_in_equipment_ends_with_its_fault() -> None:
    with Commanded(Mode.MANUAL, a=reactor(Cooking)) as rig:
        assert rig.do("call", "a.stir", arguments={"velocity": 2.0})[0] == "done"
        number = rig.number
        fail_sensor(rig)
        rig.periods(2)
        assert rig.answer(number)[0] == "cancelled"
        assert "a is in fault" in rig.answer(number)[1]


class Watched(Plant):
    @action
    async def watch(self) -> None:
        """Open the drain of a at the end."""
        try:
            await wait(10.0)
        finally:
            self.a.drain.write(OnOff.ON)


@pytest.mark.parametrize("end", ["give back", "cancel", "mode"])
@pytest.mark.parametrize(
    ("other", "arguments"), [("heat_it", {}), ("stir", {"velocity": 2.0})], ids=["running", "held"]
)
def test_an_action_that_a_fault_has_ended_while_others_are_cancelled_is_ended_once(
    end: str, other: str, arguments: dict[str, Any]
) -> None:
    m = Watched(timer=timer(), lamp=relay(), level=sensor(), a=reactor(Cooking), b=reactor())
    with Commanded(Mode.MANUAL, machine=m) as rig:
        box = rig.boxes["of_a"]
        rig.do("call", "watch")
        assert rig.do("call", f"a.{other}", arguments=arguments)[0] in ("begun", "done")
        number = rig.number
        rig.periods(2)
        box.at(len(box.calls) + 1, OSError("the coil is broken"))  # after read_many
        assert rig.do(end, value="automatic" if end == "mode" else None)[0] == "done"
        assert "the coil is broken" in (m.a.cycle.fault or "")
        ends = [event for event in rig.connection.machine.events if event.command == number and "fault" in event.text]
        assert [str(event.state) for event in ends] == ["cancelled"]
        rig.periods(2)
        assert driven(m.a) == AT_DEFAULT


class Drained(Reactor, equipment=True):
    @action(release="rest")
    def open_it(self) -> None:
        """Open something."""

    @action(release="rest")
    def open_more(self) -> None:
        """Open something else."""

    def rest(self) -> None:
        self.drain.write(OnOff.ON)


@pytest.mark.parametrize("signs", [{}, {"": (1, 9.0)}], ids=["the lease ends", "only what is held ends"])
def test_a_client_that_dies_holding_two_actions_ends_each_once_if_the_first_release_fails(
    signs: dict[str, tuple[int, float]],
) -> None:
    with Commanded(Mode.MANUAL, a=reactor(Drained)) as rig:
        rig.do("call", "a.open_it")
        rig.do("call", "a.open_more")
        rig.now, rig.letters.signs = 9.0, signs
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("the coil is broken"))  # after read_many
        rig.periods(3)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        events = rig.connection.machine.events
        ended = [event.path for event in events if event.state is CommandState.CANCELLED]
        assert sorted(ended) == ["a.open_it", "a.open_more"]
        assert not [event.text for event in events if "could not be released" in event.text]
        assert driven(rig.m.a) == AT_DEFAULT
        assert rig.m.b.acted == rig.m.a.acted + 3  # it goes on


class FlushedValve(Valve, equipment=True):
    def setup(self) -> None:
        self.at_end = lambda: None

    @action
    async def watch(self) -> None:
        """Do something at the end."""
        try:
            await wait(10.0)
        finally:
            self.at_end()

    @action
    async def turn(self) -> None:
        """Wait."""
        await wait(10.0)


def test_a_fault_of_the_outer_equipment_while_the_actions_of_the_inner_end_ends_each_once() -> None:
    with Commanded(Mode.MANUAL, a=reactor(outlet=FlushedValve(coil=relay()))) as rig:
        a: Any = rig.m.a
        a.outlet.at_end = lambda: a.drain.write(OnOff.ON)
        rig.do("call", "a.outlet.watch")
        rig.do("call", "a.outlet.turn")
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("the coil is broken"))
        assert rig.connection.machine.fail(a.outlet, ValueError("it is stuck"))
        assert "it is stuck" in a.outlet.cycle.fault
        rig.periods(2)
        assert (a.outlet.cycle.fault, a.cycle.fault is not None) == ("ValueError: it is stuck", True)
        ended = [each.path for each in rig.connection.machine.events if each.state is CommandState.CANCELLED]
        assert sorted(ended) == ["a.outlet.turn", "a.outlet.watch"]


def test_on_resume_of_equipment_that_comes_into_fault_has_ended_also_after_clear() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Cooking)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        rig.do("mode", value="automatic")
        rig.periods(3)
        assert rig.m.a.heater.read() == 3.0
        fail_law(rig)
        rig.periods(1)
        rig.m.a.law = None
        assert rig.do("clear", "a")[0] == "done"
        rig.periods(3)
        assert rig.m.a.heater.read() == 0.0


def test_an_on_resume_of_equipment_that_fails_is_a_fault_of_it_and_the_others_go_on() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Cooking)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 3, OSError("the coil is broken"))  # a write of on_resume
        rig.do("mode", value="automatic")
        rig.periods(25)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        assert (rig.answer(rig.number)[0], rig.m.b.cycle.fault) == ("done", None)


class Refusing(Cooking):
    """Its `on_resume` raises."""

    async def on_resume(self) -> None:
        raise TaskFailed("the door is open")


def test_an_on_resume_of_equipment_that_raises_is_a_fault_of_it_and_the_others_go_on() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Refusing)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        rig.do("mode", value="automatic")
        rig.periods(3)
        assert rig.m.a.cycle.fault == "the door is open"
        assert (rig.answer(rig.number)[0], rig.m.b.cycle.fault) == ("done", None)
        assert rig.m.b.heater.read() == 5.0


def test_a_lease_that_ends_after_a_fault_frees_nothing_of_it() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.do("write", "a.heater", value=5.0)
        fail_law(rig)
        rig.periods(1)
        rig.do("give back")
        rig.periods(2)
        assert (rig.m.a.heater.write(5.0), rig.m.a.heater.inhibited) == (False, "a is in fault")


def test_a_write_that_fails_and_a_release_in_the_same_period_free_nothing_of_the_fault() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.do("write", "a.heater", value=5.0)
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 1, OSError("the coil is broken"))
        rig.letters.waiting.append(ClientCommand(90, "ann", "key", "write", "a.drain", "ON"))
        rig.letters.waiting.append(ClientCommand(91, "ann", "key", "let go", "a.heater"))
        rig.letters.signs = dict.fromkeys(("", "a.drain", "a.heater"), (1, 1.0))
        rig.periods(2)
        assert rig.m.a.cycle.fault is not None
        assert rig.m.a.heater.write(5.0) is False


def test_an_actuator_that_is_taken_and_released_many_times_is_free_for_the_program() -> None:
    with Commanded(Mode.MANUAL) as rig:
        for _ in range(3):
            rig.do("write", "a.heater", value=5.0)
            rig.do("let go", "a.heater")
        assert rig.m.a.heater.write(1.0)
        rig.periods(1)
        assert rig.m.a.heater.read() == 1.0


def test_what_a_client_holds_ends_with_a_fault_and_says_why() -> None:
    with Commanded(Mode.MANUAL) as rig:
        assert rig.do("write", "a.stirrer", value=3.0)[0] == "done"
        number = rig.number
        rig.periods(1)
        assert rig.m.a.stirrer.read() == 3.0
        fail_sensor(rig)
        rig.periods(2)
        assert (rig.answer(number), rig.m.a.stirrer.read()) == (("cancelled", "a is in fault"), 0.0)
        assert rig.do("write", "a.stirrer", value=3.0) == (
            "refused",
            "CommandRefused: a.stirrer is inhibited: a is in fault",
        )


class Slide(Compound):
    timer: DigitalSensor
    x: ServoAxis


def slide(kind: type[ServoAxis] = ServoAxis, **changes: Any) -> Slide:
    """Its motor moves nothing."""
    limits = {"velocity": 50.0, "acceleration": 500.0, "jerk": 1e4, "window": 1.0, "following_error": 0.5}
    axis = kind(motor=actuator(), encoder=sensor(minimum=-100.0), gain=0.1, **(limits | changes))
    return Slide(timer=timer(), x=axis)


def test_an_axis_that_does_not_follow_in_manual_mode_is_in_fault_alone() -> None:
    m = slide()
    with Commanded(Mode.MANUAL, machine=m) as rig:
        assert rig.do("call", "x.move_to", arguments={"position": 40.0})[0] == "begun"
        number = rig.number
        rig.periods(100)
        assert "x does not follow" in (m.x.cycle.fault or "")
        assert rig.answer(number)[0] in ("failed", "cancelled")
        assert "x is in fault: x does not follow" in rig.answer(number)[1]
        assert rig.do("call", "x.jog", arguments={"velocity": 5.0})[0] == "refused"
        assert rig.do("clear", "x")[1] == '"cleared: x"'
        assert rig.do("call", "x.move_to", arguments={"position": 0.0})[0] == "begun"


def test_an_axis_in_fault_that_refuses_a_motion_leaves_nothing_that_only_the_collector_would_free() -> None:
    class Alone(ServoAxis, equipment=True): ...

    m, refused = slide(Alone), []

    async def move() -> None:
        while True:
            try:
                await m.x.move_to(40.0)
            except EquipmentFault as error:
                refused.append(weakref.ref(error))
            await next_period()

    with Commanded(machine=m) as rig:
        rig.connection.machine.fail(m.x, ValueError("it is stuck"))
        m.cycle.start(move())
        gc.disable()
        try:
            rig.periods(3)
            assert [each() for each in refused] == [None] * 3
        finally:
            gc.enable()


class Braked(ServoAxis):
    """An axis of a machine, whose brake does not answer."""

    def disable(self) -> None:
        if self.enabled and self.cycle.running:
            raise ValueError("the brake did not answer")


@pytest.mark.parametrize("motion", ["jog", "move_to"])
def test_an_axis_in_fault_that_cannot_be_disabled_is_not_controlled_after_clear(motion: str) -> None:
    m = slide(Braked)
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", f"x.{motion}", arguments={"jog": {"velocity": 5.0}, "move_to": {"position": 40.0}}[motion])
        rig.periods(1)
        assert m.x.enabled
        rig.connection.machine.fail(m.x, ValueError("it is stuck"))
        assert any("the brake did not answer" in text for text in rig.texts)
        assert (m.x.enabled, m.x.motor.read()) == (False, 0.0)
        rig.do("clear", "x")
        rig.periods(3)
        assert (m.x.cycle.fault, m.x.enabled, m.x.motor.read()) == (None, False, 0.0)
        assert rig.do("call", "x.move_to", arguments={"position": 0.0})[0] == "begun"


def test_automatic_mode_is_refused_while_an_axis_is_in_fault() -> None:
    m = slide()
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", "x.move_to", arguments={"position": 40.0})
        rig.periods(100)
        state, text = rig.do("mode", value="automatic")
        assert state == "refused"
        assert "the application cannot go on: x is in fault: x does not follow" in text
        rig.do("clear", "x")
        assert rig.do("mode", value="automatic")[0] == "done"


def test_what_ended_by_a_fault_in_manual_mode_is_not_driven_again_in_automatic_mode() -> None:
    with Commanded(Mode.AUTOMATIC) as rig:
        run_both(rig)
        rig.do("mode", value="manual")
        rig.periods(2)
        assert [driven(each) for each in (rig.m.a, rig.m.b)] == [AT_DEFAULT] * 2
        fail_sensor(rig)
        rig.periods(2)
        rig.boxes["of_a"].set("a.thermometer", 50)
        rig.periods(1)
        rig.do("clear", "a")
        assert rig.do("mode", value="automatic")[0] == "done"
        rig.periods(3)
        assert (driven(rig.m.a), driven(rig.m.b)) == (AT_DEFAULT, DRIVEN)


def test_a_fault_in_the_period_of_a_change_to_manual_mode_keeps_its_laws_from_acting() -> None:
    with Commanded(Mode.AUTOMATIC) as rig:
        run_both(rig)
        fail_law(rig)
        rig.do("mode", value="manual")
        acted, others = rig.m.a.acted, rig.m.b.acted
        rig.periods(3)
        assert (rig.m.a.acted, rig.m.b.acted) == (acted, others + 3)
        assert driven(rig.m.a) == AT_DEFAULT


def test_an_axis_that_does_not_follow_in_automatic_mode_ends_the_run() -> None:
    m = slide()
    with pytest.raises(AxisError, match="does not follow"), Commanded(Mode.AUTOMATIC, machine=m) as rig:
        m.cycle.start(m.x.move_to(40.0))
        rig.periods(100)


def test_an_axis_that_its_machine_declares_equipment_fails_alone_in_automatic_mode_too() -> None:
    class Table(ServoAxis, equipment=True):
        pass

    told: list[str] = []

    async def main(m: Slide) -> str:
        try:
            await m.x.move_to(40.0)
        except TaskFailed as error:
            told.append(f"{type(error).__name__}: {error}")
        m.x.cycle.clear()
        await m.x.move_to(0.0)  # where it stands
        return "went on"

    m = slide(Table)
    with Commanded(machine=m) as rig:
        task = m.cycle.start(main(m))
        rig.periods(150)
    assert len(told) == 1
    assert told[0].startswith("EquipmentFault: x is in fault: x does not follow")
    assert task.result == "went on"


def test_a_motion_that_does_not_arrive_is_a_fault_of_its_axis() -> None:
    class Table(ServoAxis, equipment=True):
        pass

    m = slide(Table, following_error=1e9, settling_time=0.05)
    with Commanded(machine=m) as rig:
        m.cycle.start(catching(m.x.move_to(0.5, duration=0.0)))
        m.x.window = 0.1
        rig.periods(1200)
        assert "did not arrive" in (m.x.cycle.fault or "")
        assert not m.x.enabled


async def catching(motion: Any) -> None:
    with suppress(TaskFailed):
        await motion


# Declaration ----------------------------------------------------------------------------------------------


def test_a_value_of_equipment_that_there_is_not_is_a_mistake() -> None:
    with pytest.raises(DeclarationError, match=r'equipment is True, False or "manual", not'):

        class Wrong(Compound, equipment="sometimes"):  # type: ignore[arg-type]
            pass


def test_the_machine_is_equipment_without_saying_so() -> None:
    class Sole(Compound, equipment=True):
        timer: DigitalSensor
        level: DigitalSensor

    m, box = Sole(timer=timer(), level=sensor()), Scripted()
    with pytest.raises(DriverError), connect(m, wired(m, box)):
        box.set("level", OSError("gone"))
        m.timer.read()
        m.sample()


class Local:
    """Something whose life can be observed."""


def test_a_failure_whose_awaiter_is_cancelled_in_the_same_period_is_a_fault_and_keeps_nothing_alive() -> None:
    alive: weakref.WeakSet[Local] = weakref.WeakSet()

    async def failing() -> None:
        local = Local()
        alive.add(local)
        await next_period()
        raise TaskFailed(f"the valve of {type(local).__name__} sticks")

    async def parent(part: Reactor) -> None:
        task = part.cycle.start(failing())

        async def waiting() -> None:
            await task

        asked = iter(range(3))
        await unless(lambda: next(asked, None) is None, waiting())

    gc.disable()
    try:
        with Rig() as rig:
            rig.m.a.cycle.start(parent(rig.m.a))
            rig.periods(9)
            assert rig.texts == ["a: in fault: the valve of Local sticks"]
            assert not alive
    finally:
        gc.enable()

"""The command stage, in virtual time: expiring commands, limits of the rate, interlocks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import umo
from helpers.machines import actuator, bench, failed, relay, sensor, switch, timer, wired
from helpers.telling import concerned
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Vector, connect
from umo.control import Servo, state_of
from umo.cycle.inhibition import Inhibition
from umo.cycle.journal import ENTRY, Journal, Kind
from umo.errors import DeclarationError, DriverError, Interlocked, WiringError
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods, put

PERIOD = 0.001


class Press(Compound):
    """A ram that must not move while the guard door's switch fails, a heater, a lamp."""

    timer: DigitalSensor
    door: BinarySensor[PassFail]
    height: DigitalSensor
    ram: DigitalActuator
    lamp: BinaryActuator[OnOff]
    heater: DigitalActuator

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.ram, self.lamp], "the door is open")
        yield Interlock(lambda: self.height.read() > 90.0, [self.ram], "the ram is at its end")


def press(**changes: Any) -> Press:
    parts: dict[str, Any] = {"ram": actuator(), "lamp": relay(), "heater": actuator()} | changes
    return Press(timer=timer(), door=switch(), height=sensor(), **parts)


class Own(Press):
    """A press with interlocks of a test's own, made from the press itself."""

    declare: Callable[[Press], Iterable[Interlock]]

    def interlocks(self) -> Iterable[Interlock]:
        return self.declare(self)


def own(declare: Callable[[Press], Iterable[Interlock]], **changes: Any) -> Own:
    parts: dict[str, Any] = {"ram": actuator(), "lamp": relay(), "heater": actuator()} | changes
    return Own(timer=timer(), door=switch(), height=sensor(), declare=declare, **parts)


def is_open(m: Press) -> Callable[[], bool]:
    return lambda: m.door.read() is PassFail.FAIL


def begin(m: Press) -> None:
    """The timer and the sample of a period."""
    m.timer.read()
    m.sample()


def wiring(box: Scripted | None = None, missed: list[int] | None = None) -> dict[str, Any]:
    names = ("door", "height", "ram", "lamp", "heater")
    return {
        "drivers": {"box": box or Scripted(), "clock": VirtualTimer(missed or ())},
        "wire": {"timer": {"driver": "clock", "period": PERIOD}, **{name: {"driver": "box"} for name in names}},
    }


# Commands that expire -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_what_is_not_written_any_more_goes_to_its_default_once(synchronous: bool) -> None:
    m = press(heater=actuator(expires="5 ms", synchronous=synchronous))
    connection = connect(m, wiring())
    with connection:
        periods(m)
        m.heater.write(4.0)
        periods(m, 4)
        assert m.heater.read() == 4.0
        periods(m)
        assert m.heater.read() == 0.0
        periods(m, 20)
        (event,) = connection.machine.events
        assert (event.path, round(event.time, 6)) == ("heater", 0.006)
        assert "not written for 0.005 s" in event.text


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_nothing_is_told_of_a_default_that_is_not_written_again(synchronous: bool) -> None:
    m = press(heater=actuator(expires="5 ms", synchronous=synchronous))
    connection = connect(m, wiring())
    with connection:
        m.heater.write(4.0)
        periods(m)
        m.heater.write(0.0)
        periods(m, 20)
        assert (m.heater.read(), list(connection.machine.events)) == (0.0, [])


def test_commands_that_expire_together_do_so_in_the_order_declared() -> None:
    m = press(ram=actuator(expires="2 ms", synchronous=False), lamp=relay(expires="2 ms"))
    connection = connect(m, wiring())
    with connection:
        m.lamp.write(OnOff.ON)
        m.ram.write(1.0)
        periods(m, 2)
        assert concerned(connection.machine.events) == ["ram", "lamp"]


def test_what_expires_is_the_default_itself_whatever_a_subclass_writes() -> None:
    class Offset(DigitalActuator):
        def write(self, value: float) -> bool:
            return super().write(value + 1.0)

    m = press(heater=Offset("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.5, expires="3 ms"))
    with connect(m, wiring()):
        m.heater.write(4.0)
        periods(m, 3)
        assert m.heater.read() == 0.0


def test_a_default_that_cannot_be_sent_when_a_command_expires_comes_out_once() -> None:
    box = Scripted()
    m = press(lamp=relay(expires="2 ms", synchronous=False), heater=actuator(expires="2 ms", synchronous=False))
    with connect(m, wiring(box)):
        m.lamp.write(OnOff.ON)
        m.heater.write(3.0)
        periods(m)
        m.timer.read()
        box.at(len(box.calls) + 1, OSError("stuck"))
        with pytest.raises(DriverError) as caught:
            m.sample()
        assert failed(caught.value) == ["lamp"]
        assert (m.lamp.read(), m.heater.read()) == (OnOff.ON, 0.0)
        periods(m, 5)


@pytest.mark.parametrize("expires", [0.001, 0.0005])
def test_a_command_that_would_expire_before_it_can_be_written_again_is_a_fault_of_the_period(expires: float) -> None:
    m = press(heater=actuator(expires=expires))
    with pytest.raises(WiringError, match="1 ms is not shorter than `expires` of heater"):
        connect(m, wiring()).__enter__()


def test_without_a_timer_a_command_expires_by_the_wall_clock() -> None:
    class Bare(Compound):
        heater: DigitalActuator

    m = Bare(heater=actuator(expires=1e-9))
    with connect(m, {"drivers": {"box": Scripted()}, "wire": {"heater": {"driver": "box"}}}):
        m.heater.write(3.0)
        for _ in range(100):  # each takes longer than a nanosecond
            m.sample()
        assert m.heater.pending == 0.0


# Rates --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
def test_what_is_sent_moves_no_faster_than_the_rate() -> None:
    m = press(ram=actuator(slew_rate=1000.0, resolution=0.001))
    with connect(m, wiring()):
        m.ram.write(2.5)
        assert m.ram.pending == 2.5
        seen = []
        for _ in range(4):
            periods(m)
            seen.append(m.ram.read())
            assert m.ram.pending == 2.5
        assert seen == pytest.approx([1.0, 2.0, 2.5, 2.5])
        assert (m.ram.pending, m.ram.raw) == (2.5, 2500)


def test_write_judges_the_target_not_the_step() -> None:
    m = press(ram=actuator(slew_rate=1.0), heater=actuator(slew_rate=1.0, limits="clamp"))
    with connect(m, wiring()):
        with pytest.raises(umo.errors.RangeError):
            m.ram.write(11.0)
        assert m.heater.write(11.0) is False
        assert m.heater.pending == 10.0
        assert m.heater.write(float(9)) is True


def test_the_target_is_reached_when_distance_and_rate_say() -> None:
    m = press(ram=actuator(slew_rate=100.0))
    with connect(m, wiring()):
        m.ram.write(1.0)
        periods(m, 10)  # ten times 0.1 is less than 1.0
        assert m.ram.read() == 1.0


# Interlocks ---------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
def test_an_inhibited_write_is_refused_without_an_exception_and_changes_nothing() -> None:
    m = press()
    with connect(m, wiring()):
        assert (m.ram.inhibited, m.lamp.inhibited, m.heater.inhibited) == (None, None, None)
        put(m.door, PassFail.FAIL)
        periods(m)
        assert (m.ram.write(3.0), m.lamp.write(OnOff.ON)) == (False, False)
        assert (m.ram.pending, m.lamp.pending) == (0.0, OnOff.OFF)
        assert m.ram.inhibited == m.lamp.inhibited == "the door is open"
        assert m.heater.inhibited is None  # not named
        assert m.heater.write(3.0) is True
        periods(m)
        assert (m.ram.read(), m.heater.read()) == (0.0, 3.0)


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_the_default_itself_may_be_written_while_inhibited(synchronous: bool) -> None:
    m = press(ram=actuator(default=2.0, synchronous=synchronous), lamp=relay(default=OnOff.ON))
    with connect(m, wiring(Scripted({"door": 1}))):
        assert (m.ram.write(2.0), m.ram.write(0.0)) == (True, False)
        assert (m.lamp.write(OnOff.ON), m.lamp.write(OnOff.OFF)) == (True, False)
        periods(m)
        assert (m.ram.read(), m.lamp.read()) == (2.0, OnOff.ON)


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("synchronous", [True, False])
def test_when_the_condition_has_gone_a_new_write_takes_effect_and_no_old_one(synchronous: bool) -> None:
    box, m = Scripted(), press(ram=actuator(synchronous=synchronous))
    with connect(m, wiring(box)):
        m.ram.write(3.0)
        periods(m)
        put(m.door, PassFail.FAIL)
        periods(m)
        m.ram.write(4.0)
        put(m.door, PassFail.PASS)
        periods(m, 3)
        assert (m.ram.inhibited, m.ram.read(), box.get("ram")) == (None, 0.0, 0)
        assert m.ram.write(5.0) is True
        periods(m)
        assert (m.ram.read(), box.get("ram")) == (5.0, 10)


def test_values_that_make_no_sense_raise_from_write_also_while_inhibited() -> None:
    m = own(lambda m: [Interlock(is_open(m), [m.ram, m.lamp, m.heater], "open")], heater=actuator(limits="clamp"))
    with connect(m, wiring(Scripted({"door": 1}))):
        for value in (11.0, float("nan"), float("inf"), True, "1"):
            with pytest.raises(umo.errors.RangeError):
                m.ram.write(value)  # type: ignore[arg-type]
        with pytest.raises(umo.errors.StateError):
            m.lamp.write(PassFail.PASS)  # type: ignore[arg-type]
        assert m.heater.write(11.0) is False
        periods(m)
        assert m.heater.read() == 0.0


def test_an_interlock_that_begins_to_hold_resets_what_it_names_at_once_and_is_recorded_once() -> None:
    box, m = Scripted(), press()
    connection = connect(m, wiring(box))
    with connection:
        m.ram.write(3.0)
        m.lamp.write(OnOff.ON)
        m.heater.write(4.0)
        periods(m, 3)
        put(m.door, PassFail.FAIL)
        before = len(box.calls)
        begin(m)
        assert [call.channels for call in box.calls[before:] if call.segment == "reset"] == [("ram",), ("lamp",)]
        assert (m.ram.read(), m.lamp.read(), m.heater.read()) == (0.0, OnOff.OFF, 4.0)
        for _ in range(5):
            m.ram.write(3.0)
            periods(m)
        events = [(event.path, event.text) for event in connection.machine.events]
        assert events == [("", "the door is open: 2 actuators inhibited: ram and lamp")]
        assert len(box.segments("reset")) == 2
        put(m.door, PassFail.PASS)
        periods(m)
        put(m.door, PassFail.FAIL)
        periods(m)
        assert len(connection.machine.events) == 2  # it has begun again


@pytest.mark.parametrize(("latched", "logged"), [(False, 3), (True, 5)])
def test_an_interlock_that_begins_often_is_logged_three_times_and_is_an_event_each_time(
    caplog: pytest.LogCaptureFixture, latched: bool, logged: int
) -> None:
    m = own(lambda m: [Interlock(is_open(m), [m.ram], "no part", latched=latched)])
    connection = connect(m, wiring(Scripted()))

    def begins(count: int) -> None:
        for state in (PassFail.FAIL, PassFail.PASS) * count:
            put(m.door, state)
            periods(m)
            m.ram.acknowledge()

    with connection:
        periods(m, 3)
        begins(5)
        assert sum(event.text.startswith("inhibited") for event in connection.machine.events) == 5
        lines = [text for text in caplog.messages if text.startswith("ram inhibited")]
        assert len(lines) == logged
        further = (
            "interlock 'no part': its further beginnings are events without a line, until it has not begun for 10 min"
        )
        assert (further in caplog.messages) is not latched


def test_the_beginnings_of_an_interlock_are_counted_anew_after_a_pause() -> None:
    inhibition = Inhibition(Interlock(lambda: False, [actuator()], "no part"), [])
    assert [inhibition.count(now) for now in (0.0, 9.0, 500.0, 1100.0, 1101.0)] == [1, 2, 3, 1, 2]


def test_interlocks_that_begin_together_ask_first_and_then_reset_each_actuator_once_in_stop_order() -> None:
    class Ordered(Press, stop_order=("lamp", "heater")):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(is_open(self), [self.ram, self.lamp], "open")
            yield Interlock(lambda: self.lamp.read() is OnOff.ON, [self.ram, self.heater], "the lamp is on")

    box = Scripted()
    m = Ordered(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    connection = connect(m, wiring(box))
    with connection:
        m.lamp.write(OnOff.ON)
        m.update()
        put(m.door, PassFail.FAIL)
        begin(m)
        assert [call.channels[0] for call in box.segments("reset")] == ["lamp", "heater", "ram"]
        assert concerned(connection.machine.events) == ["lamp", "ram", "heater", "ram"]


def test_interlocks_hold_from_the_first_sample_on() -> None:
    m = press()
    with connect(m, wiring(Scripted({"door": 1}))):
        assert m.ram.write(1.0) is False


def test_a_sensor_that_cannot_be_trusted_inhibits() -> None:
    box, m = Scripted(), press()
    with connect(m, wiring(box)):
        box.set("door", OSError("cut"))
        m.timer.read()
        with pytest.raises(DriverError):
            m.sample()
        assert m.ram.write(1.0) is False
        assert m.ram.inhibited == "the condition 'the door is open' cannot be evaluated: door is BAD"


def test_frames_tell_a_condition_that_cannot_be_evaluated_from_one_that_is_true() -> None:
    box, m = Scripted(), press()
    connection = connect(m, wiring(box))
    with connection:
        image, claims = connection.machine.image, connection.machine.claims
        for reading, text in (
            (OSError("cut"), "the condition 'the door is open' cannot be evaluated"),
            (1, "the door is open"),
        ):
            box.set("door", reading)
            with suppress(DriverError):
                begin(m)
            assert claims.reasons[image.restrictions[image.slot_of[id(m.ram)]] - 1] == text


@pytest.mark.parametrize("answer", [None, 0, 0.0, "", OnOff.OFF])
def test_a_condition_that_answers_neither_true_nor_false_inhibits(answer: Any) -> None:
    m = own(lambda m: [Interlock(lambda: answer, [m.ram], "the door is open")])
    with connect(m, wiring()):
        assert m.ram.write(1.0) is False
        assert "is not True or False" in str(m.ram.inhibited)


def test_a_condition_may_answer_in_numpy() -> None:
    m = own(lambda m: [Interlock(lambda: np.float64(m.height.read()) > 50.0, [m.ram], "too high")])  # type: ignore[arg-type,return-value]
    with connect(m, wiring()):
        assert m.ram.write(1.0) is True
        put(m.height, 60.0)
        periods(m)
        assert (m.ram.write(1.0), m.ram.inhibited) == (False, "too high")


@pytest.mark.parametrize("latched", [False, True])
def test_an_interlock_that_goes_on_for_another_cause_acts_once_and_says_the_cause(latched: bool) -> None:
    box = Scripted({"height": [0, 2, 4]})
    m = own(lambda m: [Interlock(lambda: {}[m.height.read()], [m.ram], "blind", latched)])
    connection = connect(m, wiring(box))
    with connection:
        for cause in ("0.0", "1.0", "2.0"):
            assert f"KeyError: {cause}" in str(m.ram.inhibited)
            begin(m)
        assert len(box.segments("reset")) == len(connection.machine.events) == 1


def test_a_compound_stands_for_all_of_its_actuators() -> None:
    class Cell(Compound):
        timer: DigitalSensor
        gate: BinarySensor[PassFail]
        press: Press

        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: self.gate.read() is PassFail.FAIL, [self.press], "the gate is open")

    cell = Cell(timer=timer(), gate=switch(), press=press())
    names = ["gate", *(f"press.{name}" for name in ("door", "height", "ram", "lamp", "heater", "timer"))]
    wire: dict[str, Any] = {name: {"driver": "box"} for name in names}
    wire["timer"] = {"driver": "clock", "period": PERIOD}
    with connect(cell, {"drivers": {"box": Scripted({"gate": 1}), "clock": VirtualTimer()}, "wire": wire}):
        assert (cell.press.ram.write(1.0), cell.press.heater.write(1.0)) == (False, False)


def test_a_control_law_on_an_inhibited_motor_goes_on_and_does_not_wind_up() -> None:
    m = press()
    law = Servo(m.height, m.ram, gain=0.1, integral_time=0.05)
    with connect(m, wiring()):
        law.control(10.0, dt=PERIOD)
        for opened in (PassFail.FAIL, PassFail.PASS):
            put(m.door, opened)
            for _ in range(1000):
                periods(m)
                taken = law.control(10.0, dt=PERIOD)
                assert taken is (opened is PassFail.PASS)
                if taken:
                    break
        assert m.ram.pending < 2.0  # a second of this error alone would ask for 21 V


# Latched ------------------------------------------------------------------------------------------------


def latched(**changes: Any) -> Own:
    return own(lambda m: [Interlock(is_open(m), [m.ram, m.lamp], "open", latched=True)], **changes)


def test_a_latched_interlock_inhibits_until_its_condition_has_gone_and_it_was_acknowledged() -> None:
    m = latched()
    connection = connect(m, wiring())
    with connection:
        put(m.door, PassFail.FAIL)
        periods(m)
        assert m.ram.acknowledge() is False  # the door is open still
        put(m.door, PassFail.PASS)
        periods(m, 3)
        assert (m.ram.inhibited, m.ram.write(1.0)) == ("open (latched: acknowledge it)", False)
        assert m.ram.acknowledge() is True
        assert (m.ram.inhibited, m.ram.write(1.0)) == (None, True)
        periods(m)
        assert m.ram.read() == 1.0
        put(m.door, PassFail.FAIL)
        periods(m)
        put(m.door, PassFail.PASS)
        periods(m)
        put(m.door, PassFail.FAIL)
        periods(m)
        assert concerned(connection.machine.events) == ["ram", "lamp"] * 2  # not a third time


def test_what_inhibits_while_connecting_latches_only_if_it_still_does_in_the_first_period() -> None:
    """A simulated fail-safe input reads 0 until a test has set it."""
    for first, inhibited in ((PassFail.PASS, None), (PassFail.FAIL, "open")):
        m = latched()
        with connect(m, wiring(Scripted({"door": 1}))):
            assert (m.ram.inhibited, m.ram.write(1.0)) == ("open", False)
            put(m.door, first)
            periods(m)
            assert m.ram.inhibited == inhibited
            put(m.door, PassFail.PASS)
            periods(m)
            assert m.ram.inhibited == (inhibited and "open (latched: acknowledge it)")


# That stop the program ----------------------------------------------------------------------------------


def stopping(m: Press) -> list[Interlock]:
    return [Interlock(is_open(m), [m.ram, m.lamp], "open", effect="stop")]


def test_an_interlock_declared_to_stop_raises_from_a_write_of_anything_but_the_default() -> None:
    m = own(stopping)
    with connect(m, wiring(Scripted({"door": [1, 0]}))):
        with pytest.raises(Interlocked, match="ram is interlocked: open") as caught:
            m.ram.write(3.0)
        assert (caught.value.path, caught.value.reason) == ("ram", "open")
        with pytest.raises(Interlocked):
            m.lamp.write(OnOff.ON)
        assert m.ram.write(0.0) is True
        assert (m.ram.pending, m.lamp.pending, m.ram.inhibited) == (0.0, OnOff.OFF, "open")
        periods(m)
        assert m.ram.write(3.0) is True


# Many at once -------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
def test_a_vector_of_which_all_are_inhibited_takes_nothing() -> None:
    m = own(lambda m: [Interlock(is_open(m), [m.ram, m.heater], "open")])
    with connect(m, wiring(Scripted({"door": 1}))):
        assert Vector([m.ram, m.heater]).write([3.0, 4.0]) is False
        assert (m.ram.pending, m.heater.pending) == (0.0, 0.0)


@pytest.mark.usefixtures("each_way")
def test_a_vector_with_a_member_whose_interlock_stops_changes_none() -> None:
    m = own(stopping, heater=actuator(expires="3 ms", slew_rate=1000.0))
    motors = Vector([m.heater, m.ram])
    connection = connect(m, wiring(Scripted({"door": 1})))
    with connection:
        with pytest.raises(Interlocked):
            motors.write([4.0, 3.0])
        assert (m.heater.pending, m.ram.pending) == (0.0, 0.0)
        periods(m, 5)
        assert m.heater.read() == 0.0  # the rate has no target to go to
        assert concerned(connection.machine.events) == ["ram", "lamp"]  # and nothing to expire


# Defaults that could not be sent ------------------------------------------------------------------------


def test_a_reset_that_fails_comes_out_and_the_others_are_still_reset() -> None:
    box, m = Scripted(), press()
    with connect(m, wiring(box)):
        m.ram.write(3.0)
        m.lamp.write(OnOff.ON)
        periods(m)
        put(m.door, PassFail.FAIL)
        box.at(len(box.calls) + 1, OSError("stuck"))  # after the transfer of the sensors
        with pytest.raises(DriverError, match=r"box: stuck; ram"):
            begin(m)
        assert m.lamp.read() is OnOff.OFF
        m.update()  # a synchronous one has its default sent with the next transfer
        assert (m.ram.read(), box.get("ram")) == (0.0, 0)


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize(
    ("cause", "events"), [("interlocked", ["ram", "lamp"]), ("expired", ["lamp"]), ("reset", []), ("written", [])]
)
def test_a_default_that_an_asynchronous_actuator_did_not_take_is_tried_every_period_until_it_was(
    cause: str, events: list[str]
) -> None:
    valve, box = Scripted(), Scripted()
    m = press(lamp=relay(synchronous=False, expires="2 ms" if cause == "expired" else "1 s"))
    connection = connect(m, wired(m, box, entries={"lamp": {"driver": "valve"}}, valve=valve))
    with connection:
        m.lamp.write(OnOff.ON)
        periods(m)
        valve.broken = OSError("glitch")
        if cause == "interlocked":
            put(m.door, PassFail.FAIL)
        elif cause == "reset":
            with pytest.raises(DriverError):
                m.lamp.reset()
        elif cause == "written":
            with pytest.raises(DriverError):
                m.lamp.write(OnOff.OFF)
        tries = len(valve.calls)
        for number in range(1, 4):
            with pytest.raises(DriverError) as caught:
                begin(m)
            assert failed(caught.value) == ["lamp"]
            assert len(valve.calls) == tries + number
            m.update()
        valve.broken = None
        begin(m)
        assert (m.lamp.read(), valve.get("lamp")) == (OnOff.OFF, 0)
        periods(m, 5)
        assert len(valve.calls) == tries + 4
        assert concerned(connection.machine.events) == events


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("written", [False, True])
def test_a_default_that_an_actuator_without_a_guard_did_not_take_is_tried_every_period_too(written: bool) -> None:
    valve, m = Scripted(), bench(valve=relay(synchronous=False))
    with connect(m, wired(m, Scripted(), entries={"valve": {"driver": "valve"}}, valve=valve)):
        m.valve.write(OnOff.ON)
        valve.broken = OSError("glitch")
        with pytest.raises(DriverError):
            m.valve.write(OnOff.OFF) if written else m.valve.reset()
        for _ in range(2):
            with pytest.raises(DriverError):
                begin(m)
        valve.broken = None
        tries = len(valve.calls)
        begin(m)
        assert (m.valve.read(), valve.get("valve")) == (OnOff.OFF, 0)
        periods(m, 3)
        assert len(valve.calls) == tries + 1


def test_sensors_that_fail_and_resets_that_fail_come_out_in_one_error() -> None:
    box, m = Scripted(), press()
    connection = connect(m, wiring(box))
    with connection:
        m.ram.write(3.0)
        m.lamp.write(OnOff.ON)
        periods(m)
        m.timer.read()
        box.at(len(box.calls), OSError("cut"))  # the transfer of the sensors, and so of the door
        box.at(len(box.calls) + 1, OSError("stuck"))
        with pytest.raises(DriverError) as caught:
            m.sample()
        assert failed(caught.value) == ["door", "height", "ram"]
        assert m.lamp.read() is OnOff.OFF
        assert concerned(connection.machine.events) == ["ram", "lamp"]


def test_sensors_that_fail_do_not_keep_a_command_from_expiring() -> None:
    box, m = Scripted(), press(heater=actuator(expires="2 ms", synchronous=False))
    with connect(m, wiring(box)):
        m.heater.write(3.0)
        for _ in range(2):
            m.timer.read()
            box.at(len(box.calls), OSError("cut"))
            with pytest.raises(DriverError):
                m.sample()
        assert m.heater.read() == 0.0


# A range that the raw integers do not meet --------------------------------------------------------------

COARSE: dict[str, Any] = {"default": 11.0, "minimum": -7.0, "maximum": 11.0, "resolution": 4.0}
"""8 V and -4 V are the last steps within the range; the nearest to its ends would be 12 V and -8 V."""


def sent(box: Scripted, channel: str) -> set[int]:
    """Every raw integer that the channel was ever given."""
    given = [(name, raw) for call in box.calls for name, raw in zip(call.channels, call.raws, strict=False)]
    return {raw for name, raw in given if name == channel and raw is not None}


@pytest.mark.usefixtures("each_way")
@pytest.mark.parametrize("resolution", [4.0, -4.0])
@pytest.mark.parametrize("changes", [{}, {"synchronous": False}, {"slew_rate": 50_000.0}, {"expires": "5 ms"}])
def test_nothing_beyond_the_range_is_ever_sent(changes: dict[str, Any], resolution: float) -> None:
    box, m = Scripted(), press(heater=actuator(**COARSE | changes | {"resolution": resolution}))
    with connect(m, wiring(box)):
        for value in (11.0, -7.0, 10.5, -6.5, 11.0):
            assert m.heater.write(value) is True
            periods(m)
            assert m.heater.read() == value  # as written, not as quantised
            assert Vector([m.heater]).write([-value / 2]) is True
            periods(m)
            assert Vector([m.heater]).write([value]) is True
            periods(m)
        periods(m, 6)
        m.heater.reset()
    assert {raw * resolution for raw in sent(box, "heater")} == {8.0, -4.0, 4.0}


@pytest.mark.usefixtures("each_way")
def test_a_clamped_value_is_within_the_range_at_the_hardware_too() -> None:
    box = Scripted()
    m = press(heater=actuator(**COARSE | {"limits": "clamp"}), ram=actuator(limits="clamp"))
    with connect(m, wiring(box)):
        for value in (99.0, -99.0):
            assert m.heater.write(value) is False
            periods(m)
            assert Vector([m.heater, m.ram]).write([value, value]) is False
            periods(m)
    assert sent(box, "heater") == {2, -1}
    assert sent(box, "ram") == {20, -20, 0}


def test_the_clamp_does_not_call_an_overridden_write_again() -> None:
    class Halved(DigitalActuator):
        def write(self, value: float) -> bool:
            return super().write(value / 2)

    m = press(heater=Halved("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.5, limits="clamp"))
    with connect(m, wiring()):
        assert m.heater.write(100.0) is False
        periods(m)
        assert m.heater.read() == 10.0


# What is told -------------------------------------------------------------------------------------------


def test_what_guards_do_is_in_the_events_the_log_and_the_journal(caplog: pytest.LogCaptureFixture) -> None:
    m = press(heater=actuator(expires="2 ms"))
    connection = connect(m, wiring())
    with connection:
        m.heater.write(3.0)
        periods(m)
        put(m.door, PassFail.FAIL)
        journal = connection.image.transfer.journal = Journal(100)
        begin(m)
        lines = [f"{event.path} {event.text}" for event in connection.machine.events]
        assert lines == [
            " the door is open: 2 actuators inhibited: ram and lamp",
            "heater command expired: not written for 0.002 s, default sent",
        ]
        assert caplog.records == []  # the outputs of the period were not sent yet
        entries = [ENTRY.unpack_from(journal.buffer, ENTRY.size * i)[:2] for i in range(journal.count)]
        slots = {item: connection.image.slot_of[id(item)] for item in (m.ram, m.lamp, m.heater)}
        assert entries == [
            (slots[m.ram], Kind.INTERLOCKED),
            (slots[m.lamp], Kind.INTERLOCKED),
            (slots[m.heater], Kind.EXPIRED),
            (slots[m.ram], Kind.RESET),
            (slots[m.lamp], Kind.RESET),
        ]
        m.update()
        assert [record.getMessage() for record in caplog.records] == [line.strip() for line in lines]


# All together -------------------------------------------------------------------------------------------


def test_a_machine_connects_again_with_its_guards_as_new() -> None:
    m = press(ram=actuator(slew_rate=1000.0, expires="5 ms"))
    for _ in range(2):
        with connect(m, wiring(Scripted({"door": [0, 0, 0, 1]}))):
            assert m.ram.write(5.0) is True
            periods(m)
            assert m.ram.read() == 1.0
            periods(m, 3)
            assert m.ram.write(2.0) is False


@pytest.mark.parametrize(
    ("declare", "said"),
    [
        (lambda: actuator(expires=0), "expires must be above 0"),
        (lambda: actuator(expires="soon"), "not a duration"),
        (lambda: actuator(expires=True), "not a duration"),
        (lambda: relay(expires=-1), "not a duration"),
        (lambda: actuator(slew_rate=0.0), "must be above 0"),
        (lambda: actuator(slew_rate=float("nan")), "not a finite number"),
        (lambda: actuator(slew_rate=1.0, synchronous=False), "synchronous"),
        (lambda: Interlock("open", [actuator()], "why"), "must be a function"),  # type: ignore[arg-type]
        (lambda: Interlock(lambda: True, [], "why"), "does not name an actuator"),
        (lambda: Interlock(lambda: True, actuator(), "why"), "a list of objects"),  # type: ignore[arg-type]
        (lambda: Interlock(lambda: True, [sensor()], "why"), "not an actuator"),  # type: ignore[list-item]
        (lambda: Interlock(lambda: True, [actuator()], " "), "must be a string"),
        (lambda: Interlock(lambda: True, [actuator()], "why", effect="warn"), "neither"),  # type: ignore[arg-type]
    ],
)
def test_a_guard_that_makes_no_sense_is_refused_when_declared(declare: Any, said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        declare()


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ([Interlock(lambda: True, [actuator()], "why")], "another machine"),
        (None, "Odd.interlocks gives None"),
        (["the door is open"], "Odd.interlocks gives 'the door is open'"),
    ],
)
def test_interlocks_that_make_no_sense_are_refused_before_anything_is_touched(declared: Any, said: str) -> None:
    class Odd(Press):
        def interlocks(self) -> Any:
            return declared

    box = Scripted()
    m = Odd(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    with pytest.raises(DeclarationError, match=said):
        connect(m, wiring(box)).__enter__()
    assert not m.cycle.connected
    assert not m.ram.connected
    assert box.calls == []


def test_guards_are_shown_where_objects_are() -> None:
    assert "at most 5 V/s, expires after 100 ms" in actuator(slew_rate=5.0, expires="100 ms").describe()
    assert "expires after 100 ms" in relay(expires="100 ms").describe()

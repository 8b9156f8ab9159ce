"""Guards on what is commanded, in virtual time: expiring commands, limits of the rate, interlocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import umo
from machines import actuator, failed, relay, sensor, switch, timer
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DeclarationError,
    DigitalActuator,
    DigitalSensor,
    DriverError,
    Interlock,
    Interlocked,
    OnOff,
    PassFail,
    Vector,
    WiringError,
    connect,
)
from umo.control import state_of
from umo.cycle import forms
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


def wiring(box: Scripted | None = None, missed: list[int] | None = None) -> dict[str, Any]:
    names = ("door", "height", "ram", "lamp", "heater")
    return {
        "drivers": {"box": box or Scripted(), "clock": VirtualTimer(missed or ())},
        "wire": {"timer": {"driver": "clock", "period": PERIOD}, **{name: {"driver": "box"} for name in names}},
    }


# Commands that expire -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("both_forms")
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


def test_commands_that_expire_together_do_so_in_the_order_declared() -> None:
    m = press(ram=actuator(expires="2 ms", synchronous=False), lamp=relay(expires="2 ms"))
    connection = connect(m, wiring())
    with connection:
        m.lamp.write(OnOff.ON)
        m.ram.write(1.0)
        periods(m, 2)
        assert [event.path for event in connection.machine.events] == ["ram", "lamp"]


def test_a_later_write_arms_it_again() -> None:
    m = press(lamp=relay(expires=0.002))
    connection = connect(m, wiring())
    with connection:
        for _ in range(3):
            m.lamp.write(OnOff.ON)
            periods(m, 5)
            assert m.lamp.read() is OnOff.OFF
        assert len(connection.machine.events) == 3


def test_what_was_never_written_or_was_reset_does_not_expire() -> None:
    m = press(heater=actuator(expires="2 ms"))
    connection = connect(m, wiring())
    with connection:
        periods(m, 10)
        m.heater.write(3.0)
        m.heater.reset()
        periods(m, 10)
        assert not connection.machine.events


def test_missed_periods_count_for_the_age_of_a_command() -> None:
    m = press(heater=actuator(expires="5 ms"))
    with connect(m, wiring(missed=[0, 9])):
        periods(m)
        m.heater.write(3.0)
        periods(m)
        assert m.heater.read() == 0.0


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
    with pytest.raises(WiringError, match="1 ms is not shorter than a command of heater holds"):
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


def test_a_command_that_is_written_every_period_never_expires() -> None:
    m = press(heater=actuator(expires="2 ms"))
    connection = connect(m, wiring())
    with connection:
        for _ in range(50):
            m.heater.write(3.0)
            periods(m)
        assert m.heater.read() == 3.0
        assert not connection.machine.events


# Rates --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("both_forms")
def test_what_is_sent_moves_no_faster_than_the_rate() -> None:
    m = press(ram=actuator(slew_rate=1000.0, resolution=0.001))
    with connect(m, wiring()):
        m.ram.write(2.5)
        assert m.ram.pending == 2.5
        seen = []
        for _ in range(4):
            periods(m)
            seen.append(m.ram.read())
        assert seen == pytest.approx([1.0, 2.0, 2.5, 2.5])
        assert (m.ram.pending, m.ram.raw) == (2.5, 2500)


def test_write_judges_the_target_not_the_step() -> None:
    m = press(ram=actuator(slew_rate=1.0), heater=actuator(slew_rate=1.0, limits="clamp"))
    with connect(m, wiring()):
        with pytest.raises(umo.RangeError):
            m.ram.write(11.0)
        assert m.heater.write(11.0) is False
        assert m.heater.pending == 10.0
        assert m.heater.write(float(9)) is True


def test_updating_twice_in_a_period_moves_it_once() -> None:
    m = press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring()):
        m.ram.write(9.0)
        m.timer.read()
        for _ in range(3):
            m.update()
            m.ram.update()
        assert m.ram.read() == 1.0


def test_a_target_turned_round_within_a_period_waits_for_the_next() -> None:
    box, m = Scripted(), press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring(box)):
        m.timer.read()
        m.ram.write(9.0)
        m.ram.update()
        m.ram.write(-9.0)
        m.update()
        assert m.ram.read() == 1.0
        periods(m)
        assert m.ram.read() == 0.0


def test_the_update_of_another_part_takes_nothing_from_the_step() -> None:
    m = press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring()):
        m.ram.write(9.0)
        m.timer.read()
        m.lamp.update()
        assert m.ram.read() == 0.0
        m.update()
        assert m.ram.read() == 1.0


def test_the_target_is_reached_when_distance_and_rate_say() -> None:
    m = press(ram=actuator(slew_rate=100.0))
    with connect(m, wiring()):
        m.ram.write(1.0)
        periods(m, 10)  # ten times 0.1 is less than 1.0
        assert m.ram.read() == 1.0


def test_a_missed_period_is_made_up_by_the_rate() -> None:
    m = press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring(missed=[0, 3, 0])):
        m.ram.write(9.0)
        periods(m)
        assert m.ram.read() == pytest.approx(1.0)
        periods(m)
        assert m.ram.read() == pytest.approx(4.0)


def test_a_reset_passes_over_the_rate_and_takes_the_target_along() -> None:
    m = press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring()):
        m.ram.write(9.0)
        periods(m, 5)
        m.ram.reset()
        assert (m.ram.read(), m.ram.pending) == (0.0, 0.0)
        periods(m, 3)
        assert m.ram.read() == 0.0


def test_a_reset_that_was_not_taken_is_made_up_whole() -> None:
    box, m = Scripted(), press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring(box)):
        m.ram.write(9.0)
        periods(m, 5)
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            m.ram.reset()
        m.timer.read()
        with pytest.raises(DriverError):
            m.update()
        box.broken = None
        m.ram.write(9.0)
        periods(m)
        assert m.ram.read() == 0.0
        m.update()  # no step beside it in the same period
        assert m.ram.read() == 0.0
        periods(m)
        assert m.ram.read() == 1.0


def test_after_a_failed_transfer_the_slew_goes_on_from_what_was_confirmed() -> None:
    box, m = Scripted(), press(ram=actuator(slew_rate=1000.0))
    with connect(m, wiring(box)):
        m.ram.write(9.0)
        periods(m, 2)
        box.broken = OSError("cut")
        m.timer.read()
        with pytest.raises(DriverError):
            m.update()
        assert m.ram.read() == pytest.approx(2.0)
        box.broken = None
        periods(m)
        assert m.ram.read() == pytest.approx(3.0)


# Interlocks ---------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("both_forms")
def test_a_forbidden_write_says_why_and_changes_nothing() -> None:
    m = press()
    with connect(m, wiring()):
        put(m.door, PassFail.FAIL)
        periods(m)
        with pytest.raises(Interlocked, match="ram is interlocked: the door is open") as caught:
            m.ram.write(3.0)
        assert (caught.value.path, caught.value.reason) == ("ram", "the door is open")
        with pytest.raises(Interlocked):
            m.lamp.write(OnOff.ON)
        assert (m.ram.pending, m.lamp.pending) == (0.0, OnOff.OFF)
        m.heater.write(3.0)  # not named
        m.ram.write(0.0)  # its default
        put(m.door, PassFail.PASS)
        periods(m)
        m.ram.write(3.0)


def test_an_interlock_that_becomes_true_resets_what_it_names_at_once() -> None:
    box, m = Scripted(), press()
    connection = connect(m, wiring(box))
    with connection:
        m.ram.write(3.0)
        m.lamp.write(OnOff.ON)
        m.heater.write(4.0)
        periods(m, 3)
        put(m.door, PassFail.FAIL)
        before = len(box.calls)
        m.timer.read()
        m.sample()
        assert [call.channels for call in box.calls[before:] if call.segment == "reset"] == [("ram",), ("lamp",)]
        assert (m.ram.read(), m.lamp.read(), m.heater.read()) == (0.0, OnOff.OFF, 4.0)
        periods(m, 5)
        assert [event.text for event in connection.machine.events] == ["reset: the door is open"] * 2


def test_an_actuator_is_free_when_the_last_of_its_interlocks_is() -> None:
    m = press()
    with connect(m, wiring()):
        put(m.door, PassFail.FAIL)
        put(m.height, 95.0)
        periods(m)
        put(m.door, PassFail.PASS)
        periods(m)
        with pytest.raises(Interlocked, match="at its end"):
            m.ram.write(1.0)
        put(m.height, 5.0)
        periods(m)
        m.ram.write(1.0)


def test_interlocks_hold_from_the_first_sample_on() -> None:
    m = press()
    with connect(m, wiring(Scripted({"door": 1}))), pytest.raises(Interlocked):
        m.ram.write(1.0)


def test_a_condition_that_cannot_be_answered_forbids() -> None:
    class Blind(Press):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: 1 / 0 > 1, [self.ram], "the door is open")

    m = Blind(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    with connect(m, wiring()), pytest.raises(Interlocked, match=r"the door is open \(or not: ZeroDivisionError"):
        m.ram.write(1.0)


def test_an_interlock_that_stays_true_for_another_cause_acts_once_and_says_the_cause() -> None:
    class Blind(Press):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: {}[self.height.read()], [self.ram], "blind")

    box = Scripted({"height": [0, 2, 4]})
    m = Blind(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    connection = connect(m, wiring(box))
    with connection:
        for cause in ("0.0", "1.0", "2.0"):
            with pytest.raises(Interlocked, match=rf"KeyError: {cause}"):
                m.ram.write(1.0)
            m.timer.read()
            m.sample()
        assert len(box.segments("reset")) == len(connection.machine.events) == 1


@pytest.mark.parametrize("answer", [None, 0, 0.0, "", OnOff.OFF])
def test_a_condition_that_answers_neither_true_nor_false_forbids(answer: Any) -> None:
    class Vague(Press):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: answer, [self.ram], "the door is open")

    m = Vague(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    with connect(m, wiring()), pytest.raises(Interlocked, match="neither True nor False"):
        m.ram.write(1.0)


def test_a_condition_may_answer_in_numpy() -> None:
    class Measured(Press):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: np.float64(self.height.read()) > 50.0, [self.ram], "too high")

    m = Measured(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    with connect(m, wiring()):
        m.ram.write(1.0)
        put(m.height, 60.0)
        periods(m)
        with pytest.raises(Interlocked):
            m.ram.write(1.0)


def test_a_reset_that_fails_comes_out_and_the_others_are_still_reset() -> None:
    box, m = Scripted(), press()

    def refuse(call: Any) -> None:
        raise OSError("stuck")

    with connect(m, wiring(box)):
        m.ram.write(3.0)
        m.lamp.write(OnOff.ON)
        periods(m)
        put(m.door, PassFail.FAIL)
        m.timer.read()
        box.at(len(box.calls) + 1, refuse)  # after the transfer of the sensors
        with pytest.raises(DriverError, match=r"ram .*stuck"):
            m.sample()
        assert m.lamp.read() is OnOff.OFF


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
        assert [event.path for event in connection.machine.events] == ["ram", "lamp"]


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


def test_a_compound_stands_for_all_of_its_actuators() -> None:
    class Cell(Compound):
        timer: DigitalSensor
        gate: BinarySensor[PassFail]
        press: Press

        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: self.gate.read() is PassFail.FAIL, [self.press], "the gate is open")

    inner = Press(timer=timer(), door=switch(), height=sensor(), ram=actuator(), lamp=relay(), heater=actuator())
    cell = Cell(timer=timer(), gate=switch(), press=inner)
    names = ["gate", *(f"press.{name}" for name in ("door", "height", "ram", "lamp", "heater", "timer"))]
    wire: dict[str, Any] = {name: {"driver": "box"} for name in names}
    wire["timer"] = {"driver": "clock", "period": PERIOD}
    with connect(cell, {"drivers": {"box": Scripted({"gate": 1}), "clock": VirtualTimer()}, "wire": wire}):
        for item, value in ((inner.ram, 1.0), (inner.heater, 1.0)):
            with pytest.raises(Interlocked):
                item.write(value)


def test_a_vector_with_a_forbidden_member_changes_none() -> None:
    m = press()
    motors = Vector([m.ram, m.heater])
    with connect(m, wiring()):
        assert motors.write([1.0, 2.0]) is True
        assert (m.ram.pending, m.heater.pending) == (1.0, 2.0)
        put(m.door, PassFail.FAIL)
        periods(m)
        with pytest.raises(Interlocked):
            motors.write([3.0, 4.0])
        assert (m.ram.pending, m.heater.pending) == (0.0, 2.0)


def test_a_vector_write_counts_for_expiry_and_rate() -> None:
    m = press(ram=actuator(slew_rate=1000.0), heater=actuator(expires="3 ms"))
    with connect(m, wiring()):
        for _ in range(10):
            Vector([m.ram, m.heater]).write([4.0, 5.0])
            periods(m)
        assert (m.ram.read(), m.heater.read()) == (4.0, 5.0)


def test_a_machine_connects_again_with_its_guards_as_new() -> None:
    m = press(ram=actuator(slew_rate=1000.0, expires="5 ms"))
    for _ in range(2):
        with connect(m, wiring(Scripted({"door": [0, 0, 0, 1]}))):
            m.ram.write(5.0)
            periods(m)
            assert m.ram.read() == 1.0
            periods(m, 3)
            with pytest.raises(Interlocked):
                m.ram.write(2.0)


@pytest.mark.parametrize(
    ("declare", "said"),
    [
        (lambda: actuator(expires=0), "expires is 0"),
        (lambda: actuator(expires="soon"), "not a duration"),
        (lambda: actuator(expires=True), "not a duration"),
        (lambda: relay(expires=-1), "not a duration"),
        (lambda: actuator(slew_rate=0.0), "not above 0"),
        (lambda: actuator(slew_rate=float("nan")), "not a finite number"),
        (lambda: actuator(slew_rate=1.0, synchronous=False), "synchronous"),
        (lambda: Interlock("open", [actuator()], "why"), "is a function"),  # type: ignore[arg-type]
        (lambda: Interlock(lambda: True, [], "why"), "forbids nothing"),
        (lambda: Interlock(lambda: True, actuator(), "why"), "a list of objects"),  # type: ignore[arg-type]
        (lambda: Interlock(lambda: True, [sensor()], "why"), "not an actuator"),  # type: ignore[list-item]
        (lambda: Interlock(lambda: True, [actuator()], " "), "says its reason"),
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
    assert not m.connected
    assert not m.ram.connected
    assert box.calls == []


def test_guards_are_shown_where_objects_are() -> None:
    assert "at most 5 V/s, expires after 0.1 s" in actuator(slew_rate=5.0, expires="100 ms").describe()
    assert "expires after 0.1 s" in relay(expires="100 ms").describe()


# Against a model ----------------------------------------------------------------------------------------


@dataclass
class Model:
    """One actuator with all three guards, written down independently: in whole ticks."""

    rate: float
    expires: int
    value: float = 0.0
    target: float = 0.0
    written: int | None = None
    forbidden: bool = False
    now: int = 0

    def period(self, ticks: int, forbidden: bool) -> None:
        self.now += ticks
        if forbidden and not self.forbidden:
            self.reset()
        self.forbidden = forbidden
        if self.written is not None and self.now - self.written >= self.expires:
            self.target, self.written = 0.0, None

    def write(self, value: float) -> bool:
        if self.forbidden and value != 0.0:
            return False
        self.target, self.written = value, self.now
        return True

    def update(self, ticks: int, was_reset: bool) -> None:
        step = 0.0 if was_reset else self.rate * ticks * PERIOD
        self.value += min(max(self.target - self.value, -step), step)

    def reset(self) -> None:
        self.value = self.target = 0.0
        self.written = None


STEPS = st.lists(
    st.tuples(
        st.sampled_from([0, 0, 0, 1, 2, 5]),  # missed
        st.booleans(),  # the door
        st.one_of(st.none(), st.sampled_from([0.0, 1.0, -3.0, 7.5])),  # written
        st.sampled_from(["", "", "", "reset", "vector"]),
    ),
    max_size=40,
)


@given(STEPS, st.sampled_from([2, 3, 8]), st.sampled_from([100.0, 1000.0, 4000.0]), st.booleans())
def test_all_guards_together_do_what_a_small_model_does(
    steps: list[tuple[int, bool, float | None, str]], expires: int, rate: float, arrays: bool
) -> None:
    before, forms.ARRAYS_FROM = forms.ARRAYS_FROM, 0 if arrays else 10**9
    m = press(ram=actuator(slew_rate=rate, expires=expires * PERIOD, resolution=1e-4))
    model = Model(rate, expires)
    try:
        with connect(m, wiring(missed=[step[0] for step in steps])):
            vector = Vector([m.ram])
            for missed, opened, value, how in steps:
                put(m.door, PassFail.FAIL if opened else PassFail.PASS)
                ticks = max(missed, 1)
                fresh = opened and not model.forbidden
                m.timer.read()
                m.sample()
                model.period(ticks, opened)
                if how == "reset":
                    m.ram.reset()
                    model.reset()
                    fresh = True
                if value is not None:
                    taken = model.write(value)
                    try:
                        vector.write([value]) if how == "vector" else m.ram.write(value)
                        assert taken
                    except Interlocked:
                        assert not taken
                m.update()
                model.update(ticks, fresh)
                assert m.ram.read() == pytest.approx(model.value, abs=1e-9)
                assert m.ram.pending == model.target
    finally:
        forms.ARRAYS_FROM = before

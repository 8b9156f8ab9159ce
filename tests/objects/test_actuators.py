"""The two atomic actuators: the paper's section 4.5."""

from __future__ import annotations

import decimal
import math
from fractions import Fraction

import numpy as np
import pytest

from helpers.machines import actuator, failed, relay, wired
from umo import BinaryActuator, Compound, DigitalActuator, Quality, connect
from umo.errors import DeclarationError, DriverError, NotConnected, RangeError, StateError
from umo.states import OnOff, PassFail, UpDown
from umo.testing import Scripted

pytestmark = pytest.mark.usefixtures("each_way")


class Outputs(Compound):
    motor: DigitalActuator
    valve: BinaryActuator[OnOff]


def outputs(**changes):
    return Outputs(**({"motor": actuator(), "valve": relay()} | changes))


@pytest.fixture
def box():
    return Scripted()


def writes(box):
    return [(call.channels, call.raws) for call in box.segments("write", "write_many")]


# Pending and commanded -------------------------------------------------------------------------------


def test_write_changes_nothing_at_the_hardware_nor_what_read_returns_until_update(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(2.0) and m.valve.write(OnOff.ON)
        assert (m.motor.pending, m.valve.pending) == (2.0, OnOff.ON)
        assert (m.motor.read(), m.valve.read()) == (0.0, OnOff.OFF)
        assert (m.motor.raw, m.valve.raw) == (0, 0)
        assert writes(box) == []
        assert m.update() is True
        assert (m.motor.read(), m.valve.read()) == (2.0, OnOff.ON)
        assert (m.motor.raw, m.valve.raw) == (4, 1)
        assert writes(box) == [(("motor", "valve"), (4, 1))]


def test_several_writes_before_an_update_send_the_last(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        for value in (1.0, 9.0, -3.0):
            m.motor.write(value)
        m.valve.write(OnOff.ON)
        m.valve.write(OnOff.OFF)
        m.update()
        assert writes(box) == [(("motor", "valve"), (-6, 0))]


def test_update_sends_every_period_written_or_not(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(1.0)
        for _ in range(3):
            m.update()
        assert writes(box) == [(("motor", "valve"), (2, 0))] * 3


def test_an_asynchronous_actuator_is_sent_by_write_at_once(box):
    machine = outputs(motor=actuator(synchronous=False), valve=relay(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(2.0) is True
        assert m.valve.write(OnOff.ON) is True
        assert (m.motor.read(), m.valve.read()) == (2.0, OnOff.ON)
        assert (m.motor.pending, m.valve.pending) == (2.0, OnOff.ON)
        assert writes(box) == [(("motor",), (4,)), (("valve",), (1,))]


def test_update_of_an_asynchronous_actuator_does_nothing_and_is_true(box):
    machine = outputs(motor=actuator(synchronous=False), valve=relay(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.update() is True
        assert m.valve.update() is True
        assert m.update() is True
        assert writes(box) == []


def test_update_of_one_actuator_moves_that_one_only(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(1.0)
        m.valve.write(OnOff.ON)
        assert m.valve.update() is True
        assert writes(box) == [(("valve",), (1,))]
        assert (m.motor.read(), m.valve.read()) == (0.0, OnOff.ON)


def test_reset_is_at_once_also_when_synchronous_and_sets_pending_and_commanded(box):
    machine = outputs(motor=actuator(default=1.5), valve=relay(default=OnOff.ON))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(5.0)
        m.valve.write(OnOff.OFF)
        m.update()
        m.motor.write(7.0)
        m.valve.write(OnOff.OFF)
        m.motor.reset()
        m.valve.reset()
        assert [(c.channels, c.raws) for c in box.segments("reset")] == [(("motor",), (3,)), (("valve",), (1,))]
        assert (m.motor.read(), m.motor.pending, m.motor.raw) == (1.5, 1.5, 3)
        assert (m.valve.read(), m.valve.pending, m.valve.raw) == (OnOff.ON, OnOff.ON, 1)
        m.update()
        assert writes(box)[-1] == (("motor", "valve"), (3, 1))


def test_a_failed_write_raises_and_read_keeps_the_last_confirmed_value(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(1.0)
        m.update()
        m.motor.write(2.0)
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(DriverError) as caught:
            m.update()
        assert failed(caught.value) == ["motor", "valve"]
        assert (m.motor.read(), m.motor.raw, m.motor.pending) == (1.0, 2, 2.0)
        assert m.motor.quality is Quality.BAD
        assert m.update() is True
        assert (m.motor.read(), m.motor.quality) == (2.0, Quality.GOOD)


def test_a_failed_asynchronous_write_raises_and_read_keeps_the_last_confirmed_value(box):
    machine = outputs(motor=actuator(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(1.0)
        box.at(len(box.calls), RuntimeError("cut"))
        with pytest.raises(DriverError, match="box: RuntimeError: cut; motor"):
            m.motor.write(2.0)
        assert (m.motor.read(), m.motor.raw, m.motor.pending) == (1.0, 2, 2.0)
        assert m.motor.quality is Quality.BAD
        assert m.motor.write(3.0)
        assert (m.motor.read(), m.motor.quality) == (3.0, Quality.GOOD)


def test_a_driver_cannot_change_what_is_pending(box):
    class Meddling(Scripted):
        def write_many(self, channels, raws):
            super().write_many(channels, raws)
            raws[:] = 99

    machine = outputs()
    meddling = Meddling()
    with connect(machine, wired(machine, meddling)) as m:
        m.motor.write(1.0)
        with pytest.raises(DriverError, match="read-only"):
            m.update()
        assert (m.motor.pending, m.motor.read()) == (1.0, 0.0)
        with pytest.raises(DriverError, match="read-only"):
            m.update()
        assert meddling.calls[-1].raws == (2, 0)


# Limits ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [10.000001, -10.000001, 1e300])
def test_beyond_the_range_write_raises_and_changes_nothing(box, value):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(3.0)
        with pytest.raises(RangeError, match=r"motor: .* is outside -10 to 10"):
            m.motor.write(value)
        assert m.motor.pending == 3.0


@pytest.mark.parametrize(("value", "bound", "raw"), [(10.1, 10.0, 20), (-1e300, -10.0, -20)])
def test_a_clamping_actuator_takes_the_nearest_bound_and_returns_false(box, value, bound, raw):
    machine = outputs(motor=actuator(limits="clamp"))
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(value) is False
        assert m.motor.pending == bound
        m.update()
        assert (m.motor.read(), m.motor.raw) == (bound, raw)


def test_a_clamping_asynchronous_actuator_sends_the_bound_at_once(box):
    machine = outputs(motor=actuator(limits="clamp", synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(11) is False
        assert (m.motor.read(), box.get("motor")) == (10.0, 20)


@pytest.mark.parametrize("limits", ["raise", "clamp"])
@pytest.mark.parametrize(
    "value", [math.nan, math.inf, -math.inf, np.float64("nan"), np.inf, decimal.Decimal("Infinity")]
)
def test_what_is_not_finite_always_raises(box, limits, value):
    machine = outputs(motor=actuator(limits=limits))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(3.0)
        with pytest.raises(RangeError, match="not finite"):
            m.motor.write(value)
        assert m.motor.pending == 3.0


@pytest.mark.parametrize("limits", ["raise", "clamp"])
@pytest.mark.parametrize(
    "value", [True, False, np.True_, "5", None, OnOff.ON, 1j, [1.0], np.array([1.0, 2.0]), 10**400, b"1"]
)
def test_what_is_no_number_always_raises(box, limits, value):
    machine = outputs(motor=actuator(limits=limits))
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(RangeError, match="motor: "):
            m.motor.write(value)
        assert m.motor.pending == 0.0


@pytest.mark.parametrize("value", [2, 2.0, np.float64(2), np.float32(2), np.int64(2), np.uint8(2), Fraction(2)])
def test_any_finite_number_is_taken_and_kept_as_a_plain_float(box, value):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(value) is True
        m.update()
        assert type(m.motor.read()) is float
        assert (m.motor.read(), m.motor.raw) == (2.0, 4)


def test_rounding_to_the_resolution_is_no_refusal_and_read_gives_the_value_as_written(box):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(1.3) is True
        m.update()
        assert (m.motor.read(), m.motor.raw) == (1.3, 3)


def test_an_actuator_sent_by_itself_or_reset_reads_as_written_too(box):
    machine = outputs(motor=actuator(default=0.2))
    with connect(machine, wired(machine, box)) as m:
        assert (m.motor.read(), m.motor.raw) == (0.2, 0)
        m.motor.write(1.3)
        m.motor.update()
        assert (m.motor.read(), m.motor.raw) == (1.3, 3)
        m.motor.reset()
        assert (m.motor.read(), m.motor.raw) == (0.2, 0)


def test_an_asynchronous_actuator_reads_as_written_too(box):
    machine = outputs(motor=actuator(synchronous=False))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(1.3)
        assert (m.motor.read(), m.motor.raw) == (1.3, 3)


@pytest.mark.parametrize("bound", [-10.0, 10.0])
def test_the_bounds_themselves_are_inside(box, bound):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(bound) is True


@pytest.mark.parametrize("value", [PassFail.PASS, UpDown.UP, 1, 0, True, False, "ON", None, 1.0])
def test_a_state_of_another_type_raises_and_changes_nothing(box, value):
    machine = outputs()
    with connect(machine, wired(machine, box)) as m:
        m.valve.write(OnOff.ON)
        with pytest.raises(StateError, match=r"valve: .* is not a state of OnOff"):
            m.valve.write(value)
        assert m.valve.pending is OnOff.ON


# Scaling at the channel ------------------------------------------------------------------------------


def test_a_negative_resolution_turns_the_raw_values(box):
    machine = outputs(motor=actuator(resolution=-0.5, zero_offset=1.0))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(3.0)
        m.update()
        assert box.get("motor") == -4


@pytest.mark.parametrize(("one", "inverted", "raw"), [(OnOff.ON, False, 1), (OnOff.OFF, False, 0),
                                                     (OnOff.ON, True, 0), (OnOff.OFF, True, 1)])  # fmt: skip
def test_the_declaration_says_which_state_is_one_and_the_wiring_may_invert(box, one, inverted, raw):
    machine = outputs(valve=relay(one=one))
    with connect(machine, wired(machine, box, entries={"valve": {"inverted": inverted}})) as m:
        assert m.valve.read() is OnOff.OFF
        assert box.get("valve") == 1 - raw
        m.valve.write(OnOff.ON)
        m.update()
        assert (m.valve.read(), m.valve.raw, box.get("valve")) == (OnOff.ON, raw, raw)
        m.valve.reset()
        assert (m.valve.read(), box.get("valve")) == (OnOff.OFF, 1 - raw)


# Declarations ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong",
    [
        {"resolution": 0.0}, {"resolution": math.nan}, {"resolution": math.inf}, {"minimum": 10.0}, {"minimum": 11.0},
        {"default": 10.5}, {"default": -11.0}, {"default": math.nan}, {"maximum": math.inf}, {"zero_offset": math.nan},
        {"default": "0"}, {"default": True}, {"limits": "ignore"}, {"default": None},
    ],
)  # fmt: skip
def test_a_wrong_number_is_an_error_at_declaration(wrong):
    with pytest.raises(DeclarationError):
        actuator(**wrong)


@pytest.mark.parametrize(
    ("states", "one", "default"),
    [(OnOff, OnOff.ON, PassFail.PASS), (OnOff, PassFail.PASS, OnOff.ON), (OnOff, 1, OnOff.ON), (OnOff, OnOff.ON, 0),
     (bool, True, False), (OnOff.ON, OnOff.ON, OnOff.ON), (int, 1, 0)],
)  # fmt: skip
def test_a_wrong_state_is_an_error_at_declaration(states, one, default):
    with pytest.raises(DeclarationError):
        BinaryActuator(states, one=one, default=default)


def test_the_base_of_two_state_types_is_none_itself():
    from umo.states import TwoState

    with pytest.raises(DeclarationError, match="not a two-state type"):
        BinaryActuator(TwoState, one=OnOff.ON, default=OnOff.OFF)


def test_a_declaration_is_keyword_only():
    with pytest.raises(TypeError):
        DigitalActuator("V", 0.0, -10.0, 10.0, 0.1)
    with pytest.raises(TypeError):
        BinaryActuator(OnOff, OnOff.ON, OnOff.OFF)


def test_what_was_declared_can_be_asked():
    motor, valve = actuator(limits="clamp", zero_offset=2.0, default=1.0), relay(synchronous=False)
    assert (motor.units, motor.default, motor.minimum, motor.maximum) == ("V", 1.0, -10.0, 10.0)
    assert (motor.resolution, motor.zero_offset, motor.limits, motor.synchronous) == (0.5, 2.0, "clamp", True)
    assert (valve.states, valve.one, valve.zero, valve.default) == (OnOff, OnOff.ON, OnOff.OFF, OnOff.OFF)
    assert valve.synchronous is False


@pytest.mark.parametrize(
    "use",
    [
        lambda a: a.read(),
        lambda a: a.write(1.0),
        lambda a: a.update(),
        lambda a: a.reset(),
        lambda a: a.pending,
        lambda a: a.raw,
        lambda a: a.quality,
        lambda a: a.time,
    ],
)
def test_outside_connect_an_actuator_has_no_hardware(use):
    motor = actuator()
    with pytest.raises(NotConnected, match="DigitalActuator is not connected"):
        use(motor)
    machine = outputs(motor=motor)
    with connect(machine):
        pass
    with pytest.raises(NotConnected, match="motor is not connected"):
        use(motor)


def test_an_actuator_shows_itself_without_hardware_and_with_it(box):
    machine = outputs()
    assert repr(machine.motor) == "<DigitalActuator motor; -10 to 10 V by 0.5>"
    with connect(machine, wired(machine, box)) as m:
        assert repr(m.motor) == "<DigitalActuator motor = 0.0 V ● good; -10 to 10 V by 0.5>"
        assert repr(m.valve) == "<BinaryActuator valve = OFF ● good; ON=1 OFF=0>"

"""The servo against small plants that a test can reason about."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from helpers.machines import switch, timer, wired
from umo import BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Number, Quality, Vector, connect
from umo.control import HOMING, Servo, VectorServo
from umo.errors import BadInput, DeclarationError, DriverError, RangeError
from umo.states import PassFail
from umo.testing import Scripted, periods, put


class Axis(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor


def parts(*, incremental: bool = False, **motor: Any) -> dict[str, Any]:
    return {
        "motor": DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=1e-6, **motor),
        "encoder": DigitalSensor("mm", minimum=-1e3, maximum=1e3, resolution=1e-6, incremental=incremental),
    }


def axis(**changes: Any) -> Axis:
    return Axis(**parts(**changes))


def run(servo: Servo, m: Axis, setpoint: float, *, seconds: float, dt: float = 1e-3, load: float = 0.0) -> list[float]:
    """A first-order plant, 0.1 s, 1 mm per V, with a constant load in V; the positions."""
    position, path = m.encoder.read(), []
    for _ in range(round(seconds / dt)):
        put(m.encoder, position)
        m.sample()
        servo.control(setpoint, dt=dt)
        m.update()
        position += (m.motor.read() + load - position) * dt / 0.1
        path.append(position)
    return path


def test_the_proportional_part_is_gain_times_error() -> None:
    with connect(axis()) as m:
        put(m.encoder, 1.0)
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=2.0)
        assert servo.control(1.5, dt=1e-3)
        assert m.motor.pending == pytest.approx(1.0)
        assert servo.error == pytest.approx(0.5)


def test_the_integral_removes_a_constant_load() -> None:
    with connect(axis()) as m:
        assert run(Servo(m.encoder, m.motor, gain=5.0), m, 3.0, seconds=2.0, load=-1.0)[-1] < 2.7
        servo = Servo(m.encoder, m.motor, gain=5.0, integral_time=0.1)
        assert run(servo, m, 3.0, seconds=2.0, load=-1.0)[-1] == pytest.approx(3.0, abs=1e-3)


def test_gains_are_in_seconds_so_another_period_gives_the_same_response() -> None:
    ends = []
    for dt in (1e-3, 4e-3):
        with connect(axis()) as m:
            servo = Servo(m.encoder, m.motor, gain=2.0, integral_time=0.2)
            ends.append(run(servo, m, 3.0, seconds=0.2, dt=dt)[-1])
    assert ends[0] == pytest.approx(ends[1], rel=0.03)


def test_the_derivative_acts_on_the_measured_value_and_is_filtered() -> None:
    with connect(axis()) as m:
        servo = Servo(m.encoder, m.motor, gain=1.0, derivative_time=0.01, filter_time=0.009)
        m.sample()
        servo.control(5.0, dt=1e-3)
        assert m.motor.pending == pytest.approx(5.0)  # a setpoint step makes no derivative kick
        put(m.encoder, 0.1)
        m.sample()
        servo.control(5.0, dt=1e-3)
        rate = (0.1 / 1e-3) * 1e-3 / (0.009 + 1e-3)
        assert m.motor.pending == pytest.approx(4.9 - 0.01 * rate)


def test_feed_forward_follows_velocity_acceleration_and_friction() -> None:
    with connect(axis()) as m:
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=1.0, feed_forward=0.5, inertia=0.1, friction=0.2)
        for velocity, expected in ((2.0, 1.0 + 0.3 + 0.2), (-2.0, -1.0 + 0.3 - 0.2), (0.0, 0.3)):
            servo.control(0.0, velocity, 3.0, dt=1e-3)
            assert m.motor.pending == pytest.approx(expected)


def test_the_integral_does_not_wind_up_while_the_actuator_is_at_its_limit() -> None:
    """A setpoint out of reach for 5 s, then one in reach: with wind-up it would take as long to come back."""
    with connect(axis()) as m:
        servo = Servo(m.encoder, m.motor, gain=2.0, integral_time=0.05)
        path = run(servo, m, 100.0, seconds=5.0)
        assert path[-1] == pytest.approx(10.0, abs=0.01)
        back = run(servo, m, 5.0, seconds=1.0)
        assert min(abs(x - 5.0) for x in back[:300]) < 0.1
        assert back[-1] == pytest.approx(5.0, abs=0.01)


class Slow(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor


def test_the_integral_does_not_wind_up_while_the_slew_rate_limits_the_output() -> None:
    """Else it would be at the end of the range after 0.1 s, and the motor would go on to there."""
    m = Slow(timer=timer(), **parts(slew_rate=5.0))
    with connect(m, wired(m, Scripted())):
        servo = Servo(m.encoder, m.motor, gain=1.0, integral_time=0.01)
        for period in range(1, 200):
            periods(m)
            assert servo.control(10.0, dt=m.dt) is False
            assert servo.integral <= 5e-3 * period + 1.0
            m.update()
        put(m.encoder, 10.0)
        periods(m)
        servo.control(10.0, dt=m.dt)
        assert m.motor.pending < 1.1


def test_the_output_stays_within_the_range_where_write_would_raise() -> None:
    with connect(axis(limits="raise")) as m:
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=1.0)
        assert servo.control(1000.0, dt=1e-3) is False
        assert m.motor.pending == 10.0


def test_reset_forgets_the_past() -> None:
    with connect(axis()) as m:
        servo = Servo(m.encoder, m.motor, gain=1.0, integral_time=0.01, derivative_time=0.01, filter_time=0.01)
        run(servo, m, 4.0, seconds=0.1)
        servo.control(100.0, dt=1e-3)  # asks for more than the actuator can
        servo.reset()
        assert servo.error == 0.0
        put(m.encoder, 4.0)
        m.sample()
        servo.control(4.0, dt=1e-3)
        assert m.motor.pending == 0.0


def test_the_first_reading_is_not_a_rate() -> None:
    with connect(axis()) as m:
        put(m.encoder, 4.0)
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=1.0, derivative_time=0.01)
        servo.control(5.0, dt=1e-3)
        assert m.motor.pending == pytest.approx(1.0)


def test_a_period_without_time_has_no_rate_though_the_filter_remembers_one() -> None:
    with connect(axis()) as m:
        servo = Servo(m.encoder, m.motor, gain=1.0, derivative_time=0.01, filter_time=0.01)
        for value, dt in ((0.0, 1e-3), (0.5, 1e-3), (0.5, 0.0)):
            put(m.encoder, value)
            m.sample()
            servo.control(1.0, dt=dt)
        assert m.motor.pending == pytest.approx(0.5)


def test_in_no_time_the_proportional_part_is_left_and_nothing_divides_by_zero() -> None:
    with connect(axis()) as m:
        servo = Servo(m.encoder, m.motor, gain=2.0, integral_time=0.1, derivative_time=0.01)
        for value, expected in ((0.0, 4.0), (1.0, 2.0)):
            put(m.encoder, value)
            m.sample()
            assert servo.control(2.0, dt=0.0)
            m.update()
            assert m.motor.read() == pytest.approx(expected)
        servo.control(2.0, dt=1e-3)  # the change was seen when no time had passed: it is not a rate now
        assert m.motor.pending == pytest.approx(2.0 + 2.0 * 1.0 * 1e-3 / 0.1)


def test_a_bad_input_is_refused_unless_the_call_accepts_it() -> None:
    with connect(axis(incremental=True)) as m:
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=1.0)
        with pytest.raises(BadInput, match="encoder is UNREFERENCED"):
            servo.control(1.0, dt=1e-3)
        assert m.motor.pending == 0.0
        assert servo.control(1.0, dt=1e-3, accept=HOMING)
        m.encoder.referenced()
        put(m.encoder, 2e3)
        m.sample()
        with pytest.raises(BadInput) as caught:
            servo.control(1.0, dt=1e-3)
        assert caught.value.quality is Quality.OUT_OF_RANGE
        assert math.isfinite(m.motor.pending)


def test_an_output_that_cannot_be_written_does_not_change_the_integral(monkeypatch: pytest.MonkeyPatch) -> None:
    def write(actuator: DigitalActuator, value: float) -> bool:
        raise DriverError("the line is dead")

    with connect(axis()) as m:
        m.sample()
        servo = Servo(m.encoder, m.motor, gain=0.01, integral_time=1.0)
        servo.control(100.0, dt=0.1)
        before = servo.integral
        monkeypatch.setattr(DigitalActuator, "write", write)
        with pytest.raises(DriverError):
            servo.control(100.0, dt=0.1)
        assert servo.integral == before > 0.0


# Many at once -------------------------------------------------------------------------------------------


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor


class Tunnel(Compound):
    timer: DigitalSensor
    door: BinarySensor[PassFail]
    zones: list[Zone]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.door.read() is PassFail.FAIL, [self.zones[1].heater], "the door is open")


def tunnel(count: int = 3, **heater: Any) -> Tunnel:
    return Tunnel(
        timer=timer(),
        door=switch(),
        zones=[
            Zone(
                heater=DigitalActuator("percent", default=0, minimum=0, maximum=100, resolution=0.1, **heater),
                temperature=DigitalSensor("degC", minimum=0, maximum=1200, resolution=0.1),
            )
            for _ in range(count)
        ],
    )


def heating(m: Tunnel, **gains: Any) -> VectorServo:
    return VectorServo(Vector(z.temperature for z in m.zones), Vector(z.heater for z in m.zones), **gains)


def heaters(m: Tunnel) -> list[float]:
    return [zone.heater.pending for zone in m.zones]


def test_many_servos_control_each_its_own_zone_within_its_range() -> None:
    m = tunnel()
    law = heating(m, gain=1.0, integral_time=10.0)
    with connect(m, wired(m, Scripted())):
        for zone, temperature in zip(m.zones, (0.0, 990.0, 1100.0), strict=True):
            put(zone.temperature, temperature)
        periods(m)
        assert law.control(np.array([1000.0, 1000.0, 1000.0]), dt=m.dt) is False
        assert heaters(m) == pytest.approx([100.0, 10.001, 0.0])
        assert law.limited.tolist() == [True, False, True]
        assert law.control(np.array([50.0, 995.0, 1150.0]), dt=m.dt) is True
        assert heaters(m) == pytest.approx([50.005, 5.0015, 50.005])


def test_the_integral_of_an_inhibited_zone_is_held_and_the_others_go_on() -> None:
    m = tunnel()
    law = heating(m, gain=0.01, integral_time=1.0)
    with connect(m, wired(m, Scripted())):
        put(m.door, PassFail.FAIL)
        for _ in range(5):
            periods(m)
            assert law.control(500.0, dt=m.dt) is False
        assert heaters(m)[1] == 0.0
        assert law.integral.tolist() == pytest.approx([0.025, 0.0, 0.025])
        put(m.door, PassFail.PASS)
        periods(m)
        assert law.control(500.0, dt=m.dt) is True
        assert heaters(m)[1] == pytest.approx(5.005)


def test_many_servos_step_no_further_than_their_slew_rates_allow() -> None:
    m = tunnel(slew_rate=100.0)
    law = heating(m, gain=1.0, integral_time=0.01)
    with connect(m, wired(m, Scripted())):
        for expected in (0.1, 0.2, 0.3):
            periods(m)
            assert law.control(1000.0, dt=m.dt) is False
            assert heaters(m) == pytest.approx([expected] * 3)
            m.update()
        assert law.integral.tolist() == [0.0] * 3


def test_many_servos_refuse_what_one_would_refuse_and_write_nothing() -> None:
    m = tunnel()
    law = heating(m, gain=1.0)
    with connect(m, wired(m, Scripted())):
        put(m.zones[2].temperature, 1300.0)
        periods(m)
        with pytest.raises(BadInput, match=r"zones.2.temperature is OUT_OF_RANGE"):
            law.control(1000.0, dt=m.dt)
        assert heaters(m) == [0.0] * 3


def test_a_setpoint_of_one_zone_that_is_not_finite_is_refused_unless_the_zone_is_not_enabled() -> None:
    m = tunnel()
    law = heating(m, gain=0.01, integral_time=1.0)
    with connect(m, wired(m, Scripted())):
        periods(m)
        law.control(500.0, dt=m.dt)
        before = law.integral.tolist()
        wrong = np.array([500.0, math.nan, 500.0])
        with pytest.raises(RangeError, match="element 1 is not finite"):
            law.control(wrong, dt=m.dt)
        assert law.integral.tolist() == before
        assert law.control(wrong, dt=m.dt, enabled=np.array([True, False, True])) is True
        assert law.error.tolist() == [500.0, 0.0, 500.0]
        assert law.control(500.0, dt=m.dt) is True
        assert all(math.isfinite(value) for value in heaters(m))


def test_the_largest_error_of_the_enabled_zones_is_a_signal_in_the_units_of_the_sensors() -> None:
    m = tunnel()
    law = heating(m, gain=0.01)
    assert law.numbers["largest_error"] == Number("degC", shown=True)
    with connect(m, wired(m, Scripted())):
        put(m.zones[1].temperature, 1000.0)
        periods(m)
        law.control(300.0, dt=m.dt)
        assert law.largest_error == pytest.approx(700.0)
        law.control(300.0, dt=m.dt, enabled=np.array([True, False, True]))
        assert law.largest_error == 300.0


def test_as_many_sensors_as_actuators() -> None:
    m = tunnel()
    with pytest.raises(DeclarationError, match="3 sensors for 1 actuators"):
        VectorServo(Vector(z.temperature for z in m.zones), Vector([m.zones[0].heater]), gain=1.0)


def test_zones_that_are_not_enabled_are_left_alone() -> None:
    """Neither checked nor written; their integrals are held."""
    m = tunnel()
    law = heating(m, gain=0.01, integral_time=1.0)
    some = np.array([True, False, True])
    with connect(m, wired(m, Scripted())):
        for _ in range(10):
            periods(m)
            law.control(500.0, dt=m.dt)
        before = law.integral.tolist()
        m.zones[1].heater.write(33.0)
        put(m.zones[1].temperature, 1300.0)
        periods(m)
        with pytest.raises(BadInput):
            law.control(500.0, dt=m.dt)
        assert law.control(500.0, dt=m.dt, enabled=some) is True
        assert heaters(m) == pytest.approx([5.055, 33.0, 5.055])
        assert law.integral[1] == before[1] < law.integral[0]
        assert law.error.tolist() == [500.0, 0.0, 500.0]
        assert law.control(1e6, dt=m.dt, enabled=some) is False
        assert law.limited.tolist() == [True, False, True]
        law.integral = np.full(3, -1.0)  # would be limited
        assert law.control(1e6, dt=m.dt, enabled=np.zeros(3, np.bool_)) is True
        law.integral = np.array(before)
        put(m.zones[1].temperature, 0.0)
        periods(m)
        assert law.control(500.0, dt=m.dt, enabled=np.ones(3, np.bool_)) is True
        assert heaters(m)[1] == pytest.approx(5.0 + before[1] + 0.005)


def test_a_zone_that_is_enabled_again_has_no_kick_of_its_derivative() -> None:
    m = tunnel()
    law = heating(m, gain=0.01, derivative_time=1.0, filter_time=0.1)
    some = np.array([True, False, True])
    with connect(m, wired(m, Scripted())):
        for enabled in (None, some, some, None):
            periods(m)
            law.control(500.0, dt=m.dt, enabled=enabled)
        assert heaters(m) == pytest.approx([5.0] * 3)


def test_enabled_must_be_a_boolean_for_each() -> None:
    m = tunnel()
    law = heating(m, gain=0.01)
    with connect(m, wired(m, Scripted())):
        for wrong in (np.array([True]), np.ones(3), [True] * 3):
            with pytest.raises(RangeError, match="is not an array of 3 booleans"):
                law.control(500.0, dt=m.dt, enabled=wrong)  # type: ignore[arg-type]

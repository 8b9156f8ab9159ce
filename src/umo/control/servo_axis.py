"""Servo axes: a motor behind an amplifier, with a position sensor."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from math import inf, isfinite

from umo.control.axis import Axis, Interruption
from umo.control.axis_state import AxisState
from umo.control.checks import check_numbers
from umo.control.inputs import value_of
from umo.control.servo import Servo
from umo.errors import AxisError, TaskFailed
from umo.objects import DigitalActuator, Number
from umo.objects.presentation.value_text import measure

_DISABLED, _HOMING, _FREE = AxisState.DISABLED, AxisState.HOMING, Interruption.NONE  # an attribute of an Enum is a call


class AxisServo(Servo):
    """The servo of an axis. Its setpoint and error are shown by the axis."""

    @property
    def numbers(self) -> Mapping[str, Number]:
        return {name: each for name, each in super().numbers.items() if not each.shown}


def _numbers(axis: ServoAxis) -> dict[str, Number]:
    """Return the gains of the servo, with ranges up to ten times the declared gains."""
    units = axis.encoder.units
    gain = f"{axis.motor.units or 1}/{units if units.isidentifier() else f'({units or 1})'}"
    found = {"servo.gain": Number(gain, *sorted((0.0, 10 * axis.gain)), tunable=True)}
    if isfinite(axis.integral_time):
        found["servo.integral_time"] = Number("s", axis.integral_time / 10, 10 * axis.integral_time, tunable=True)
    for name in ("derivative_time", "filter_time"):
        if number := getattr(axis, name):
            found[f"servo.{name}"] = Number("s", 0.0, 10 * number, tunable=True)
    return found


class ServoAxis(Axis, numbers=_numbers):
    """An axis whose motor is commanded by a PID on the encoder.

        x = ServoAxis(
            motor=DigitalActuator("V", ...), encoder=DigitalSensor("mm", ...), gain=0.8, integral_time=0.1,
            velocity=200.0, acceleration=2e3, jerk=4e4, window=0.05, following_error=2.0,
            homing=EndStop(direction=-1, position=0.0), search_speed=20.0, stall=2.0, search_output=2.0,
        )

    While the axis is not enabled, the motor is at its default. The gains are those of `Servo`. After missed periods the
    motion is planned again from the present position, so that the motion keeps its limits and ends later.
    """

    motor: DigitalActuator
    gain: float
    integral_time: float = inf
    derivative_time: float = 0.0
    filter_time: float = 0.0
    feed_forward: float = 0.0
    inertia: float = 0.0
    friction: float = 0.0
    search_output: float = inf
    """The largest distance of the output from the motor's default during homing, in units of the motor. It limits the
    force at an end stop."""

    def setup(self) -> None:
        super().setup()
        check_numbers(self, above_0=("search_output",))
        self.servo = AxisServo(
            self.encoder,
            self.motor,
            gain=self.gain,
            integral_time=self.integral_time,
            derivative_time=self.derivative_time,
            filter_time=self.filter_time,
            feed_forward=self.feed_forward,
            inertia=self.inertia,
            friction=self.friction,
        )

    def control(self) -> None:
        if self._state is _DISABLED:
            self.motor.write(self.motor.default)
            return
        if self._interrupted is not _FREE and self.motor.inhibited is None:
            self._go_on()
        clock, servo = self._machine.clock, self.servo
        dt = clock.dt
        if clock.ticks > 1:
            dt = clock.period
            self._resume(clock.ticks, dt)
        position, velocity, acceleration = self.profile.step(dt)
        taken = servo.control(position, velocity, acceleration, dt=dt, accept=self._accept)
        beyond = abs(servo.error) > self.following_error and self._state is not _HOMING
        if (beyond or not taken) and self.motor.inhibited is not None:
            self._interrupt()
        elif beyond:
            units = self.encoder.units
            raise AxisError(f"{self._path} does not follow: {measure(servo.error, units)} behind its setpoint")

    def _resume(self, ticks: int, period: float) -> None:
        """Continue after missed periods, in which the axis has moved under its last command. The axis is controlled as
        if only one period had passed. If the axis has moved further than in one period, the setpoint moves with it, and
        the motion is planned again from there; an axis that has moved past the end of its motion moves back. So the
        command has no step and keeps its limits. An axis that has not moved has an error, as in any period."""
        position, velocity, _ = self.profile.setpoint
        reading = value_of(self.encoder, self._accept)
        moved = reading - (position - self.servo.error)
        self.servo.shift(moved - moved / ticks)  # the derivative sees the mean speed
        if velocity or not self.profile.done:
            beyond = moved - velocity * period
            if beyond * velocity > 0.0:
                self.profile.shift(beyond)
                self._plan_anew()
        elif moved * (reading - position) > 0.0 and abs(reading - position) > self.window:
            self.profile.shift(moved)
            with suppress(TaskFailed):  # without a host it stays there
                self.profile.to(position)

    @property
    def error(self) -> float:
        return self.servo.error

    def _enter(self, state: AxisState) -> None:
        if state is _HOMING or self._state is _HOMING:
            self.servo.limit = self.search_output if state is _HOMING else inf
        super()._enter(state)

    def _stand(self) -> None:
        self.servo.reset()
        self.profile.hold(value_of(self.encoder, self._accept))

    def _shift(self, distance: float) -> None:
        super()._shift(distance)
        self.servo.shift(distance)

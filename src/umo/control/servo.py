"""Servos: PIDs from sensors to actuators, with feed-forward of the setpoint's motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from math import copysign, inf
from typing import Any

import numpy as np

from umo.control.checks import check_numbers
from umo.control.inputs import Accept, value_of
from umo.control.pid import PID, VectorPID
from umo.errors import DeclarationError
from umo.objects import DigitalActuator, DigitalSensor, Number, Vector
from umo.objects.scaling import BoolArray, FloatArray


@dataclass
class Servo(PID):
    """A PID on objects: it reads the sensor and writes the actuator.

        self.servo = Servo(self.encoder, self.motor, gain=0.02, integral_time=0.1)

    The output is limited to the range of the actuator and to the change that its slew rate allows in the period. The
    integral is held while the actuator is inhibited.
    """

    sensor: DigitalSensor
    actuator: DigitalActuator
    _: KW_ONLY
    feed_forward: float = 0.0
    """Output for the setpoint's velocity, in actuator units for a velocity of one sensor unit per second."""
    inertia: float = 0.0
    """Output for the setpoint's acceleration, in actuator units for an acceleration of one sensor unit per second
    squared."""
    friction: float = 0.0
    """Output that overcomes dry friction, in actuator units. It is added with the sign of the setpoint's velocity."""
    limit: float = inf
    """Largest distance of the output from the actuator's default. Default: the range of the actuator."""

    def check_settings(self) -> None:
        """Check the settings as `PID.check_settings` does. Feed-forward, inertia and friction must be finite, and the
        limit must be above 0."""
        super().check_settings()
        check_numbers(self, finite=("feed_forward", "inertia", "friction"), above_0=("limit",))

    @property
    def numbers(self) -> Mapping[str, Number]:
        shown = Number(self.sensor.units, shown=True)
        return {**super().numbers, "setpoint": shown, "error": shown}

    def loops(self) -> Mapping[str, tuple[Any, ...]]:
        return {"": (self.sensor, self.actuator)}

    def control(
        self,
        setpoint: float,
        velocity: float = 0.0,
        acceleration: float = 0.0,
        *,
        dt: float,
        accept: Accept = (),
    ) -> bool:
        """Carry out one period of `dt` s: read, compute, write. Returns False if the output was limited or the actuator
        is inhibited.

        Raises BadInput if the sensor's quality is not accepted, RangeError if a number is not finite. An error leaves
        the integral unchanged.
        """
        measurement = value_of(self.sensor, accept)
        feed_forward = self.feed_forward * velocity + self.inertia * acceleration
        if velocity:
            feed_forward += copysign(self.friction, velocity)
        low, high = self._reach(dt)
        integral = self.integral
        output = self.step(setpoint, measurement, dt, feed_forward=feed_forward, low=low, high=high)
        taken = False
        try:
            taken = self.actuator.write(output)
        finally:
            if not taken:
                self.integral = integral
        return taken and not self.limited

    def _reach(self, dt: float) -> tuple[float, float]:
        """Return the lowest and the highest output of this period."""
        actuator = self.actuator
        low, high, rate = actuator._minimum, actuator._maximum, actuator._slew_rate  # the properties are calls
        if self.limit != inf:
            rest = actuator._default
            low, high = max(rest - self.limit, low), min(rest + self.limit, high)  # NaN stays, and is refused
        if rate is None or not dt:
            return low, high
        now, step = actuator.read(), rate * dt
        return max(low, now - step), min(high, now + step)


@dataclass(eq=False)
class VectorServo(VectorPID):
    """PIDs from many sensors to as many actuators, in one calculation:

        self.heating = VectorServo(Vector(z.temperature for z in zones), Vector(z.heater for z in zones), gain=0.02)

    The outputs are limited to the ranges of the actuators and to the changes that their slew rates allow in the period.
    The integrals of inhibited actuators are held.
    """

    sensors: Vector[DigitalSensor]
    actuators: Vector[DigitalActuator]

    def __post_init__(self) -> None:
        if len(self.sensors) != len(self.actuators):
            raise DeclarationError(f"{len(self.sensors)} sensors for {len(self.actuators)} actuators")
        super().__post_init__()

    def check_settings(self) -> None:
        """Check the settings as `PID.check_settings` does. An array must have a number for each sensor."""
        super().check_settings()
        for name in ("gain", "integral_time", "derivative_time", "filter_time"):
            if np.shape(getattr(self, name)) not in ((), (len(self.sensors),)):
                raise DeclarationError(f"VectorServo.{name} must be a number, or an array of {len(self.sensors)}")

    @property
    def numbers(self) -> Mapping[str, Number]:
        units = {sensor.units for sensor in self.sensors}
        return {**super().numbers, "largest_error": Number(units.pop() if len(units) == 1 else "", shown=True)}

    def loops(self) -> Mapping[str, tuple[Any, ...]]:
        return {str(n): pair for n, pair in enumerate(zip(self.sensors, self.actuators, strict=True))}

    def control(
        self, setpoint: float | FloatArray, *, dt: float, accept: Accept = (), enabled: BoolArray | None = None
    ) -> bool:
        """Carry out one period of `dt` s: read, compute, write. Returns False if an output was limited or an actuator
        is inhibited.

        `setpoint` is an array of shape (n,), or one number for all sensors. Raises BadInput if the quality of one of
        the sensors is not accepted, RangeError if a number is not finite; then nothing is written and the law is
        unchanged.

        `enabled`: booleans of shape (n,). Where it is False, the quality of the sensor is not checked, the actuator is
        not written, the integral is held and the error is 0. Default: all are enabled.
        """
        if enabled is not None and self.sensors.mask(enabled).all():
            enabled = None
        measurement = value_of(self.sensors, accept, where=enabled)
        if enabled is not None:
            measurement, setpoint = np.where(enabled, measurement, 0.0), np.where(enabled, setpoint, 0.0)
        low, high = self._reach(dt)
        integral = self.integral
        output = self.step(setpoint, measurement, dt, low=low, high=high)
        taken = False
        try:
            taken = self.actuators.write(output, where=enabled)
        finally:
            if enabled is not None:
                self._hold(~enabled, integral)
            if not taken:
                self.integral = np.where(self.actuators.pending == output, self.integral, integral)
        return taken and not np.count_nonzero(self.limited)

    def _hold(self, excluded: BoolArray, integral: FloatArray) -> None:
        self.integral = np.where(excluded, integral, self.integral)
        self.limited = self.limited & ~excluded
        if self._last is not None:
            self._last = np.where(excluded, np.nan, self._last)
            self._rate = np.where(excluded, 0.0, self._rate)

    def _reach(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest outputs of this period."""
        limits = self.actuators._located().limits
        assert limits is not None
        low, high = limits.minimum, limits.maximum
        if not dt or limits.slew_rate is None:
            return low, high
        rate = limits.slew_rate
        now = self.actuators.read()
        return np.maximum(low, now - rate * dt), np.minimum(high, now + rate * dt)

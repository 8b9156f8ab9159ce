"""A servo: PID in the standard form, with what real axes need (Astrom and Murray, Feedback Systems, ch. 11)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import copysign, inf

from umo.control.inputs import Accept, value_of
from umo.objects import DigitalActuator, DigitalSensor


@dataclass
class Servo:
    """u = gain (e + 1/integral_time int(e) dt - derivative_time dy/dt) + feed-forward, e = setpoint - y.

    The derivative acts on the measured value, through a first-order filter. Anti-windup: the integral is held
    while `write` returns False (the output was limited), and is corrected to the output that the actuator's
    `read` shows as accepted. All times are in s. Gains do not depend on the sampling period, as long as it is
    short compared with these times.
    """

    sensor: DigitalSensor
    actuator: DigitalActuator
    gain: float
    """Actuator units for one sensor unit."""
    integral_time: float = inf
    derivative_time: float = 0.0
    filter_time: float = 0.0
    """Time constant of the derivative's filter."""
    feed_forward: float = 0.0
    """Actuator units for one sensor unit per second of setpoint velocity."""
    inertia: float = 0.0
    """Actuator units for one sensor unit per second squared of setpoint acceleration."""
    friction: float = 0.0
    """Actuator units that overcome dry friction; given with the sign of the setpoint velocity."""
    error: float = field(default=0.0, init=False)
    """The last setpoint minus value, in sensor units."""
    _integral: float = field(default=0.0, init=False)
    _last: float | None = field(default=None, init=False)
    _rate: float = field(default=0.0, init=False)
    _asked: float | None = field(default=None, init=False)

    def begin(self) -> None:
        """Clear the state. Call it before the servo takes over an axis, and after its sensor was referenced."""
        self._integral = self._rate = self.error = 0.0
        self._last = self._asked = None

    def control(
        self,
        setpoint: float,
        velocity: float = 0.0,
        acceleration: float = 0.0,
        *,
        dt: float,
        accept: Accept = (),
    ) -> bool:
        """One period of `dt` s: read, compute, write. False if the output was limited.

        With `dt` = 0 (a machine without a timer) integral and derivative do not contribute.
        Raises BadInput when the sensor's quality is not accepted.
        """
        value = value_of(self.sensor, accept)
        error = self.error = setpoint - value
        if self._asked is not None and (refused := self.actuator.read() - self._asked):
            self._integral += refused * min(1.0, dt / self.integral_time)  # back to what the actuator accepted
        integral_step = self.gain * error * dt / self.integral_time
        output = (
            self.gain * (error - self.derivative_time * self._filtered_rate(value, dt))
            + self._integral
            + integral_step
            + self.feed_forward * velocity
            + self.inertia * acceleration
        )
        if velocity:
            output += copysign(self.friction, velocity)
        taken = self.actuator.write(output)
        if taken or integral_step * output < 0:
            self._integral += integral_step
        self._asked = output
        return taken

    def _filtered_rate(self, value: float, dt: float) -> float:
        last, self._last = self._last, value
        if not dt:
            return 0.0
        rate = 0.0 if last is None else (value - last) / dt
        self._rate += (rate - self._rate) * dt / (self.filter_time + dt)
        return self._rate

"""A servo: a PID from a sensor to an actuator, with feed-forward of the setpoint's motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from math import copysign

from umo.control.inputs import Accept, value_of
from umo.control.pid import PID
from umo.objects import DigitalActuator, DigitalSensor


@dataclass
class Servo(PID):
    """A PID on objects: it reads the sensor and writes the actuator.

        self.servo = Servo(self.encoder, self.motor, gain=0.02, integral_time=0.1)

    The output is limited to the range of the actuator and to what its slew rate allows in the period. The integral is
    held while the actuator is inhibited.
    """

    sensor: DigitalSensor
    actuator: DigitalActuator
    _: KW_ONLY
    feed_forward: float = 0.0
    """Actuator units for one sensor unit per second of setpoint velocity."""
    inertia: float = 0.0
    """Actuator units for one sensor unit per second squared of setpoint acceleration."""
    friction: float = 0.0
    """Actuator units that overcome dry friction; given with the sign of the setpoint velocity."""

    @property
    def signals(self) -> Mapping[str, str]:
        return {"setpoint": self.sensor.units, "error": self.sensor.units}

    def control(
        self,
        setpoint: float,
        velocity: float = 0.0,
        acceleration: float = 0.0,
        *,
        dt: float,
        accept: Accept = (),
    ) -> bool:
        """One period of `dt` s: read, compute, write. False if the output was limited or the actuator is inhibited.

        Raises BadInput if the sensor's quality is not accepted.
        """
        measurement = value_of(self.sensor, accept)
        feed_forward = self.feed_forward * velocity + self.inertia * acceleration
        if velocity:
            feed_forward += copysign(self.friction, velocity)
        low, high = self._reach(dt)
        integral = self.integral
        output = self.step(setpoint, measurement, dt, feed_forward=feed_forward, low=low, high=high)
        if self.actuator.write(output):
            return not self.limited
        self.integral = integral
        return False

    def _reach(self, dt: float) -> tuple[float, float]:
        """The lowest and highest output of this period."""
        actuator = self.actuator
        low, high = actuator.minimum, actuator.maximum
        if actuator.slew_rate is None or not dt:
            return low, high
        now, step = actuator.read(), actuator.slew_rate * dt
        return max(low, now - step), min(high, now + step)

"""Cascades: PIDs from sensors to the setpoints of inner laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any

from umo.control.checks import check_numbers
from umo.control.inputs import Accept, value_of
from umo.control.pid import PID
from umo.control.servo import Servo
from umo.errors import DeclarationError
from umo.objects import DigitalSensor, Number


@dataclass
class Cascade(PID):
    """The outer PID of a cascade: it reads its sensor, gives the inner law a setpoint, and calls the inner law.

        self.jacket = Servo(self.jacket_temperature, self.heater, gain=2.0, integral_time=60.0)
        self.vessel = Cascade(self.temperature, self.jacket, low=20.0, high=150.0, gain=3.0, integral_time=900.0)

    Call only `control` of the outer law, once per period. While the inner law is limited, or its actuator is inhibited,
    the integral does not grow further in the direction of the limit.
    """

    sensor: DigitalSensor
    inner: Servo
    _: KW_ONLY
    low: float
    """The lowest setpoint of the inner law, in the units of its sensor."""
    high: float
    """The highest setpoint of the inner law."""

    def check_settings(self) -> None:
        """Check the settings as `PID.check_settings` does. `low` and `high` must be finite, and `low` below `high`."""
        super().check_settings()
        check_numbers(self, finite=("low", "high"))
        if not self.low < self.high:
            raise DeclarationError(f"Cascade: low {self.low!r} must be below high {self.high!r}")

    @property
    def numbers(self) -> Mapping[str, Number]:
        shown = Number(self.sensor.units, shown=True)
        return {**super().numbers, "setpoint": shown, "error": shown}

    def loops(self) -> Mapping[str, tuple[Any, ...]]:
        return {"": (self.sensor, self.inner)}

    def control(self, setpoint: float, *, feed_forward: float = 0.0, dt: float, accept: Accept = ()) -> bool:
        """Carry out one period of `dt` s of both laws: read, compute, read, compute, write. Returns False if the inner
        law was limited, or its actuator is inhibited.

        `feed_forward` is added to the setpoint of the inner law. The errors are those of `Servo.control`; an error
        leaves the integrals unchanged.
        """
        measurement = value_of(self.sensor, accept)
        integral = self.integral
        wanted = self.step(setpoint, measurement, dt, feed_forward=feed_forward, low=self.low, high=self.high)
        followed, reached = False, False
        try:
            followed = self.inner.control(wanted, dt=dt, accept=accept)
            reached = True
        finally:
            if not reached or (not followed and (self.integral - integral) * self.inner.error > 0.0):
                self.integral = integral
        return followed

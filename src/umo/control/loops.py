"""Loops of laws: a `PID`, or one element of a `VectorPID`. An experiment can replace the result of the `step` of such a
law."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from typing import Any, Protocol

import numpy as np

from umo.control.loop_output import LoopOutput, outer_laws, output_of
from umo.objects import Compound, DigitalSensor

SETTINGS = ("gain", "integral_time", "derivative_time", "filter_time")
Next = Callable[[float, float, float, float, float], float | None]
"""Function that returns another output, or None for the law's own output. Its arguments are the law's output, the
measurement, the period in s, and the lower and upper bounds of the output."""


class ControlLoop(Protocol):
    """One loop, with its sensor and its output if the law names them."""

    sensor: DigitalSensor | None
    output: LoopOutput | None

    @property
    def gains(self) -> dict[str, float]:
        """The settings of the law by name."""

    @property
    def measured_range(self) -> float:
        """The width of the sensor's range; 0 if the range is not known."""

    @property
    def resolution(self) -> float:
        """The resolution of the sensor in its units; 0 if it is not known."""

    @property
    def is_taken(self) -> bool: ...
    @property
    def outer(self) -> list[ControlLoop]:
        """The loops whose output is the setpoint of this loop."""

    def bounds(self, low: float, high: float) -> tuple[float, float]:
        """Return the range of the output, without the slew rate: `low` and `high` are the bounds in this period."""

    def take(self, next_: Next) -> None:
        """Take the output of each step from this function. The law's integral is held while the function returns an
        output."""

    def give_back(self) -> None:
        """Return control to the law."""


class _Loop:
    """The common part of loops."""

    def __init__(self, part: Compound, law: Any, sensor: DigitalSensor | None = None, end: Any = None) -> None:
        """`end`: the receiver of the law's output, an actuator or an inner law."""
        self._law, self._part = law, part
        self.sensor, self.output = sensor, output_of(part, law, end)

    @property
    def measured_range(self) -> float:
        width = 0.0 if self.sensor is None else self.sensor.maximum - self.sensor.minimum
        return width if isfinite(width) else 0.0

    @property
    def resolution(self) -> float:
        sensor = self.sensor
        return 0.0 if sensor is None or sensor.linearization is not None else abs(float(sensor.resolution))

    @property
    def is_taken(self) -> bool:
        return "step" in vars(self._law)

    @property
    def outer(self) -> list[ControlLoop]:
        return [LawLoop(self._part, law, *law.loops()[""]) for law in outer_laws(self._part, self._law)]

    def bounds(self, low: float, high: float) -> tuple[float, float]:
        return (low, high) if self.output is None else self.output.bounds(getattr(self._law, "limit", inf))

    def give_back(self) -> None:
        vars(self._law).pop("step", None)


class LawLoop(_Loop):
    """The loop of a `PID`."""

    @property
    def gains(self) -> dict[str, float]:
        return {name: float(getattr(self._law, name)) for name in SETTINGS}

    def take(self, next_: Next) -> None:
        law = self._law
        of_law: Callable[..., float] = law.step

        def step(
            setpoint: float,
            measurement: float,
            dt: float,
            *,
            feed_forward: float = 0.0,
            low: float = -inf,
            high: float = inf,
        ) -> float:
            integral = law.integral
            output = of_law(setpoint, measurement, dt, feed_forward=feed_forward, low=low, high=high)
            instead = next_(output, measurement, dt, low, high)
            if instead is None:
                return output
            law.integral, law.limited = integral, False
            return instead

        law.step = step


class ElementLoop(_Loop):
    """The loop of one element of a `VectorPID`. The loops of the other elements continue."""

    def __init__(
        self, part: Compound, law: Any, place: int, sensor: DigitalSensor | None = None, end: Any = None
    ) -> None:
        super().__init__(part, law, sensor, end)
        self._place = place

    @property
    def gains(self) -> dict[str, float]:
        return {name: self._own(getattr(self._law, name)) for name in SETTINGS}

    def _own(self, numbers: Any) -> float:
        found = np.ravel(numbers)
        return float(found[self._place if len(found) > 1 else 0])

    def take(self, next_: Next) -> None:
        law, own, place = self._law, self._own, self._place
        of_law = law.step

        def step(setpoint: Any, measurement: Any, dt: float, *, low: Any = -inf, high: Any = inf, **more: Any) -> Any:
            integral = own(law.integral)
            output = of_law(setpoint, measurement, dt, low=low, high=high, **more)
            instead = next_(float(output[place]), float(measurement[place]), dt, own(low), own(high))
            if instead is not None:
                output[place] = instead
                law.integral[place], law.limited[place] = integral, False
            return output

        law.step = step

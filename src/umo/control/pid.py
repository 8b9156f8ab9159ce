"""PID control on plain numbers and arrays (Astrom and Murray, Feedback Systems, ch. 11)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from umo.control.checks import check_numbers
from umo.errors import RangeError
from umo.objects import Number
from umo.objects.scaling import BoolArray, FloatArray

if TYPE_CHECKING:
    from umo.objects import Compound

TIMES = ("derivative_time", "filter_time")


@dataclass(kw_only=True)
class PID:
    """u = gain (e + 1/integral_time int(e) dt - derivative_time dy/dt) + feed-forward, e = setpoint - measurement.

        level = PID(gain=0.3, integral_time=20.0)
        output = level.step(300.0, measured, dt, low=0.0, high=10.0)

    The derivative acts on the measurement, through a first-order filter. Anti-windup is conditional integration: while
    the output is limited, the integral changes only in the direction that leads back into the range (Astrom and
    Hagglund, Advanced PID Control, 2006, section 3.5). All times are in s. Gains do not depend on the sampling period,
    as long as it is short compared with these times. Gains may be changed at any time. Raises DeclarationError for
    values that `check_settings` refuses.
    """

    gain: float
    """Units of the output for one unit of the measurement. Negative if a larger output makes the measurement fall."""
    integral_time: float = inf
    """Time constant of the integral part, s. Default: no integral part."""
    derivative_time: float = 0.0
    filter_time: float = 0.0
    """Time constant of the derivative's filter."""
    setpoint: float = field(default=nan, init=False)
    """The last setpoint; NaN before the first."""
    error: float = field(default=0.0, init=False)
    """The last setpoint minus measurement."""
    integral: float = field(default=0.0, init=False)
    """The integral part of the output."""
    limited: bool = field(default=False, init=False)
    """True if the last output was limited."""
    _last: float | None = field(default=None, init=False, repr=False)
    _rate: float = field(default=0.0, init=False, repr=False)

    def __post_init__(self) -> None:
        self.check_settings()

    def check_settings(self) -> None:
        """Check the settings. Raises DeclarationError unless the gain is finite, the times are not negative and the
        integral time is above 0."""
        check_numbers(self, finite=("gain",), not_negative=TIMES, above_0=("integral_time",))

    def reset(self) -> None:
        """Clear the state: the next `step` is the first."""
        self.error = self.integral = self._rate = 0.0
        self.setpoint = nan
        self.limited, self._last = False, None

    @property
    def numbers(self) -> Mapping[str, Number]:
        """The numbers that are shown in addition to the settings, and the units of the settings."""
        return {"setpoint": Number(shown=True), "error": Number(shown=True), **_times()}

    def loops(self) -> Mapping[str, tuple[Any, ...]]:
        """Return the loops of the law by the last parts of their paths ("" for the law itself), each with its sensor
        and actuator if the law has them. An outer law has its inner law instead of an actuator."""
        return {"": ()}

    def experiments(self, part: Compound, path: str, loop: str) -> Any:
        """Return the experiments on one of the law's loops, as an object with actions (`umo.control.experiment`)."""
        from umo.control.experiment import LoopExperiments
        from umo.control.loops import LawLoop

        return LoopExperiments(part, path, LawLoop(part, self, *self.loops()[loop]))

    def take_over(self, output: float, setpoint: float, measurement: float, feed_forward: float = 0.0) -> None:
        """Clear the state, and set the integral so that control continues from this output without a step (bumpless
        transfer). Raises RangeError if a number is not finite."""
        integral = output - self.gain * (setpoint - measurement) - feed_forward
        if not isfinite(integral):
            raise RangeError(f"output {output!r}, setpoint {setpoint!r} and measurement {measurement!r} must be finite")
        self.reset()
        self._last, self.integral = measurement, integral

    def shift(self, distance: float) -> None:
        """Move the origin of the measurement by this distance, without an effect on the derivative. Raises RangeError
        if the distance is not finite."""
        if not isfinite(distance):
            raise RangeError(f"the measurement cannot be shifted by {distance!r}")
        if self._last is not None:
            self._last += distance

    def step(
        self,
        setpoint: float,
        measurement: float,
        dt: float,
        *,
        feed_forward: float = 0.0,
        low: float = -inf,
        high: float = inf,
    ) -> float:
        """Return the output of one period of `dt` s, from `low` to `high`. With `dt` = 0 (a machine without a timer)
        integral and derivative do not contribute. Raises RangeError if a number is not finite; then the law is
        unchanged."""
        error = setpoint - measurement
        try:
            growth = self.gain * error * dt / self.integral_time
            rate = self._filtered_rate(measurement, dt)
        except ZeroDivisionError:
            raise RangeError(f"the output cannot be computed with these settings: {self!r}") from None
        output = self.gain * (error - self.derivative_time * rate) + self.integral + growth + feed_forward
        inside = low <= output <= high
        if not isfinite(output) or not (inside or (low < inf and high > -inf)):  # one of its numbers is not finite
            raise RangeError(
                f"the output is not finite: setpoint {setpoint!r}, measurement {measurement!r}, "
                f"feed-forward {feed_forward!r}, period {dt!r} s, range {low!r} to {high!r}"
            )
        self.setpoint, self.error, self._last = setpoint, error, measurement
        if dt:
            self._rate = rate
        if inside:
            self.limited = False
            self.integral += growth
            return output
        self.limited = True
        if output > high:
            if growth < 0.0:  # what would lead further out is left out
                self.integral += growth
            return high
        if growth > 0.0:
            self.integral += growth
        return low

    def _filtered_rate(self, measurement: float, dt: float) -> float:
        if not dt:
            return 0.0
        rate = 0.0 if self._last is None else (measurement - self._last) / dt
        return self._rate + (rate - self._rate) * dt / (self.filter_time + dt)


@dataclass(kw_only=True, eq=False)
class VectorPID:
    """Many PIDs in one calculation on arrays: the same law as `PID`, element by element. Gains and times are numbers
    for all elements, or arrays of shape (n,). `measurement` is an array of shape (n,), and so is the output. While all
    derivative times are 0, no derivative is computed. The derivative begins again with the first step in which one of
    them is above 0."""

    gain: float | FloatArray
    integral_time: float | FloatArray = inf
    derivative_time: float | FloatArray = 0.0
    filter_time: float | FloatArray = 0.0
    error: FloatArray = field(default_factory=lambda: np.zeros(1), init=False)
    """The last setpoints minus measurements."""
    integral: FloatArray = field(default_factory=lambda: np.zeros(1), init=False)
    limited: BoolArray = field(default_factory=lambda: np.zeros(1, np.bool_), init=False)
    """An array that is True for each output that was limited in the last step."""
    _last: FloatArray = field(default_factory=lambda: np.full(1, np.nan), init=False, repr=False)
    """The last measurement of each element; NaN if the next measurement is the first."""
    _rate: FloatArray = field(default_factory=lambda: np.zeros(1), init=False, repr=False)

    def __post_init__(self) -> None:
        self.check_settings()

    def check_settings(self) -> None:
        """Check the settings as `PID.check_settings` does."""
        check_numbers(self, finite=("gain",), not_negative=TIMES, above_0=("integral_time",), arrays=True)

    def reset(self) -> None:
        """Clear the state: the next `step` is the first."""
        self.error, self.integral, self._rate = np.zeros(1), np.zeros(1), np.zeros(1)
        self.limited, self._last = np.zeros(1, np.bool_), np.full(1, np.nan)

    @property
    def numbers(self) -> Mapping[str, Number]:
        """The numbers of `PID.numbers`, without times that are arrays."""
        times = {name: each for name, each in _times().items() if not isinstance(getattr(self, name), np.ndarray)}
        return {"largest_error": Number(shown=True), **times}

    def loops(self) -> Mapping[str, tuple[Any, ...]]:
        """Return the loops of the law, as in `PID.loops`, one for each calculated element."""
        return {str(number): () for number in range(self.error.size)}

    def experiments(self, part: Compound, path: str, loop: str) -> Any:
        """Return the experiments on a loop, as `PID.experiments` does."""
        from umo.control.experiment import LoopExperiments
        from umo.control.loops import ElementLoop

        return LoopExperiments(part, path, ElementLoop(part, self, int(loop), *self.loops()[loop]))

    @property
    def largest_error(self) -> float:
        """The largest magnitude of the last errors."""
        return float(np.abs(self.error).max())

    def step(
        self,
        setpoint: float | FloatArray,
        measurement: FloatArray,
        dt: float,
        *,
        feed_forward: float | FloatArray | None = None,
        low: float | FloatArray = -inf,
        high: float | FloatArray = inf,
    ) -> FloatArray:
        """Return the outputs of one period of `dt` s, each from `low` to `high`. Raises RangeError if a number is not
        finite; then the law is unchanged."""
        error = setpoint - measurement
        proportional = self.gain * error
        try:
            growth = proportional * (dt / self.integral_time)
        except ZeroDivisionError:
            raise RangeError(f"the output cannot be computed with integral_time={self.integral_time!r}") from None
        wanted = proportional + self.integral
        wanted += growth
        if feed_forward is not None:
            wanted += feed_forward
        rate = self._filtered_rate(measurement, dt) if self._has_derivative else None
        if rate is not None:
            wanted -= self.gain * self.derivative_time * rate
        _check_finite(wanted)
        output: FloatArray = np.maximum(wanted, low)
        np.minimum(output, high, out=output)
        excess = np.subtract(wanted, output, out=wanted)  # not finite where `low` or `high` is not a bound
        limited = excess != 0.0
        if np.count_nonzero(limited):  # a third of the time of any()
            _check_finite(excess)
            excess *= growth
            growth[excess > 0.0] = 0.0  # what would lead further out is left out
        self.error, self.limited = error, limited
        if rate is not None:
            self._last = measurement.copy()  # the caller may fill the same array anew
            if dt:
                self._rate = rate
        else:
            self._last, self._rate = np.full(1, np.nan), np.zeros(1)
        self.integral = self.integral + growth
        return output

    @property
    def _has_derivative(self) -> bool:
        return bool(self.derivative_time if isinstance(self.derivative_time, float) else np.any(self.derivative_time))

    def _filtered_rate(self, measurement: FloatArray, dt: float) -> FloatArray:
        if not dt:
            return np.zeros(1)
        rate = np.nan_to_num((measurement - self._last) / dt)
        filtered: FloatArray = self._rate + (rate - self._rate) * (dt / (self.filter_time + dt))
        return filtered


def _times() -> dict[str, Number]:
    return {name: Number("s", 0.0) for name in ("integral_time", *TIMES)}


def _check_finite(numbers: FloatArray) -> None:
    finite = np.isfinite(numbers)
    if np.count_nonzero(finite) != finite.size:
        others = np.count_nonzero(~finite) - 1
        more = f", and of {others} more" if others else ""
        what = "a setting, or the setpoint, measurement, feed-forward or range"
        raise RangeError(f"{what} of element {finite.argmin()}{more} is not finite")

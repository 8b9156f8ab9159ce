"""The facts about a loop to tune: its law, its sensor and actuator, its present gains."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

from umo.commissioning.tuning.margins import Gains
from umo.control.loops import SETTINGS
from umo.errors import PathError
from umo.objects.presentation.described import Described
from umo.text import did_you_mean


@dataclass(frozen=True)
class LawFacts:
    """The facts about a loop. `law` is the path of the loop, `base` is the path of the law that contains it."""

    law: str
    sensor: str
    actuator: str
    present: Gains
    dt: float
    """Time in s between two steps of the law."""
    axis: bool = False
    """True if the loop is the servo of an axis of motion."""
    units: tuple[str, str] = ("", "")
    """Units of the measurement and of the output."""
    ranges: tuple[float, float] = (inf, inf)
    """Widths of the ranges of the measurement and of the output."""
    resolution: float = 0.0
    """Resolution of the output."""
    inner: str = ""
    """The inner law, if this is the outer law of a cascade. The setpoint of the inner law is the output."""
    inner_sensor: str = ""

    @classmethod
    def of(cls, told: Mapping[str, Any], sensor: str = "", actuator: str = "") -> LawFacts:
        """Make the facts from the result of the action `law`; `sensor` and `actuator` have priority. Raises ValueError,
        TypeError or KeyError for another result."""
        present = Gains(**{name: inf if told[name] is None else float(told[name]) for name in SETTINGS})
        ends = sensor or str(told["sensor"]), actuator or str(told["actuator"])
        dt = float(told["dt"])
        if not (0.0 < dt < inf and isfinite(present.gain)):
            raise ValueError(f"the period {dt:g} s must be above 0 and finite, and the gain {present.gain:g} finite")
        times = present.derivative_time, present.filter_time
        if not (present.integral_time > 0.0 and all(0.0 <= each < inf for each in times)):
            raise ValueError(f"the times of the law are out of range: {present}")
        low, high = told.get("low"), told.get("high")
        span = inf if low is None or high is None else float(high) - float(low)
        found = cls(str(told["law"]), *ends, present, dt, bool(told["axis"]), ranges=(inf, span))
        return replace(found, inner=str(told.get("inner", "")), inner_sensor=str(told.get("inner_sensor", "")))

    @property
    def columns(self) -> list[str]:
        """The paths of a response: the output, the measurement, and for a cascade the inner measurement."""
        return [self.actuator, self.sensor, *filter(None, [self.inner_sensor])]

    @property
    def base(self) -> str:
        """The path of the law; for an element, the path of its VectorPID."""
        head, _, last = self.law.rpartition(".")
        return head if last.isdigit() and head else self.law

    def described(self, objects: Iterable[Described]) -> LawFacts:
        """Return the facts with units and ranges from the descriptions of the objects and signals. Raises PathError if
        sensor or actuator is not among them."""
        known = {each.path: each for each in objects}
        found: list[Described] = []
        for what, path in (("sensor", self.sensor), ("actuator", self.actuator)):
            if not path:
                raise PathError(f"{self.law} does not name its {what}: give --{what}")
            if path not in known or not known[path].is_number:
                raise PathError(f"there is no {what} {path!r} that has a number{did_you_mean(path, known)}")
            found.append(known[path])
        measured, output = found
        units = measured.unit, output.unit
        ranges = _width(measured, inf), _width(output, self.ranges[1])
        return replace(self, units=units, ranges=ranges, resolution=abs(float(output.resolution or 0.0)))


def _width(about: Described, otherwise: float) -> float:
    low, high = about.bounds
    return high - low if isfinite(high - low) else otherwise

"""Reduces samples to a minimum and a maximum per pixel, finds triggers, and computes measured values, with numpy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo.objects.scaling import FloatArray

HYSTERESIS = 0.1
"""Half the width of the band around the middle in which no crossing is counted, as a share of the peak-to-peak
value."""
MIN_SAMPLES_PER_PIXEL = 2.0
"""Number of samples per pixel from which on samples are reduced."""


@dataclass(frozen=True)
class Points:
    """The points of a drawing. Each has a time, and for each trace the smallest and the largest value; NaN if there is
    no value."""

    times: FloatArray
    low: FloatArray
    high: FloatArray
    """One row per trace. The same array as `low` if nothing was reduced."""


def reduced(times: FloatArray, values: FloatArray, step: float, period: float) -> Points:
    """Reduce samples (one row per trace) to one point for each interval of `step` s that has a sample. No minimum or
    maximum is lost.

    The time of a point is that of its first sample. Every sample is a point if `step` is below two periods.
    """
    if step < MIN_SAMPLES_PER_PIXEL * period or len(times) == 0:
        return Points(times, values, values)
    buckets = np.floor(times / step)
    first = np.flatnonzero(np.diff(buckets, prepend=np.nan) != 0)
    low, high = np.fmin.reduceat(values, first, axis=1), np.fmax.reduceat(values, first, axis=1)
    return Points(times[first], low, high)


def crossing(times: FloatArray, values: FloatArray, kind: str, level: float) -> float | None:
    """Return the time of the first sample that fulfils a trigger, or None if there is none.

    `rising`, `falling`: the first sample beyond the level after a sample that was not beyond it. `above`, `below`: the
    first sample beyond the level.
    """
    beyond = values > level if kind in ("rising", "above") else values < level
    if kind in ("rising", "falling"):
        beyond = beyond[1:] & ~beyond[:-1] & np.isfinite(values[:-1])
        times = times[1:]
    found = np.flatnonzero(beyond)
    return float(times[found[0]]) if len(found) else None


def measured(times: FloatArray, values: FloatArray) -> dict[str, Any] | None:
    """Return the minimum, maximum, mean and root mean square of all samples that have a value, in their unit, and the
    frequency in Hz. The frequency is None if it cannot be determined. Return None if no sample has a value."""
    known = np.isfinite(values)
    if not known.all():
        times, values = times[known], values[known]
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    rms = float(np.sqrt(np.mean(np.square(values))))
    found = {"minimum": low, "maximum": high, "mean": float(values.mean()), "rms": rms}
    return found | {"frequency": frequency(times, values, low, high)}


def measured_state(values: FloatArray) -> dict[str, Any] | None:
    """Return the share of a binary object's samples in which the electrical level is 1, and the number of changes.
    Return None if no sample has a value."""
    on = values[np.isfinite(values)] > 0.5
    if not len(on):
        return None
    return {"on": float(on.mean()), "changes": int(np.count_nonzero(on[1:] != on[:-1]))}


def frequency(times: FloatArray, values: FloatArray, low: float, high: float) -> float | None:
    """Return the frequency in Hz from the rising crossings of the middle, with a hysteresis. Return None for less than
    one full period."""
    middle, band = (low + high) / 2, (high - low) * HYSTERESIS
    outside = np.flatnonzero(np.abs(values - middle) > band)
    above = values[outside] > middle
    rising = times[outside[1:][above[1:] & ~above[:-1]]]
    return float((len(rising) - 1) / (rising[-1] - rising[0])) if len(rising) > 1 else None

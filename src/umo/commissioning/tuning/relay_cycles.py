"""The cycles of a relay experiment: ultimate gain and period (Astrom and Hagglund, Automatic tuning of simple
regulators, Automatica 20, 1984)."""

from __future__ import annotations

from cmath import phase as phase_of
from dataclasses import dataclass
from math import degrees, pi

import numpy as np

from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.errors import RangeError
from umo.objects.scaling import FloatArray
from umo.text import count_of

FEWEST_CYCLES = 2
"""Least number of whole cycles."""
MIN_HALF_CYCLE = 0.35
"""The least share of a cycle for each half. If a half is shorter, the process was not at rest at the beginning."""


@dataclass(frozen=True)
class RelayCycles:
    """The facts about a process from the cycles of a relay."""

    ultimate_period: float
    """Ultimate period in s."""
    ultimate_gain: float
    """Ultimate gain: units of the output for one unit of the measurement, without its sign."""
    phase: float
    """Phase of the process at this period, degrees: -180 plus the effect of the hysteresis."""
    cycles: int
    uneven: bool
    """True if the halves of the cycles differ much, because the output was not in the middle."""


def relay_cycles(response: MeasuredResponse, rising: bool = True) -> RelayCycles:
    """Evaluate the cycles of a relay from the fundamental waves of output and measurement over complete cycles with the
    full amplitude, without the first cycle. `rising`: whether a larger output makes the measurement rise. Raises
    RangeError if there are too few cycles."""
    high = _high(response.outputs)[: _full(response.outputs)]
    rises = np.flatnonzero(high[1:] & ~high[:-1]) + 1
    rises = rises[1:] if len(rises) > FEWEST_CYCLES + 1 else rises
    cycles = len(rises) - 1
    if cycles < FEWEST_CYCLES:
        raise RangeError(
            f"the relay made {count_of(max(cycles, 0), 'complete cycle')}, and {FEWEST_CYCLES} are needed: the process "
            "did not oscillate; a larger amplitude, less hysteresis or more time may help"
        )
    span = slice(rises[0], rises[-1])
    count = rises[-1] - rises[0]
    wave = np.exp(-2j * pi * cycles * np.arange(count) / count)
    output, measurement = wave @ response.outputs[span], wave @ response.measurements[span]
    share = float(high[span].mean())
    ratio = complex(measurement / output) * (1.0 if rising else -1.0)
    phase = degrees(phase_of(ratio))
    return RelayCycles(
        ultimate_period=float(count * response.dt / cycles),
        ultimate_gain=1.0 / max(abs(ratio), 1e-300),
        phase=phase if phase < 0.0 else phase - 360.0,
        cycles=int(cycles),
        uneven=min(share, 1.0 - share) < MIN_HALF_CYCLE,
    )


def _high(outputs: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return for each sample whether the relay is up. At an output in the middle it keeps its last state; before the
    experiment it is down."""
    low, top = float(outputs.min()), float(outputs.max())
    known = np.abs(outputs - (low + top) / 2) > (top - low) / 8
    last = np.maximum.accumulate(np.where(known, np.arange(len(outputs)), 0))
    found: np.ndarray[tuple[int], np.dtype[np.bool_]] = known[last] & (outputs[last] > (low + top) / 2)
    return found


def _full(outputs: FloatArray) -> int:
    """Return the number of samples until the relay goes up by a smaller amplitude
    (`umo.control.excitation.SMALLER`)."""
    low, top = float(outputs.min()), float(outputs.max())
    smaller = np.abs(outputs - (low + 0.75 * (top - low))) < (top - low) / 16
    return int(np.argmax(smaller)) + 1 if smaller.any() else len(outputs)

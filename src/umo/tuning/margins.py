"""Margins of a loop of a `PID` of umo and a process, from its frequency response, with its sampling (Astrom and Murray,
Feedback Systems, 2021, section 10.3)."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isinf, pi

import numpy as np

from umo.errors import RangeError
from umo.objects.scaling import FloatArray
from umo.tuning.models import Complex, ProcessModel

POINTS = 20_000
"""Frequencies at which a loop is looked at."""
DECADES = 7
"""Decades below the highest of them."""


@dataclass(frozen=True)
class Gains:
    """The settings of a `PID`, under its names and in its units."""

    gain: float
    integral_time: float = inf
    derivative_time: float = 0.0
    filter_time: float = 0.0

    def frequency_response(self, frequencies: FloatArray, dt: float) -> Complex:
        """Of the output to the error: that of `PID.step`, period for period."""
        back = np.exp(-1j * frequencies * dt)
        found = np.ones(len(frequencies), np.complex128)
        if not isinf(self.integral_time):
            found += dt / self.integral_time / (1.0 - back)
        if self.derivative_time:
            share = dt / (self.filter_time + dt)
            found += self.derivative_time * share * (1.0 - back) / dt / (1.0 - (1.0 - share) * back)
        return self.gain * found


@dataclass(frozen=True)
class LoopMargins:
    """How far a loop is from instability. It is unstable with a gain margin of 1, or a phase margin of 0, or less."""

    gain: float
    """Factor by which the gain may grow; infinite: any."""
    phase: float
    """Degrees by which the phase may fall; infinite: the gain of the loop is below 1 everywhere."""
    crossover: float = 0.0
    """The highest frequency at which the gain of the loop is 1, rad/s; 0: there is none."""

    def at_least(self, gain: float, phase: float) -> bool:
        return self.gain >= gain and self.phase >= phase


def margins(model: ProcessModel, gains: Gains, dt: float) -> LoopMargins:
    """The margins of the loop that is closed each `dt` s. RangeError if the signs of the gains differ: the loop drives
    the measurement away."""
    if gains.gain * model.gain <= 0.0:
        raise RangeError(f"a gain of {gains.gain:g} drives a process of gain {model.gain:g} away from its setpoint")
    highest = pi / dt * (1.0 - 1e-6)
    frequencies = np.geomspace(highest * 10.0**-DECADES, highest, POINTS)
    loop = model.frequency_response(frequencies, dt) * gains.frequency_response(frequencies, dt)
    size, phase = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
    phase -= 2.0 * pi * np.round((phase[0] + pi / 2) / (2.0 * pi))  # the lowest between -270 and 90 degrees
    at = _crossings(loop.imag, loop.real < 0.0)
    gain_margin = float(np.exp(-_between(size, *at).max())) if len(at[0]) else inf
    at = _crossings(size)
    if not len(at[0]):
        return LoopMargins(gain_margin, inf)
    phase_margin = float(np.degrees(_between(phase, *at).min() + pi))
    return LoopMargins(gain_margin, phase_margin, float(_between(frequencies, *at).max()))


def _crossings(
    values: FloatArray, where: np.ndarray[tuple[int], np.dtype[np.bool_]] | None = None
) -> tuple[FloatArray, FloatArray]:
    """The places before a change of sign, and the share of the way from each to the next."""
    changes = np.signbit(values[1:]) != np.signbit(values[:-1])
    if where is not None:
        changes &= where[1:] & where[:-1]
    places = np.flatnonzero(changes)
    return places, values[places] / (values[places] - values[places + 1])  # type: ignore[return-value]


def _between(values: FloatArray, places: FloatArray, shares: FloatArray) -> FloatArray:
    before = places.astype(np.int64)
    return values[before] + shares * (values[before + 1] - values[before])

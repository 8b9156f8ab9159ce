"""Models of processes: a gain, up to two lags or an integrator, and a dead time; sampled exactly, with a held output.

first order         K exp(-L s) / (T s + 1)
second order        K exp(-L s) / ((T1 s + 1) (T2 s + 1))
integrator          K exp(-L s) / s
lagged integrator   K exp(-L s) / (s (T s + 1))
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, expm1, floor, inf, isinf

import numpy as np
import numpy.typing as npt

from umo.objects.scaling import FloatArray

Complex = npt.NDArray[np.complex128]
FIRST_ORDER, SECOND_ORDER = "first order", "second order"
INTEGRATOR, LAGGED_INTEGRATOR = "integrator", "lagged integrator"
LAGS: Mapping[str, int] = {INTEGRATOR: 0, FIRST_ORDER: 1, LAGGED_INTEGRATOR: 1, SECOND_ORDER: 2}
"""The kinds of models, the simplest first, with their numbers of lags."""
APART = 1e-4
"""Relative difference of two lags at least: equal ones have no partial fractions."""


@dataclass(frozen=True)
class ProcessModel:
    """A linear model from the output of a law to its measurement, about a point of operation."""

    kind: str
    """One of `LAGS`."""
    gain: float
    """Units of the measurement for one unit of the output; of an integrator units per s."""
    dead_time: float
    """s."""
    lags: tuple[float, ...] = ()
    """Time constants, s, the longest first."""

    @property
    def integrates(self) -> bool:
        return self.kind in (INTEGRATOR, LAGGED_INTEGRATOR)

    @property
    def slope(self) -> float:
        """Gain over the longest lag, of an integrator its gain: how fast the measurement begins to change."""
        return self.gain if self.integrates else self.gain / self.lags[0]

    @property
    def terms(self) -> list[tuple[float, float]]:
        """Its partial fractions: the weight and the time constant of each; infinite: an integrator."""
        if self.kind == FIRST_ORDER:
            return [(self.gain, self.lags[0])]
        if self.kind == INTEGRATOR:
            return [(self.gain, inf)]
        if self.kind == LAGGED_INTEGRATOR:
            return [(self.gain, inf), (-self.gain * self.lags[0], self.lags[0])]
        long, short = self.lags
        short = min(short, long * (1.0 - APART))
        share = self.gain / (long - short)
        return [(share * long, long), (-share * short, short)]

    def response(self, outputs: FloatArray, dt: float) -> FloatArray:
        """The change of the measurement under these outputs, one each `dt` s, from rest at the first of them."""
        changes = outputs - outputs[0]
        parts = [weight * sampled_response(changes, dt, lag, self.dead_time) for weight, lag in self.terms]
        return np.sum(parts, axis=0)  # type: ignore[no-any-return]

    def frequency_response(self, frequencies: FloatArray, dt: float) -> Complex:
        """At frequencies in rad/s below pi/dt: of the measurement sampled each `dt` s to the output held in between."""
        back = np.exp(-1j * frequencies * dt)
        found = np.zeros(len(frequencies), np.complex128)
        for weight, lag in self.terms:
            whole, first, second, kept = _held(self.dead_time, dt, lag)
            found += weight * (first + second * back) * back ** (whole + 1) / (1.0 - kept * back)
        return found

    def describe(self) -> dict[str, float]:
        """Its parameters by their letters."""
        letters = ["T"] if len(self.lags) == 1 else ["T1", "T2"]
        return {"K": self.gain, **dict(zip(letters, self.lags, strict=False)), "L": self.dead_time}


def sampled_response(changes: FloatArray, dt: float, lag: float, dead_time: float) -> FloatArray:
    """The response of a lag of gain 1 (infinite: an integrator) behind a dead time, from 0; outputs before the first
    are 0."""
    from scipy.signal import lfilter

    whole, first, second, kept = _held(dead_time, dt, lag)
    delay = whole + 1
    if delay >= len(changes):
        return np.zeros(len(changes))
    found = lfilter([first, second], [1.0, -kept], changes[: len(changes) - delay])
    return np.concatenate([np.zeros(delay), found])


def _held(dead_time: float, dt: float, lag: float) -> tuple[int, float, float, float]:
    """Whole periods of the dead time; the shares of the output that many periods ago and of the one before it in the
    change of a period; the share of the state that is kept (Franklin, Powell and Workman, Digital Control of Dynamic
    Systems, 1998, section 4.3)."""
    periods = dead_time / dt
    whole = floor(periods + 1e-9)
    rest = max(periods - whole, 0.0)
    if isinf(lag):
        return whole, (1.0 - rest) * dt, rest * dt, 1.0
    ratio = dt / lag
    kept = exp(-ratio)
    first = -expm1(-(1.0 - rest) * ratio)
    return whole, first, exp(-(1.0 - rest) * ratio) - kept, kept

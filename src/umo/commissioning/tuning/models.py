"""Models of processes, sampled exactly, with a held output.

integrator                     K exp(-L s) / s                               IPDT
first order                    K exp(-L s) / (T s + 1)                       FOPDT
lagged integrator              K exp(-L s) / (s (T s + 1))
second order                   K exp(-L s) / ((T1 s + 1) (T2 s + 1))         SOPDT
third order                    K exp(-L s) / ((T1 s + 1) (T2 s + 1)^2)
oscillating                    K exp(-L s) / (T^2 s^2 + 2 D T s + 1)
oscillating integrator         K exp(-L s) / (s (T^2 s^2 + 2 D T s + 1))
second order with a zero       K (Z s + 1) exp(-L s) / ((T1 s + 1) (T2 s + 1))
lagged integrator with a zero  K (Z s + 1) exp(-L s) / (s (T s + 1))
unstable                       K exp(-L s) / (T s - 1)

A negative Z is an inverse response.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from umo.objects.scaling import FloatArray

Complex = npt.NDArray[np.complex128]


class Structure(NamedTuple):
    """The parts of a kind of model."""

    integrates: bool
    lags: int
    oscillates: bool = False
    has_zero: bool = False
    unstable: bool = False
    repeats: bool = False
    """True if the last lag occurs twice."""


INTEGRATOR, LAGGED_INTEGRATOR = "integrator", "lagged integrator"
FIRST_ORDER, SECOND_ORDER, THIRD_ORDER = "first order", "second order", "third order"
OSCILLATING, OSCILLATING_INTEGRATOR, UNSTABLE = "oscillating", "oscillating integrator", "unstable"
SECOND_ORDER_ZERO, INTEGRATOR_ZERO = "second order with a zero", "lagged integrator with a zero"
STRUCTURES: Mapping[str, Structure] = {
    INTEGRATOR: Structure(True, 0),
    FIRST_ORDER: Structure(False, 1),
    LAGGED_INTEGRATOR: Structure(True, 1),
    SECOND_ORDER: Structure(False, 2),
    THIRD_ORDER: Structure(False, 2, repeats=True),
    OSCILLATING: Structure(False, 1, oscillates=True),
    OSCILLATING_INTEGRATOR: Structure(True, 1, oscillates=True),
    INTEGRATOR_ZERO: Structure(True, 1, has_zero=True),
    SECOND_ORDER_ZERO: Structure(False, 2, has_zero=True),
    UNSTABLE: Structure(False, 1, unstable=True),
}
"""The kinds of models, the simplest first."""
MIN_LAG_DIFFERENCE = 1e-3
"""The least relative difference of two lags, because equal lags have no partial fractions."""


@dataclass(frozen=True)
class ProcessModel:
    """A linear model from the output of a law to its measurement, about a point of operation."""

    kind: str
    """One of `STRUCTURES`."""
    gain: float
    """Units of the measurement for one unit of the output; for an integrator, units per s."""
    dead_time: float
    """Dead time in s."""
    lags: tuple[float, ...] = ()
    """Time constants, s, the longest first."""
    damping: float = 1.0
    """Damping of an oscillating model: below 1."""
    zero: float = 0.0
    """Time constant of the zero, s; negative for an inverse response."""

    @property
    def structure(self) -> Structure:
        return STRUCTURES[self.kind]

    @property
    def integrates(self) -> bool:
        return self.structure.integrates

    @property
    def slope(self) -> float:
        """The gain divided by the longest lag, or the gain of an integrator. It says how fast the measurement begins to
        change."""
        return self.gain if self.integrates else self.gain / self.lags[0]

    @property
    def poles(self) -> list[complex]:
        """The poles in 1/s, with both of each conjugate pair."""
        found: list[complex] = [0.0] * self.integrates
        if self.structure.oscillates:
            pole = complex(-self.damping, max(1.0 - self.damping**2, 1e-6) ** 0.5) / self.lags[0]
            return [*found, pole, pole.conjugate()]
        if self.structure.unstable:
            return [1.0 / self.lags[0]]
        lags = list(self.lags)
        if len(lags) == 2:
            lags[1] = min(lags[1], lags[0] * (1.0 - MIN_LAG_DIFFERENCE))
        if self.structure.repeats:
            lags.append(lags[1] * (1.0 - MIN_LAG_DIFFERENCE))
        return found + [-1.0 / lag for lag in lags]

    @property
    def terms(self) -> list[tuple[complex, complex]]:
        """The partial fractions of the model: weight / (s - pole)."""
        poles = self.poles
        scale = self.gain * float(np.prod([abs(each) for each in poles if each]))
        found = []
        for pole in poles:
            others = np.prod([pole - each for each in poles if each != pole])
            found.append((complex(scale * (1.0 + self.zero * pole) / others), complex(pole)))
        return found

    def response(self, outputs: FloatArray, dt: float) -> FloatArray:
        """Return the change of the measurement under these outputs, one every `dt` s, from rest at the first output.
        For an unstable model, return the response that ends at rest."""
        changes = outputs - outputs[0]
        parts = [weight * sampled_response(changes, dt, pole, self.dead_time) for weight, pole in self.terms]
        found: FloatArray = np.real(np.sum(parts, axis=0))
        return found

    def frequency_response(self, frequencies: FloatArray, dt: float) -> Complex:
        """Return the response at frequencies in rad/s below pi/dt: of the measurement sampled each `dt` s to the output
        held in between."""
        back = np.exp(-1j * frequencies * dt)
        found = np.zeros(len(frequencies), np.complex128)
        for weight, pole in self.terms:
            whole, newer, older, kept = _held(self.dead_time, dt, pole)
            found += weight * (newer + older * back) * back ** (whole + 1) / (1.0 - kept * back)
        return found

    def describe(self) -> dict[str, float]:
        """Return the parameters by their letters."""
        structure = self.structure
        letters = ["T"] if structure.lags == 1 else ["T1", "T2"]
        found = {"K": self.gain, **dict(zip(letters, self.lags, strict=False))}
        if structure.oscillates:
            found["D"] = self.damping
        if structure.has_zero:
            found["Z"] = self.zero
        return {**found, "L": self.dead_time}


def sampled_response(changes: FloatArray, dt: float, pole: complex, dead_time: float) -> Complex:
    """Return the response of 1 / (s - pole) with a dead time, from 0; outputs before the first one are 0. For a pole in
    the right half-plane, return the response that ends at 0, because this response stays finite."""
    from scipy.signal import lfilter

    whole, newer, older, kept = _held(dead_time, dt, pole)
    delay = whole + 1
    if delay >= len(changes):
        return np.zeros(len(changes), np.complex128)
    driven = np.concatenate([np.zeros(delay), changes[: len(changes) - delay]])
    before = np.concatenate([[0.0], driven[:-1]])
    grown = newer * driven + older * before
    if pole.real > 0.0:
        found = -lfilter([0.0, 1.0 / kept], [1.0, -1.0 / kept], grown[::-1])[::-1]
    else:
        found = lfilter([1.0], [1.0, -kept], grown)
    return np.asarray(found, np.complex128)


def _held(dead_time: float, dt: float, pole: complex) -> tuple[int, complex, complex, complex]:
    """Return the number n of whole periods in the dead time, and three factors for the state after a period: that of
    the output n periods ago, that of the output n + 1 periods ago, and that of the state before (Franklin, Powell and
    Workman, Digital Control of Dynamic Systems, 1998, section 4.3)."""
    periods = dead_time / dt
    whole = floor(periods + 1e-9)
    rest = max(periods - whole, 0.0) * dt
    newer, older = _grown(pole, dt - rest), _grown(pole, rest)
    return whole, newer, older * _kept(pole, dt - rest), _kept(pole, dt)


def _kept(pole: complex, lasting: float) -> complex:
    return complex(np.exp(pole * lasting)) if pole.imag else complex(float(np.exp(pole.real * lasting)))


def _grown(pole: complex, lasting: float) -> complex:
    """Return the integral of exp(pole t) from 0 to this time."""
    return complex(np.expm1(pole * lasting) / pole) if pole else complex(lasting)

"""The stability margins of a loop of umo's `PID` and a process, or the worst of several processes. They are computed
from frequency responses that include the sampling. Stability is checked by Nyquist's criterion (Astrom and Murray,
Feedback Systems, 2021, sections 10.2 and 10.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isinf, pi

import numpy as np

from umo.commissioning.tuning.models import Complex, ProcessModel
from umo.errors import RangeError
from umo.objects.scaling import FloatArray

POINTS_PER_DECADE = 400
"""Number of frequencies per decade at which a loop is evaluated."""
DECADES = 9
"""Number of decades below the highest frequency."""


MOST_UNTURNED = 0.3
"""The largest permitted difference, in half turns, between the turns of a loop and the turns that the criterion
requires. The two differ because the loop is not evaluated below the lowest frequency."""
Indices = np.ndarray[tuple[int], np.dtype[np.int64]]


@dataclass(frozen=True)
class Gains:
    """The settings of a `PID`, under its names and in its units."""

    gain: float
    integral_time: float = inf
    derivative_time: float = 0.0
    filter_time: float = 0.0

    def frequency_response(self, frequencies: FloatArray, dt: float) -> Complex:
        """Return the response of the output to the error, as `PID.step` computes it in each period."""
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
    """The distance of a loop from instability. The loop is unstable if the gain margin is 1 or less, or the phase
    margin is 0 or less."""

    gain: float
    """The factor by which the gain can grow until the loop is unstable, or by which it can fall if that factor is
    smaller; infinite if the loop is stable with every gain."""
    phase: float
    """The number of degrees by which the phase can fall until the loop is unstable; infinite if the gain of the loop is
    below 1 at all frequencies."""
    crossover: float = 0.0
    """The highest frequency at which the gain of the loop is 1, rad/s, or 0 if there is none."""

    @property
    def stable(self) -> bool:
        return self.gain > 1.0 and self.phase > 0.0

    def at_least(self, gain: float, phase: float) -> bool:
        return self.gain >= gain and self.phase >= phase


UNSTABLE_LOOP = LoopMargins(0.0, 0.0)


def margins(model: ProcessModel, gains: Gains, dt: float) -> LoopMargins:
    """Return the margins of the loop that is closed each `dt` s. Raises RangeError if the signs of the gains differ,
    because then the loop drives the measurement away."""
    return SampledModels([model], dt).margins(gains)


class SampledModels:
    """Several models of one process, each of which may be the true one. The margins of a loop are those with the worst
    model."""

    def __init__(self, models: Sequence[ProcessModel], dt: float) -> None:
        self.gain, self.dt = models[0].gain, dt
        highest = pi / dt * (1.0 - 1e-6)
        self._frequencies = np.geomspace(highest * 10.0**-DECADES, highest, DECADES * POINTS_PER_DECADE)
        self._responses = np.array([each.frequency_response(self._frequencies, dt) for each in models])
        self.integrate = any(each.integrates for each in models)
        self.may_be_unstable = any(each.structure.unstable for each in models)
        self._integrators = np.array([float(each.integrates) for each in models])
        self._unstable = np.array([float(each.structure.unstable) for each in models])

    def margins(self, gains: Gains) -> LoopMargins:
        """Return the least margins, and the highest crossover. Raises RangeError if the signs of the gains differ."""
        if gains.gain * self.gain <= 0.0:
            raise RangeError(f"a gain of {gains.gain:g} drives a process of gain {self.gain:g} away from its setpoint")
        loops = self._responses * gains.frequency_response(self._frequencies, self.dt)
        if not self._are_stable(loops, gains):
            return UNSTABLE_LOOP
        size = np.log(np.abs(loops))
        rows, at, share = _crossings(loops.imag, loops.real < 0.0)
        gain_margin = float(np.exp(np.abs(_between(size, rows, at, share)).min(initial=inf)))
        rows, at, share = _crossings(size)
        if not len(at):
            return LoopMargins(gain_margin, inf)
        opposite = np.angle(-loops)  # the distance from -180 degrees
        phase_margin = float(np.degrees(np.abs(_between(opposite, rows, at, share)).min()))
        crossover = self._frequencies[at] * (self._frequencies[1] / self._frequencies[0]) ** share
        return LoopMargins(gain_margin, phase_margin, float(crossover.max()))

    def _are_stable(self, loops: Complex, gains: Gains) -> bool:
        """True if each loop encircles -1 as often as it has unstable poles (Nyquist). From the lowest to the highest
        frequency, the number 1 + loop must turn by pi for each unstable pole, and by pi / 2 for each integrator."""
        turned = np.unwrap(np.angle(1.0 + loops), axis=1)
        turns = (turned[:, -1] - turned[:, 0]) / pi
        integrators = self._integrators + (not isinf(gains.integral_time))
        return bool((np.abs(turns - self._unstable - integrators / 2.0) < MOST_UNTURNED).all())


def _crossings(
    values: FloatArray, where: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None = None
) -> tuple[Indices, Indices, FloatArray]:
    """Return for each change of sign along the rows: the row, the index before the change, and the share of the
    distance to the next index at which the change lies."""
    changes = np.signbit(values[:, 1:]) != np.signbit(values[:, :-1])
    if where is not None:
        changes &= where[:, 1:] & where[:, :-1]
    rows, at = np.nonzero(changes)
    before, after = values[rows, at], values[rows, at + 1]
    return rows, at, before / (before - after)


def _between(values: FloatArray, rows: Indices, at: Indices, share: FloatArray) -> FloatArray:
    return values[rows, at] + share * (values[rows, at + 1] - values[rows, at])

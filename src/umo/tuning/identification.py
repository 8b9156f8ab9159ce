"""Identification: the parameters of a model, with intervals, by least squares on a measured response (output error;
Ljung, System Identification, 1999, chapters 7 and 9).

Gain, initial state and drift enter linearly: for each dead time and lag they are solved for, and only the others are
searched (variable projection; Golub and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from umo.errors import RangeError
from umo.objects.scaling import FloatArray
from umo.tuning.measured_response import MeasuredResponse
from umo.tuning.models import INTEGRATOR, LAGGED_INTEGRATOR, LAGS, ProcessModel

CONFIDENCE = 1.96
"""Standard deviations of an interval of 95 %."""
COARSE = 400
"""Samples for the search on a grid."""
GRID_LAGS, GRID_DEAD_TIMES, STARTS = 14, 10, 3
UNREST = 0.003
"""Weight of what was not at rest at the beginning, beside a sample's 1: it is taken for small where it can be."""
LONGEST_LAG = 20.0
"""Durations of the response that a lag can have, at most."""
CLEARLY_BETTER = 10.0
"""Difference of Akaike's criterion from which on a model with more parameters is taken (Burnham and Anderson, 2002)."""
WORTH_IT = 0.1
"""Per cent by which its fit must be better."""
LEAST_SHARE = 0.02
"""Share of the samples that count as independent, at least."""
POOR_FIT = 50.0
"""Fit in per cent below which a model is refused."""


@dataclass(frozen=True)
class Identified:
    """A model and how well it is known."""

    model: ProcessModel
    intervals: dict[str, float]
    """Half of the interval of 95 % of each parameter, by its letter."""
    fit: float
    """100 (1 - |error| / |measurement - mean|), per cent."""
    criterion: float
    """Akaike's information criterion, for independent residuals."""
    predicted: FloatArray
    """The measurements as the model has them."""


def identify(response: MeasuredResponse, kinds: Sequence[str] = tuple(LAGS), sign: float = 0.0) -> Identified:
    """The simplest model that describes the response about as well as any. `sign`: that of its gain, if it is known.
    RangeError if none does."""
    thinned = response.thinned()
    found = [each for kind in kinds if (each := fit_model(kind, thinned, sign)) is not None]
    best = max(found, key=lambda each: each.fit, default=None)
    if best is None or best.fit < POOR_FIT:
        told = "" if best is None else f": the best describes {max(best.fit, 0.0):.0f} % of the response"
        raise RangeError(f"no model fits{told}; a longer response, a larger amplitude or less disturbance may help")
    found = [each for each in found if each.fit >= POOR_FIT]
    share = max(_independent_share(thinned.measurements - best.predicted), LEAST_SHARE)
    chosen = found[0]
    for each in found[1:]:
        better = share * (chosen.criterion - each.criterion) > CLEARLY_BETTER
        if better and each.fit - chosen.fit > WORTH_IT:
            chosen = each
    return chosen


def fit_model(kind: str, response: MeasuredResponse, sign: float = 0.0) -> Identified | None:
    """A model of this kind; None if there is none with a gain of this sign (0: of any)."""
    from scipy.optimize import least_squares

    starts = _starts(kind, response.thinned(COARSE), sign)
    low, high = _bounds(kind, response)
    best = None
    for start in starts:
        start = np.clip(start, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        result = least_squares(
            lambda searched: _residuals(kind, searched, response),
            start,
            bounds=(low, high),
            diff_step=1e-4,
            max_nfev=60,
        )
        if best is None or result.cost < best.cost:
            best = result
    if best is None:
        return None
    solved = _solve(kind, best.x, response)
    if not solved.gain * (sign or solved.gain) > 0.0:
        return None
    lags = tuple(sorted(np.exp(best.x[1:]).tolist(), reverse=True))
    model = ProcessModel(kind, solved.gain, float(best.x[0]), lags)
    return _judged(model, solved, response)


# The search ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solution:
    gain: float
    predicted: FloatArray
    columns: FloatArray
    """What enters linearly, the response of gain 1 first."""
    cost: float
    """Sum of the squares of the errors, and of what was not at rest."""


def _solve(kind: str, searched: FloatArray, response: MeasuredResponse) -> _Solution:
    """`searched`: the dead time, then the logarithms of the lags."""
    dt, times = response.dt, response.times
    lags = tuple(sorted(np.exp(searched[1:]).tolist(), reverse=True))
    unit = ProcessModel(kind, 1.0, max(float(searched[0]), 0.0), lags).response(response.outputs, dt)
    columns = [unit, np.ones(len(times))]
    if kind in (INTEGRATOR, LAGGED_INTEGRATOR):
        columns.append(times / response.duration)  # the output at which it stands still is not known
    else:
        columns += [np.exp(-times / lag) for lag in lags]  # it was not at rest when it began
    matrix = np.column_stack(columns)
    middle = float(response.measurements.mean())
    measured = response.measurements - middle
    unrest = np.zeros((len(columns) - 2, len(columns)))
    unrest[:, 2:] = np.eye(len(columns) - 2) * np.sqrt(UNREST * len(times))
    known, wanted = np.vstack([matrix, unrest]), np.concatenate([measured, np.zeros(len(unrest))])
    solution = np.linalg.lstsq(known, wanted, rcond=1e-12)[0]
    cost = float(np.sum((known @ solution - wanted) ** 2))
    return _Solution(float(solution[0]), middle + matrix @ solution, matrix, cost)


def _residuals(kind: str, searched: FloatArray, response: MeasuredResponse) -> FloatArray:
    return response.measurements - _solve(kind, searched, response).predicted


def _bounds(kind: str, response: MeasuredResponse) -> tuple[FloatArray, FloatArray]:
    lags = LAGS[kind]
    low = [0.0] + [log(0.2 * response.dt)] * lags
    high = [0.5 * response.duration] + [log(LONGEST_LAG * response.duration)] * lags
    return np.array(low), np.array(high)


def _starts(kind: str, response: MeasuredResponse, sign: float) -> list[FloatArray]:
    """The best points of a grid with a gain of this sign."""
    duration, dt = response.duration, response.dt
    dead_times = np.concatenate([[0.0], np.geomspace(dt, 0.4 * duration, GRID_DEAD_TIMES - 1)])
    lags = np.log(np.geomspace(dt, 5.0 * duration, GRID_LAGS))
    grid: list[list[float]] = [[dead] for dead in dead_times]
    if LAGS[kind] == 1:
        grid = [[dead, lag] for dead in dead_times for lag in lags]
    elif LAGS[kind] == 2:
        grid = [[dead, lag, lag + log(ratio)] for dead in dead_times for lag in lags for ratio in (0.05, 0.3, 0.9)]
    points = [np.array(each) for each in grid]
    found = [
        (solved.cost, place)
        for place, each in enumerate(points)
        if (solved := _solve(kind, each, response)).gain * sign >= 0.0
    ]
    return [points[place] for _, place in sorted(found)[:STARTS]]


# How well it is known --------------------------------------------------------------------------------------


def _judged(model: ProcessModel, solved: _Solution, response: MeasuredResponse) -> Identified:
    residuals = response.measurements - solved.predicted
    spread = response.measurements - response.measurements.mean()
    fit = 100.0 * (1.0 - float(np.linalg.norm(residuals) / max(float(np.linalg.norm(spread)), 1e-300)))
    count, parameters = len(residuals), solved.columns.shape[1] + 1 + len(model.lags)
    variance = max(float(np.mean(residuals**2)), 1e-300)
    criterion = count * log(variance) + 2.0 * parameters
    return Identified(model, _intervals(model, solved, response), fit, criterion, solved.predicted)


def _intervals(model: ProcessModel, solved: _Solution, response: MeasuredResponse) -> dict[str, float]:
    """From the slopes of the prediction by each parameter, for residuals that are alike from one to the next."""
    residuals = response.measurements - solved.predicted
    values = model.describe()
    slopes = [_slope(model, letter, response) for letter in values]
    matrix = np.column_stack([*slopes, solved.columns[:, 1:]])
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    normal = (matrix / scale).T @ (matrix / scale)
    freedom = max(len(residuals) - matrix.shape[1], 1)
    variance = float(residuals @ residuals) / freedom / _independent_share(residuals)
    spread = np.sqrt(np.clip(np.diag(np.linalg.pinv(normal, rcond=1e-14)), 0.0, None) * variance) / scale
    return dict(zip(values, (CONFIDENCE * spread).tolist(), strict=False))


def _slope(model: ProcessModel, letter: str, response: MeasuredResponse) -> FloatArray:
    values = model.describe()
    step = 1e-4 * max(abs(values[letter]), response.dt if letter != "K" else 1e-12)
    if letter == "K":
        return model.response(response.outputs, response.dt) / model.gain

    def at(value: float) -> FloatArray:
        changed = {**values, letter: value}
        lags = tuple(changed[each] for each in values if each.startswith("T"))
        moved = ProcessModel(model.kind, model.gain, changed["L"], lags)
        return moved.response(response.outputs, response.dt)

    below = max(values[letter] - step, 0.0 if letter == "L" else 1e-12)
    above = values[letter] + step
    return (at(above) - at(below)) / (above - below)


def _independent_share(residuals: FloatArray) -> float:
    """Share of residuals that count as independent, from the correlation of one with the next."""
    energy = float(residuals @ residuals)
    if not energy:
        return 1.0
    correlation = float(residuals[1:] @ residuals[:-1]) / energy
    correlation = min(max(correlation, 0.0), 0.99)
    return (1.0 - correlation) / (1.0 + correlation)

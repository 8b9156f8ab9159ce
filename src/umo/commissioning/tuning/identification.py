"""Identification: finding the models that describe a measured response, by least squares on the response (output error;
Ljung, System Identification, 1999, chapters 7, 9 and 16).

For each structure the best model is found, and the region of models that are no worse than noise explains: their sum of
squares stays below the limit of an F-test that counts only independent residuals. The models that fit equally well are
those of all regions within the limit of the best model of all structures. Margins are those of the worst of these
models.

Gain, zero, initial state and drift enter linearly. They are solved for at each dead time and lag, and only dead times
and lags are searched (variable projection; Golub and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import exp, log

import numpy as np

from umo.commissioning.tuning.measured_response import MAX_RESPONSE_SAMPLES, MeasuredResponse
from umo.commissioning.tuning.models import STRUCTURES, ProcessModel
from umo.errors import RangeError
from umo.objects.scaling import FloatArray

CONFIDENCE = 0.95
GRID_SAMPLES = 300
"""Number of samples used in the search on a grid."""
STARTS = 2
LAGS, DEAD_TIMES = 10, 6
"""Numbers of points of the grid for lags and for dead times."""
SECOND_LAGS = (0.05, 0.3, 0.9)
"""Further lags on the grid, as shares of the first lag."""
DAMPINGS = (0.1, 0.4, 0.8)
LEAST_DAMPING = 0.01
DRIFT_WEIGHT = 0.003
"""The weight of drift and of the initial state, relative to 1 for a sample. With it, both are assumed to be small if
possible."""
LONGEST_LAG = 20.0
"""Largest lag, in durations of the response."""
SHORTEST_UNSTABLE = 0.02
"""Least time constant of an unstable process, in durations of the response."""
FEWEST_INDEPENDENT = 12.0
"""Least number of residuals that count as independent."""
POOR_FIT = 50.0
"""Fit in per cent below which a model is refused."""
NONLINEAR_DEVIATIONS = 3.0
"""The number of standard deviations from which on a dependence on the amplitude does not count as noise."""
LEAST_SHOWN = 1e-3
"""The least share of the dependence on the amplitude that the other parts of the model must not hide."""
DIRECTIONS = 4
"""The number of directions in which a region is examined, in addition to its main axes."""
HALVINGS = 8
"""Largest number of steps of the search for a border."""
GROWTH = 2.0


@dataclass(frozen=True)
class Identified:
    """A model, and the models that fit equally well."""

    model: ProcessModel
    as_good: tuple[ProcessModel, ...]
    """Models that describe the response about as well as the best model: `model` itself, then models at the border of
    their region."""
    fit: float
    """The fit in per cent: 100 (1 - |error| / |measurement - mean|)."""
    unexplained: float
    """The part of the response that neither a model nor noise describes, in per cent of the spread of the
    measurement."""
    bend: float
    """The relative change of the gain with the amplitude, or 0 if noise can explain it."""
    predicted: FloatArray
    """The measurements that the model predicts."""
    duration: float
    """Duration of the response in s."""

    @property
    def kinds(self) -> list[str]:
        """The kinds of models that fit equally well, with the kind of `model` first."""
        return list(dict.fromkeys(each.kind for each in self.as_good))

    @property
    def intervals(self) -> dict[str, float]:
        """Half of the range of each parameter among the models of the same kind that fit equally well, by the letter of
        the parameter."""
        alike = [each.describe() for each in self.as_good if each.kind == self.model.kind]
        return {name: float(np.ptp([each[name] for each in alike])) / 2.0 for name in self.model.describe()}


def identify(response: MeasuredResponse, kinds: Sequence[str] = tuple(STRUCTURES), sign: float = 0.0) -> Identified:
    """Return the simplest model that describes the response about as well as any, and all models that do. `sign`: the
    sign of the gain, if known. Raises RangeError if no model describes the response."""
    response = response.thinned()
    fits = [each for kind in kinds if (each := fit_model(kind, response, sign)) is not None]
    best = min(fits, key=lambda each: each.cost, default=None)
    if best is None or best.fit < POOR_FIT:
        told = "" if best is None else f": the best describes {max(best.fit, 0.0):.0f} % of the response"
        raise RangeError(f"no model fits{told}; a longer response, a larger amplitude or less disturbance may help")
    independent = _independent_share(best.residuals) * len(best.residuals)
    limits = {each.kind: best.cost * (1.0 + _allowance(len(each.start) + 1, independent)) for each in fits}
    chosen = next(each for each in fits if each.cost <= limits[each.kind])
    as_good = [chosen.model]
    for each in fits:
        as_good += each.region(limits[each.kind])
    bend, deviation = _bend(best)
    bend = bend if bend > NONLINEAR_DEVIATIONS * deviation else 0.0
    return Identified(
        chosen.model, tuple(as_good), chosen.fit, best.unexplained, bend, chosen.solution.predicted, response.duration
    )


def _allowance(parameters: int, independent: float) -> float:
    """Return the share by which a sum of squares may exceed the least sum (Seber and Wild, Nonlinear Regression, 1989,
    section 5.3)."""
    from scipy.stats import f

    freedom = max(independent, FEWEST_INDEPENDENT) - parameters
    return float(parameters / freedom * f.ppf(CONFIDENCE, parameters, freedom))


def _independent_share(residuals: FloatArray) -> float:
    """Return the share of residuals that count as independent. It is 1 divided by the sum of their correlations up to
    the first negative one (Geyer, Statistical Science 7, 1992)."""
    energy = float(residuals @ residuals)
    if not energy:
        return 1.0
    spectrum = np.abs(np.fft.rfft(residuals, 2 * len(residuals))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(residuals)] / energy
    positive = correlation[1 : 1 + int(np.argmax(np.append(correlation[1:], -1.0) < 0.0))]
    return 1.0 / (1.0 + 2.0 * float(positive.sum()))


# One structure ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solution:
    """The solution for one dead time and one set of lags."""

    model: ProcessModel
    predicted: FloatArray
    errors: FloatArray
    """The errors of the samples, then of the initial states."""

    @property
    def cost(self) -> float:
        return float(self.errors @ self.errors)


@dataclass(frozen=True)
class _Fit:
    """The best model of one kind. `start`: the values that were found for the searched parameters. `axes`: the main
    axes of the region around `start`, one per row; along the length of an axis the sum of squares grows by about 1."""

    kind: str
    response: MeasuredResponse
    start: FloatArray
    solution: _Solution
    axes: FloatArray

    @property
    def model(self) -> ProcessModel:
        return self.solution.model

    @property
    def cost(self) -> float:
        return self.solution.cost

    @property
    def residuals(self) -> FloatArray:
        return self.response.measurements - self.solution.predicted

    @property
    def fit(self) -> float:
        spread = float(np.std(self.response.measurements))
        return 100.0 * (1.0 - float(np.sqrt(np.mean(self.residuals**2))) / max(spread, 1e-300))

    @property
    def unexplained(self) -> float:
        spread = float(np.var(self.response.measurements))
        left = float(np.mean(self.residuals**2)) - self.response.noise**2
        return 100.0 * float(np.sqrt(max(left, 0.0) / max(spread, 1e-300)))

    def region(self, limit: float) -> Iterator[ProcessModel]:
        """Yield models at the border of the region in which the sum of squares is below this limit."""
        room = limit - self.cost
        if room < 0.0:
            return
        more = (room / self._gain_alone) ** 0.5
        for share in (1.0 + more, 1.0 - more):
            if share > 0.0:
                yield replace(self.model, gain=self.model.gain * share)
        random = np.random.default_rng(1).standard_normal((DIRECTIONS, len(self.axes)))
        mixed = random / np.linalg.norm(random, axis=1, keepdims=True)
        for each in (*np.eye(len(self.axes)), *mixed):
            for direction in (each, -each):
                yield self._border(direction @ self.axes, room**0.5, limit)

    @property
    def _gain_alone(self) -> float:
        """Return the growth of the sum of squares if the gain is doubled and only the disturbances are adapted to
        it."""
        unit = replace(self.model, gain=1.0, zero=0.0)
        known, small = _columns(unit, self.response)
        driven = np.concatenate([self.model.response(self.response.outputs, self.response.dt), np.zeros(small)])
        left = _left_by(known[:, 2 if unit.structure.has_zero else 1 :], driven)
        return max(float(left @ left), 1e-300)

    def _border(self, direction: FloatArray, reach: float, limit: float) -> ProcessModel:
        """Return the model that is furthest from the best model in this direction and still within the limit."""
        low, high = _bounds(self.kind)
        inside, outside, found = 0.0, 0.0, self.model
        for _ in range(HALVINGS):
            searched = np.clip(self.start + reach * direction, low, high)
            solution = _solve(self.kind, searched, self.response)
            if solution.cost <= limit and _is_plausible(solution.model, self.response, self.model.gain):
                inside, found = reach, solution.model
            else:
                outside = reach
            reach = (inside + outside) / 2.0 if outside else GROWTH * reach
            if outside and outside - inside < 0.1 * outside:
                break
        return found


def fit_model(kind: str, response: MeasuredResponse, sign: float = 0.0) -> _Fit | None:
    """Return the best model of this kind; None if there is no model with a gain of this sign (0 means any sign)."""
    from scipy.optimize import least_squares

    low, high = _bounds(kind)
    best = None
    for start in _starts(kind, response.thinned(GRID_SAMPLES), sign):
        result = least_squares(
            lambda searched: _solve(kind, searched, response).errors,
            np.clip(start, low + 1e-6, high - 1e-6),
            bounds=(low, high),
            diff_step=1e-4,
            max_nfev=40,
        )
        if best is None or result.cost < best.cost:
            best = result
    if best is None:
        return None
    solution = _solve(kind, best.x, response)
    if not _is_plausible(solution.model, response, sign):
        return None
    return _Fit(kind, response, best.x, solution, _axes(best.jac))


def _is_plausible(model: ProcessModel, response: MeasuredResponse, sign: float) -> bool:
    """True if the gain of a model has this sign (0 means any sign), and the samples can show such a model. They cannot
    distinguish an integrator with a zero longer than the response from drift, and a resonance needs some samples in
    each of its periods."""
    drifts = model.integrates and abs(model.zero) > response.duration
    too_fast = model.structure.oscillates and model.lags[0] < response.dt
    return model.gain * (sign or model.gain) > 0.0 and not (drifts or too_fast)


def _axes(slopes: FloatArray) -> FloatArray:
    """Return the axes of the region within which the sum of squares grows by 1, if the errors were linear in the
    parameters."""
    _, size, axes = np.linalg.svd(slopes, full_matrices=False)
    found: FloatArray = axes / np.maximum(size, 1e-300)[:, None]
    return found


def _model(kind: str, searched: FloatArray, response: MeasuredResponse) -> ProcessModel:
    """Return a model of gain 1. `searched`: the logarithms of 1 + the dead time and of the lags, in shares of the
    duration; then that of the damping."""
    structure, unit = STRUCTURES[kind], response.duration / MAX_RESPONSE_SAMPLES
    dead_time = unit * max(exp(float(searched[0])) - 1.0, 0.0)
    lags = sorted((unit * exp(float(each)) for each in searched[1 : 1 + structure.lags]), reverse=True)
    if structure.unstable:
        dead_time = min(dead_time, lags[0])  # no relay keeps one with a longer dead time near its place
    damping = exp(float(searched[-1])) if structure.oscillates else 1.0
    return ProcessModel(kind, 1.0, dead_time, tuple(lags), damping)


def _solve(kind: str, searched: FloatArray, response: MeasuredResponse) -> _Solution:
    unit = _model(kind, searched, response)
    known, small = _columns(unit, response)
    middle = float(response.measurements.mean())
    wanted = np.concatenate([response.measurements - middle, np.zeros(small)])
    solved = _least_squares(known, wanted)
    gain = float(solved[0])
    zero = float(solved[1] / gain) if unit.structure.has_zero and gain else 0.0
    found = known @ solved
    predicted = middle + found[: len(response.outputs)]
    return _Solution(replace(unit, gain=gain, zero=zero), predicted, wanted - found)


def _least_squares(known: FloatArray, wanted: FloatArray) -> FloatArray:
    size = np.maximum(np.linalg.norm(known, axis=0), 1e-300)
    scaled = known / size
    solved: FloatArray = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True) @ (scaled.T @ wanted) / size
    return solved


def _left_by(known: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the part of the column `wanted` that the columns in `known` do not explain."""
    left: FloatArray = wanted - known @ _least_squares(known, wanted)
    return left


def _columns(unit: ProcessModel, response: MeasuredResponse) -> tuple[FloatArray, int]:
    """Return the columns of the linear parameters, and the number of parameters that are kept small. The first column
    is the response of the model of gain 1. The parameters that are kept small have the last columns, and each of them
    has an additional row at the bottom."""
    dt, times = response.dt, response.times
    driven = [unit.response(response.outputs, dt)]
    if unit.structure.has_zero:
        driven.append(replace(unit, zero=1.0).response(response.outputs, dt) - driven[0])
    free = [np.ones(len(times)), *_unknown_states(unit, times)]
    small = [times / response.duration, *_small_states(unit, times)]
    if unit.integrates:  # the output at which it stands still is not known
        free.append(small.pop(0))
    columns = np.column_stack([*driven, *free, *small])
    kept = np.zeros((len(small), columns.shape[1]))
    kept[:, len(driven) + len(free) :] = np.eye(len(small)) * np.sqrt(DRIFT_WEIGHT * len(times))
    return np.vstack([columns, kept]), len(small)


def _bend(fit: _Fit) -> tuple[float, float]:
    """Return the relative change of the gain at the largest change of the output, and its standard deviation. It is
    found from the part that the square of the change of the output adds to the response (a Hammerstein model)."""
    response = fit.response
    unit = replace(fit.model, gain=1.0)
    change = response.outputs - response.outputs[0]
    squares = change**2 / max(float(np.abs(change).max()), 1e-300)
    known, small = _columns(unit, response)
    curved = np.concatenate([unit.response(squares, response.dt), np.zeros(small)])
    shown = _left_by(known, curved)
    if float(shown @ shown) < LEAST_SHOWN * float(curved @ curved):
        return 0.0, 0.0  # the output had two levels only
    wanted = np.concatenate([response.measurements - response.measurements.mean(), np.zeros(small)])
    both = np.column_stack([known, curved])
    solved = _least_squares(both, wanted)
    errors = wanted - both @ solved
    independent = max(_independent_share(errors) * len(errors), FEWEST_INDEPENDENT)
    deviation = float(errors @ errors / independent / (shown @ shown)) ** 0.5
    gain = max(abs(float(solved[0])), 1e-300)
    return abs(float(solved[-1])) / gain, deviation / gain


def _small_states(model: ProcessModel, times: FloatArray) -> list[FloatArray]:
    """Return the free responses of a process that was not at rest when the response began."""
    found = []
    for pole in model.poles:
        if pole.real < 0.0 and pole.imag >= 0.0:
            moved = np.exp(pole * times)
            found += [moved.real, moved.imag] if pole.imag else [moved.real]
    return found


def _unknown_states(model: ProcessModel, times: FloatArray) -> list[FloatArray]:
    """Return the responses to the unknown states of an unstable model, each scaled to 1 at the end."""
    return [np.exp(pole.real * (times - times[-1])) for pole in model.poles if pole.real > 0.0]


# The search ------------------------------------------------------------------------------------------------


def _bounds(kind: str) -> tuple[FloatArray, FloatArray]:
    structure = STRUCTURES[kind]
    shortest = SHORTEST_UNSTABLE * MAX_RESPONSE_SAMPLES if structure.unstable else 0.2
    low = [0.0] + [log(shortest)] * structure.lags + [log(LEAST_DAMPING)] * structure.oscillates
    high = (
        [log(1.0 + 0.5 * MAX_RESPONSE_SAMPLES)]
        + [log(LONGEST_LAG * MAX_RESPONSE_SAMPLES)] * structure.lags
        + [0.0] * structure.oscillates
    )
    return np.array(low), np.array(high)


def _starts(kind: str, response: MeasuredResponse, sign: float) -> list[FloatArray]:
    """Return the best points of a grid, of those that give a gain of this sign."""
    points = list(_grid(kind))
    found = [
        (solution.cost, place)
        for place, each in enumerate(points)
        if (solution := _solve(kind, each, response)).model.gain * sign >= 0.0
    ]
    return [points[place] for _, place in sorted(found)[:STARTS]]


def _grid(kind: str) -> Iterator[FloatArray]:
    structure = STRUCTURES[kind]
    dead_times = np.log1p(np.concatenate([[0.0], np.geomspace(1.0, 0.4 * MAX_RESPONSE_SAMPLES, DEAD_TIMES - 1)]))
    lags = np.log(np.geomspace(1.0, 5.0 * MAX_RESPONSE_SAMPLES, LAGS)) if structure.lags else [0.0]
    seconds = SECOND_LAGS if structure.lags == 2 else DAMPINGS if structure.oscillates else [0.0]
    for dead_time in dead_times:
        for lag in lags:
            for second in seconds:
                whole = [dead_time, lag, log(second or 1.0) + (lag if structure.lags == 2 else 0.0)]
                yield np.array(whole[: 1 + structure.lags + structure.oscillates])

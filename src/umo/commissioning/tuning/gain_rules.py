"""Rules that give the gains of a `PID` for a model: three sets, from cautious to quick.

| set | rule | margins at least |
| --- | --- | --- |
| cautious | AMIGO; with a derivative SIMC with 3 dead times | 3, 55 degrees |
| balanced | SIMC with a closed-loop time of one dead time | 2, 45 degrees |
| quick | SIMC with half a dead time | 1.6, 30 degrees |

SIMC: Skogestad, Simple analytic rules for model reduction and PID controller tuning, J. Process Control 13, 2003.
AMIGO: Astrom and Hagglund, Advanced PID Control, 2006, section 7.4. If a set does not have its margins with the worst
of the models that fit equally well, the set is made slower until it has them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from umo.commissioning.tuning.margins import Gains, LoopMargins, SampledModels
from umo.commissioning.tuning.models import ProcessModel
from umo.errors import RangeError

CAUTIOUS, BALANCED, QUICK = "cautious", "balanced", "quick"
SPEEDS: Mapping[str, float] = {CAUTIOUS: 3.0, BALANCED: 1.0, QUICK: 0.5}
"""The closed-loop times of SIMC, in dead times."""
LEAST: Mapping[str, tuple[float, float]] = {CAUTIOUS: (3.0, 55.0), BALANCED: (2.0, 45.0), QUICK: (1.6, 30.0)}
"""The least gain margin, and the least phase margin in degrees, of each set."""
SHORTEST_DEAD_TIME = 0.01
"""The least dead time, as a share of the longest lag. A shorter dead time is raised to this value, because unmodelled
effects are as large."""
CLEAR_SECOND_LAG = 0.2
"""Smallest second lag, as a share of the longest lag, for which a set has a derivative."""
FILTER_SHARE = 0.1
"""The filter's time constant is this share of the derivative time."""
SLOWER = 0.95
"""The factor by which the gain of a set is reduced repeatedly until the set has its margins."""
TRIES, STRIDE = 120, 8
MOST_DOUBT = 40
"""The largest number of times that a set is made slower for other models that fit equally well, in addition to the
reductions for the model itself. The gain then falls to an eighth."""


@dataclass(frozen=True)
class GainSet:
    """One set of gains."""

    name: str
    rule: str
    gains: Gains
    margins: LoopMargins


def gain_sets(
    model: ProcessModel, dt: float, as_good: Sequence[ProcessModel] = (), derivative: bool = True
) -> list[GainSet]:
    """Return the three sets for a loop that is closed each `dt` s, the cautious set first. Their margins are those with
    the worst of the models in `as_good`. `derivative`: whether the sets may have a derivative. Raises RangeError if a
    set does not reach its margins, or if the models differ so much that the set would be much slower than the model
    needs."""
    alone, worst = SampledModels([model], dt), SampledModels([model, *as_good], dt)
    sets = []
    for name, factor in SPEEDS.items():
        rule, gains = _gains(model, dt, name, factor, derivative)
        found = _first_with_margins(name, gains, worst)
        if len(as_good) and found - _first_with_margins(name, gains, alone) > MOST_DOUBT:
            raise RangeError(_too_different([model, *as_good]))
        gains = _slower(gains, found, worst)
        sets.append(GainSet(name, rule + (", slower for its margins" if found else ""), gains, worst.margins(gains)))
    return sets


def _slower(gains: Gains, times: int, models: SampledModels) -> Gains:
    """Return gains that are smaller by a factor, with an integral time that is longer by the same factor. For an
    integrating process the integral time is longer by the square of the factor, because a smaller gain makes such a
    loop less damped."""
    factor = SLOWER**times
    longer = factor**2 if models.integrate else factor
    return replace(gains, gain=gains.gain * factor, integral_time=gains.integral_time / longer)


def _first_with_margins(name: str, gains: Gains, models: SampledModels) -> int:
    """Return how often the set must be made slower until it has the margins of its name."""

    def enough(tried: int) -> bool:
        return models.margins(_slower(gains, tried, models)).at_least(*LEAST[name])

    for last in range(0, TRIES + 1, STRIDE):
        if enough(last):
            return next(tried for tried in range(max(last - STRIDE + 1, 0), last + 1) if tried == last or enough(tried))
    if models.may_be_unstable:
        raise RangeError(
            "it is unclear whether the process without control is unstable: a larger amplitude, a longer experiment or "
            "less disturbance may help"
        )
    raise RangeError(f"no {name} gains with a gain margin of {LEAST[name][0]:g} were found for this process")


def _too_different(models: Sequence[ProcessModel]) -> str:
    kinds, times = dict.fromkeys(each.kind for each in models), [each.dead_time for each in models]
    return (
        f"models that need very different gains fit the response equally well ({', '.join(kinds)}; dead times of "
        f"{min(times):.2g} to {max(times):.2g} s): a larger amplitude, a longer experiment or less disturbance may help"
    )


def _gains(model: ProcessModel, dt: float, name: str, factor: float, derivative: bool) -> tuple[str, Gains]:
    dead_time = _shortest(model, dt)
    second = _second_lag(model) if derivative else 0.0
    if second > dead_time and not model.structure.repeats:
        return _simc_with_derivative(model, second, dead_time, factor, dt)
    slope, lag, dead_time = _reduced(model, dead_time)
    if name == CAUTIOUS:
        return "AMIGO", _amigo(slope, lag, dead_time)
    return f"SIMC, {factor:g} L", _simc(slope, lag, dead_time, factor * dead_time)


def _shortest(model: ProcessModel, dt: float) -> float:
    """Return the dead time for the rules. It includes half a period for the sampling, and the time of an inverse
    response."""
    dead_time = model.dead_time + dt / 2 + max(-model.zero, 0.0)
    return max(dead_time, SHORTEST_DEAD_TIME * max(model.lags, default=0.0))


def _second_lag(model: ProcessModel) -> float:
    """Return the lag that a derivative compensates, or 0 if there is none."""
    if model.integrates and model.lags and not model.structure.oscillates:
        return model.lags[0]
    if len(model.lags) == 2 and model.lags[1] > CLEAR_SECOND_LAG * model.lags[0]:
        return model.lags[1]
    return 0.0


def _reduced(model: ProcessModel, dead_time: float) -> tuple[float, float, float]:
    """Return slope, lag and dead time of a first-order model that replaces this model. Half of the second lag counts as
    dead time (Skogestad's half rule). A zero shortens the last lag; a zero longer than the lag makes the response
    correspondingly quicker."""
    if model.structure.oscillates:
        lag = 2.0 * model.damping * model.lags[0]
        if model.integrates:
            return model.gain, inf, dead_time + lag
        return model.gain / lag, lag, dead_time + model.lags[0] / 2
    *first, last = model.lags or (0.0,)
    quicker = max(model.zero / last, 1.0) if last else 1.0
    last = max(last - max(model.zero, 0.0), 0.0)
    if model.integrates:
        return model.gain * quicker, inf, dead_time + last
    if not first:
        return model.slope, last, dead_time
    third = last if model.structure.repeats else 0.0
    lag = first[0] / quicker + last / 2
    return model.gain / lag, lag, dead_time + last / 2 + third


def _simc(slope: float, lag: float, dead_time: float, closed: float) -> Gains:
    return Gains(1.0 / (slope * (closed + dead_time)), min(lag, 4.0 * (closed + dead_time)))


def _simc_with_derivative(
    model: ProcessModel, second: float, dead_time: float, factor: float, dt: float
) -> tuple[str, Gains]:
    """Return the gains of the series form of the rule, converted to the parallel form of `PID`."""
    lag = inf if model.integrates else model.lags[0]
    series = _simc(model.slope, lag, dead_time, factor * dead_time)
    ratio = 1.0 + second / series.integral_time
    derivative = second / ratio
    filter_time = max(FILTER_SHARE * derivative, dt if derivative > 2.0 * dt else 0.0)
    gains = Gains(series.gain * ratio, series.integral_time * ratio, derivative, filter_time)
    return f"SIMC with derivative, {factor:g} L", gains


def _amigo(slope: float, lag: float, dead_time: float) -> Gains:
    if lag == inf:
        return Gains(0.35 / (slope * dead_time), 13.4 * dead_time)
    gain, sum_ = slope * lag, lag + dead_time
    k = 0.15 / gain + (0.35 - lag * dead_time / sum_**2) / (slope * dead_time)
    ti = 0.35 * dead_time + 13.0 * dead_time * lag**2 / (lag**2 + 12.0 * dead_time * lag + 7.0 * dead_time**2)
    return Gains(k, ti)

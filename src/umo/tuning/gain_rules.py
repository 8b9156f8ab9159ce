"""Rules that give the gains of a `PID` for a model: three sets, from cautious to quick.

| set | rule | margins at least |
| --- | --- | --- |
| cautious | AMIGO; with a derivative SIMC with 3 dead times | 3, 55 degrees |
| balanced | SIMC with a closed-loop time of one dead time | 2, 45 degrees |
| quick | SIMC with half a dead time | 1.6, 30 degrees |

SIMC: Skogestad, Simple analytic rules for model reduction and PID controller tuning, J. Process Control 13, 2003.
AMIGO: Astrom and Hagglund, Advanced PID Control, 2006, section 7.4. Tyreus and Luyben, Tuning PI controllers for
integrator/dead time processes, Ind. Eng. Chem. Res. 31, 1992. A set that misses its margins is made slower until it
has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf

from umo.errors import RangeError
from umo.tuning.margins import Gains, LoopMargins, margins
from umo.tuning.models import FIRST_ORDER, INTEGRATOR, LAGGED_INTEGRATOR, ProcessModel

CAUTIOUS, BALANCED, QUICK = "cautious", "balanced", "quick"
SPEEDS: Mapping[str, float] = {CAUTIOUS: 3.0, BALANCED: 1.0, QUICK: 0.5}
"""The closed-loop times of SIMC, in dead times."""
LEAST: Mapping[str, tuple[float, float]] = {CAUTIOUS: (3.0, 55.0), BALANCED: (2.0, 45.0), QUICK: (1.6, 30.0)}
"""The gain margin and the phase margin, degrees, that a set has at least."""
RELAY_FACTORS: Mapping[str, tuple[float, float]] = {CAUTIOUS: (0.5, 1.5), BALANCED: (1.0, 1.0), QUICK: (1.3, 0.9)}
"""Factors of Tyreus' and Luyben's gain and integral time."""
SHORTEST_DEAD_TIME = 0.01
"""A dead time counts as so large a share of the longest lag at least: what is not in the model is as large."""
MOST_DOUBT = 2.0
"""Dead times by which the interval of the dead time counts, at most."""
CLEAR_SECOND_LAG = 0.2
"""Share of the longest lag from which on the second one is answered with a derivative."""
FILTER_SHARE = 0.1
"""The filter's time constant is this share of the derivative time."""
SLOWER = 0.95
"""Factor by which the gain of a set is reduced, again and again, until it has its margins."""
TRIES = 120


@dataclass(frozen=True)
class GainSet:
    """One set of gains."""

    name: str
    rule: str
    gains: Gains
    margins: LoopMargins


def gain_sets(
    model: ProcessModel, dt: float, dead_time_interval: float = 0.0, derivative: bool = True
) -> list[GainSet]:
    """The three sets for a loop that is closed each `dt` s, the cautious one first, for the longest dead time of its
    interval. `derivative`: whether they may have one. RangeError if one finds no margins."""
    model = replace(model, dead_time=model.dead_time + min(dead_time_interval, MOST_DOUBT * _shortest(model, dt)))
    sets = []
    for name, factor in SPEEDS.items():
        rule, gains = _gains(model, dt, name, factor, derivative)
        sets.append(with_margins(name, rule, gains, model, dt))
    return sets


def with_margins(name: str, rule: str, gains: Gains, model: ProcessModel, dt: float) -> GainSet:
    """The set, made slower until it has the margins of its name."""
    for tried in range(TRIES):
        found = margins(model, gains, dt)
        if found.at_least(*LEAST[name]):
            return GainSet(name, rule + (", slower for its margins" if tried else ""), gains, found)
        gains = replace(gains, gain=gains.gain * SLOWER, integral_time=gains.integral_time / SLOWER)
    raise RangeError(f"no {name} gains with a gain margin of {LEAST[name][0]:g} were found for this model")


def _gains(model: ProcessModel, dt: float, name: str, factor: float, derivative: bool) -> tuple[str, Gains]:
    dead_time = _shortest(model, dt)
    second = _second_lag(model) if derivative else 0.0
    if second > dead_time:
        return _simc_with_derivative(model, second, dead_time, factor, dt)
    slope, lag, dead_time = _reduced(model, dead_time)
    if name == CAUTIOUS:
        return "AMIGO", _amigo(slope, lag, dead_time)
    return f"SIMC, {factor:g} L", _simc(slope, lag, dead_time, factor * dead_time)


def _shortest(model: ProcessModel, dt: float) -> float:
    """The dead time for the rules, with half a period for the sampling."""
    return max(model.dead_time + dt / 2, SHORTEST_DEAD_TIME * max(model.lags, default=0.0))


def _second_lag(model: ProcessModel) -> float:
    """The lag that a derivative answers; 0: there is none."""
    if model.kind == LAGGED_INTEGRATOR:
        return model.lags[0]
    if len(model.lags) == 2 and model.lags[1] > CLEAR_SECOND_LAG * model.lags[0]:
        return model.lags[1]
    return 0.0


def _reduced(model: ProcessModel, dead_time: float) -> tuple[float, float, float]:
    """Slope, lag and dead time of a first order that stands for it: half of the second lag is a dead time (Skogestad's
    half rule)."""
    if model.kind == INTEGRATOR:
        return model.gain, inf, dead_time
    if model.kind == LAGGED_INTEGRATOR:
        return model.gain, inf, dead_time + model.lags[0]
    if model.kind == FIRST_ORDER:
        return model.slope, model.lags[0], dead_time
    half = model.lags[1] / 2
    return model.gain / (model.lags[0] + half), model.lags[0] + half, dead_time + half


def _simc(slope: float, lag: float, dead_time: float, closed: float) -> Gains:
    return Gains(1.0 / (slope * (closed + dead_time)), min(lag, 4.0 * (closed + dead_time)))


def _simc_with_derivative(
    model: ProcessModel, second: float, dead_time: float, factor: float, dt: float
) -> tuple[str, Gains]:
    """The series form of the rule, as the parallel form of `PID`."""
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


def tyreus_luyben(ultimate_gain: float, ultimate_period: float) -> dict[str, Gains]:
    """The three sets from the critical point alone, as a relay finds it: their margins are not known."""
    return {
        name: Gains(gain * ultimate_gain / 3.2, time * 2.2 * ultimate_period)
        for name, (gain, time) in RELAY_FACTORS.items()
    }

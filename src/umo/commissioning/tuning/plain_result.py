"""A result of tuning as plain data, for JSON."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

from umo.commissioning.tuning.gain_rules import GainSet
from umo.commissioning.tuning.tuning_result import TuningResult

DIGITS = 3
"""The number of significant digits of a gain, because a gain is not known more precisely."""
AXIS_NUMBERS = ("feed_forward", "inertia", "friction", "offset")


def rounded(value: float) -> float:
    """Round to `DIGITS` significant digits."""
    return float(f"{value:.{DIGITS}g}")


def settings_of(result: TuningResult, chosen: GainSet) -> dict[str, float]:
    """Return the settings of a set by their names in the law; for an axis also the feed-forward."""
    present = asdict(result.facts.present)
    found = {name: rounded(value) for name, value in asdict(chosen.gains).items()}
    found = {name: value for name, value in found.items() if value or present[name]}
    if result.axis is not None:
        axis, ahead = result.axis, result.axis.feed_forward_with(chosen.gains)
        more = {"feed_forward": ahead, "inertia": axis.inertia, "friction": axis.friction}
        found |= {name: rounded(value) for name, value in more.items()}
    return found


def as_data(result: TuningResult) -> dict[str, Any]:
    """Return the model, and the sets with their margins and predicted steps; null stands for a number that is not
    finite or not known."""
    facts, identified = result.facts, result.identified
    found: dict[str, Any] = {"law": facts.law, "sensor": facts.sensor, "actuator": facts.actuator}
    values, intervals = identified.model.describe().items(), identified.intervals
    known = {letter: {"value": value, "interval": intervals[letter]} for letter, value in values}
    found["model"] = {
        "kind": identified.model.kind,
        "fit": identified.fit,
        "parameters": known,
        "as_good": identified.kinds,
    }
    if result.relay is not None:
        found["relay"] = asdict(result.relay)
    if facts.inner:
        found["inner"] = {"law": facts.inner, "time": result.inner_time, "times_faster": result.faster}
    if result.axis is not None:
        found["axis"] = {name: getattr(result.axis, name) for name in AXIS_NUMBERS}
    found["sets"] = [_set(result, each) for each in result.sets]
    plain: dict[str, Any] = finite(found)
    return plain


def _set(result: TuningResult, each: GainSet) -> dict[str, Any]:
    step = result.steps.get(each.name)
    return {
        "name": each.name,
        "rule": each.rule,
        **asdict(each.gains),
        "gain_margin": each.margins.gain,
        "phase_margin": each.margins.phase,
        "overshoot": None if step is None else step.overshoot,
        "settling_time": None if step is None else step.settling_time,
        "settings": settings_of(result, each),
    }


def finite(data: Any) -> Any:
    """Return plain data in which null replaces numbers that are not finite."""
    if isinstance(data, dict):
        return {name: finite(value) for name, value in data.items()}
    if isinstance(data, list):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not isfinite(data) else data

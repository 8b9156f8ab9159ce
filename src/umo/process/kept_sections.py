"""The kept data of a frame, by sections: numbers, alarms, states.

A section is a function of a frame that returns plain data. All sections of a file are from the same frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any

from umo.cycle.restoring import MAX_EXACT
from umo.objects.presentation.described import Described
from umo.process.frames.layout import Layout
from umo.process.kept_file import ALARMS, NUMBERS, STATES

Section = Callable[[Any], dict[str, Any]]


def sections_of(layout: Layout) -> dict[str, Section]:
    """Return the sections of a run by name; empty if nothing is kept."""
    places = {each.path: (place, each) for place, each in enumerate(layout.described.signals)}
    kept = [(place, each) for place, each in enumerate(layout.signals) if "kept" in each]
    alarms = [str(entry["path"]) for entry in layout.alarms]
    units = [str(unit["path"]) for unit in layout.units]
    states = {path: places[f"{path}.state"] for path in units if f"{path}.state" in places}
    found: dict[str, Section] = {}
    found |= {NUMBERS: partial(_numbers, kept)} if kept else {}
    found |= {ALARMS: partial(_alarms, alarms)} if alarms else {}
    return found | ({STATES: partial(_states, states)} if states else {})


def _alarms(paths: Sequence[str], frame: Any) -> dict[str, Any]:
    return {path: state for path, state in zip(paths, frame["alarms"].tolist(), strict=True) if state}


def _states(places: Mapping[str, tuple[int, Described]], frame: Any) -> dict[str, Any]:
    values = frame["signals"].tolist()
    return {path: each.state(values[place]) for path, (place, each) in places.items() if isfinite(values[place])}


def _numbers(kept: Sequence[tuple[int, Mapping[str, Any]]], frame: Any) -> dict[str, Any]:
    values = frame["signals"].tolist()
    return {
        entry["path"]: {
            "value": value_of(entry["kept"], values[place]),
            "unit": entry["unit"],
            "type": entry["kept"]["type"],
        }
        for place, entry in kept
    }


def value_of(kind: Mapping[str, Any], number: float) -> Any:
    """Return a kept value as plain data; None if there is no value, or if the value is not finite or is a whole number
    that a frame cannot represent exactly."""
    if not isfinite(number):
        return None
    if kind["type"] == "float":
        return number
    if number != int(number) or abs(number) >= MAX_EXACT:
        return None
    if kind["type"] == "bool":
        return bool(number)
    if kind["type"] == "int":
        return int(number)
    return kind["members"].get(str(int(number)))

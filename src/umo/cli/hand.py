"""`umo get` and `umo set`: the electrical developer's hand tool. The loop runs, control code does not."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from umo.cycle import connect
from umo.errors import PathError, RangeError, StateError
from umo.objects import (
    Atomic,
    Binary,
    BinaryActuator,
    Compound,
    Digital,
    DigitalActuator,
    DigitalSensor,
    TwoState,
)
from umo.objects.units import convert
from umo.process.lock import only_one
from umo.process.station import Station
from umo.text import did_you_mean
from umo.wiring import driver_options

from .console import out

PAUSE = 0.01
"""Seconds between two looks at a machine that has no timer."""


def get_values(station: Station, wiring: str | None, paths: list[str], unit: str | None) -> None:
    """Print each object's value, unit and quality."""
    file, machine = station.wiring(wiring), station.machine()
    items = [_atomic(machine, path) for path in paths]
    with only_one(station.path, file), connect(machine, file):
        width = max(map(len, paths))
        for path, item in zip(paths, items, strict=True):
            out.print(f"{path:{width}}  {_value(item, unit)}  {item.quality}", markup=False)


def set_value(station: Station, wiring: str | None, path: str, text: str, hold: float | None) -> int:
    """Write one actuator, keep the loop going for `hold` s or until a signal, show what is read, reset."""
    file, machine = station.wiring(wiring), station.machine()
    item = _atomic(machine, path)
    if not isinstance(item, BinaryActuator | DigitalActuator):
        raise PathError(f"{path} is a sensor; only actuators can be set")
    value = _parse(item, text)
    with only_one(station.path, file):
        return _hold(machine, file, item, value, hold)


def _hold(machine: Compound, file: Path | None, item: Any, value: Any, hold: float | None) -> int:
    paced = {"realtime": True} if "realtime" in driver_options(file) else {}
    connection = connect(machine, file, **paced)
    with connection as m:
        taken = item.write(value)
        m.update()
        shown = f"{item.path}  {_value(item, None)}  raw {item.raw}  {item.quality}"
        out.print(shown if taken else f"{shown}  (clamped)", markup=False)
        _loop(m, hold, partial(item.write, value) if item.expires is not None else None)
    out.print(f"{item.path}  reset to {item.default}", markup=False)
    return 128 + connection.stop.signal if connection.stop.signal and hold is not None else 0


def _loop(m: Compound, hold: float | None, again: Callable[[], object] | None) -> None:
    """The machine's periods without its control, so that watchdogs are fed; a command that expires is kept up."""
    timer = m.children().get("timer")
    end = inf if hold is None else m.now + hold
    while m.running and m.now < end:
        if isinstance(timer, DigitalSensor):
            timer.read()
        else:
            time.sleep(PAUSE)
        m.sample()
        if again is not None:
            again()
        m.update()


def _atomic(machine: Compound, path: str) -> Atomic:
    item = machine.find(path)
    if not isinstance(item, Atomic):
        raise PathError(f"{path} is a compound object; name one of its parts: {', '.join(item.children())}")  # type: ignore[attr-defined]
    return item


def _value(item: Any, unit: str | None) -> str:
    if not isinstance(item, Digital):
        return str(item.read())
    value = item.read()
    return f"{convert(value, item.units, unit or item.units):.10g} {unit or item.units}"


def _parse(item: Any, text: str) -> float | TwoState:
    """A state's name, a number in the declared unit, or a number with a unit."""
    if isinstance(item, Binary):
        names = {state.name: state for state in item.states}
        if text.upper() not in names:
            raise StateError(
                f"{item.path} has no state {text!r}{did_you_mean(text.upper(), names)}: {', '.join(names)}"
            )
        state: TwoState = names[text.upper()]
        return state
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if match is None:
        raise RangeError(f"{item.path}: {text!r} is not a number in {item.units}")
    value = convert(float(match[1]), match[2] or item.units, item.units)
    if not item.minimum <= value <= item.maximum and item.limits == "raise":
        raise RangeError(f"{item.path}: {value:g} {item.units} is outside {item.minimum:g} to {item.maximum:g}")
    return value

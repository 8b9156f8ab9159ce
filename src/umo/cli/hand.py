"""`umo get` and `umo set`: read and write single objects by hand. The loop runs without control code."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any

from umo.cycle import connect
from umo.errors import FramesError, PathError, RangeError, StateError
from umo.frames import Reader
from umo.objects import (
    Atomic,
    Binary,
    BinaryActuator,
    Compound,
    Digital,
    DigitalActuator,
    DigitalSensor,
    Quality,
    TwoState,
)
from umo.objects.units import convert
from umo.process.start import LINUX
from umo.process.station import Station, find
from umo.remote import RemoteStation
from umo.remote.search import several_runs
from umo.text import did_you_mean, printable, some
from umo.wiring import Wired, resolve

from .commanding import set_running
from .console import err, out
from .running import attach, readers
from .station_options import machine_and_words, machine_of
from .values import number

PAUSE = 0.01
"""Seconds between two looks at a machine that has no timer."""


def get_values(name: str, wiring: str | None, paths: list[str], unit: str | None, acknowledge: bool = False) -> None:
    """Print each object's value, unit and quality: of a station that runs from its frames, else connected. Options of
    the machine may be among the paths."""
    station, pid = _named(name)
    file = station.wiring(wiring)
    machine, paths = machine_and_words(station, paths)
    items = [_atomic(machine, path) for path in paths]
    width = max(map(len, paths))
    wired = resolve(machine, file)
    with ExitStack() as stack:
        running = _running(station, file if wiring else None, wired, pid)
        if running is None:
            connection = connect(machine, wired, acknowledge=acknowledge)
            _announce(connection, station, file, "reading")
            stack.enter_context(connection)
        shown = _now(items) if running is None else _latest(running)
        for item in items:
            value, quality = shown[item.path]
            out.print(f"{item.path:{width}}  {_text(item, value, unit)}  {quality}", markup=False)
    if running is not None:
        err.print(
            f"umo: read from the frames of {station.name}, which is running (pid {running.about['pid']})", markup=False
        )


def _named(name: str) -> tuple[Station, int | None]:
    """A station by its name or folder, or by the pid of its run."""
    if not name.isdigit() or Path(name).exists():
        return find(name), None
    with attach(name) as reader:
        return find(reader.about["place"]), int(name)


def _running(station: Station, file: Path | None, wired: Wired, pid: int | None) -> Reader | None:
    """The frames of this station, if it runs: with this pid; else on one of these devices, with this wiring, or, where
    none was named, with any. FramesError if several fit, or if the run of the pid has ended."""
    found = [reader for reader in readers() if reader.about["place"] == str(station.path)]
    if pid is not None:
        found = [reader for reader in found if reader.about["pid"] == pid]
        if not found:
            raise FramesError(f"{station.name} (pid {pid}) has ended")
    elif file is not None:
        devices = set(wired.devices)
        found = [r for r in found if r.about["wiring"] == file.stem or devices & set(r.about["devices"])]
    if len(found) > 1:
        raise FramesError(several_runs(station.name, found))
    return found[0] if found else None


def _announce(connection: connect[Any], station: Station, file: Path | None, what: str) -> None:
    """Before the first driver is opened, say that no run has the machine, and what this command does to it."""
    name = station.name if file is None else f"{station.name} ({file.stem})"

    @cache
    def say_once() -> None:
        wired = connection.wired
        opened = some(sorted(wired.devices) or [f"driver {each}" for each in wired.drivers])
        does = f"this {what} opens {opened}, and brings every actuator to its default before and after it"
        err.print(f"umo: {printable(f'{name} is not running: {does}')}", soft_wrap=True)

    connection.on_step = say_once


def _now(items: Iterable[Any]) -> dict[str, tuple[Any, Quality]]:
    return {item.path: (item.read(), item.quality) for item in items}


def _latest(reader: Reader) -> dict[str, tuple[Any, Quality]]:
    frame = reader.latest()
    if frame is None:
        raise FramesError(f"{reader.about['station']} is running but has not finished a period yet")
    values = reader.values(frame)
    return {path: (values[path], Quality(int(frame["quality"][i]))) for i, path in enumerate(reader.paths)}


def set_value(
    name: str,
    wiring: str | None,
    path: str,
    text: str,
    hold: float | None,
    acknowledge: bool = False,
    over: bool = False,
    arguments: Sequence[str] = (),
) -> int:
    """Write one actuator, keep the loop going for `hold` s or until a signal, show what is read, reset. Of a station
    that runs, take the actuator by hand."""
    station, pid = _named(name)
    file = station.wiring(wiring)
    machine = machine_of(station, arguments)
    item = _atomic(machine, path)
    if not isinstance(item, BinaryActuator | DigitalActuator):
        raise PathError(f"{path} is a sensor; only actuators can be set")
    value = _parse(item, text)
    if (running := _running(station, file if wiring else None, resolve(machine, file), pid)) is not None:
        with RemoteStation(running) as remote:
            set_running(remote, path, getattr(value, "name", value), hold, over)
        return 0
    realtime = LINUX and "timer" in machine.children()
    connection = connect(machine, file, acknowledge=acknowledge, realtime=realtime)
    _announce(connection, station, file, "write")
    return _hold(connection, item, value, hold)


def _hold(connection: connect[Any], item: Any, value: Any, hold: float | None) -> int:
    with connection as m:
        taken = item.write(value)
        if item.synchronous:
            item.update()  # now, also where the machine's outputs leave at the next tick
        shown = f"{item.path}  {_text(item, item.read(), None)}  raw {item.raw}  {item.quality}"
        out.print(shown + _remark(item, taken), markup=False)
        if hold is None:
            err.print("held until Ctrl-C; --hold SECONDS ends it", soft_wrap=True)
        pause = 0.0 if connection.wired.realtime else connection.wired.period or PAUSE
        _loop(m, hold, pause, partial(item.write, value) if item.expires is not None else None)
    out.print(f"{item.path}  reset to {item.default}", markup=False)
    return 128 + connection.stop.signal if connection.stop.signal and hold is not None else 0


def _remark(item: Any, taken: bool) -> str:
    """Why the value that is shown is not the one that was written."""
    if not taken:
        return f"  (inhibited: {item.inhibited})" if item.inhibited else "  (clamped)"
    if item.read() != item.pending:
        return f"  (on its way to {_text(item, item.pending, None)}: its slew rate is limited)"
    return ""


def _loop(m: Compound, hold: float | None, pause: float, again: Callable[[], object] | None) -> None:
    """The machine's periods without its control, so that watchdogs are fed; a command that expires is kept up. They
    take the time of the wall clock: `pause` is for machines without a timer in real time."""
    timer = m.children().get("timer")
    end = inf if hold is None else time.monotonic() + hold
    while m.running and time.monotonic() < end:
        if isinstance(timer, DigitalSensor):
            timer.read()
        time.sleep(pause)
        m.sample()
        if again is not None:
            again()
        m.update()


def _atomic(machine: Compound, path: str) -> Atomic:
    item = machine.find(path)
    if not isinstance(item, Atomic):
        raise PathError(f"{path} is a compound object; name one of its parts: {', '.join(item.children())}")  # type: ignore[attr-defined]
    return item


def _text(item: Atomic, value: Any, unit: str | None) -> str:
    if not isinstance(item, Digital):
        return str(value)
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
    value = number(item.path, text, item.units)
    if not item.minimum <= value <= item.maximum and item.limits == "raise":
        raise RangeError(f"{item.path}: {value:g} {item.units} is outside {item.minimum:g} to {item.maximum:g}")
    return value

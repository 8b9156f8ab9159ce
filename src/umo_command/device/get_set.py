"""`umo device get` and `umo device set`: read and write single objects by hand. If the station runs, its frames and its
queue of commands are used. Otherwise its devices are opened, and the loop runs without control code."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any

from umo.cycle.connect import connect
from umo.drivers.optional import inspection_of
from umo.errors import BadInput, DeclarationError, FramesError, OptionError, PathError, RangeError, text_of
from umo.objects import Actuator, Atomic, Compound, DigitalSensor
from umo.objects.description import converted, described, row_of
from umo.objects.paths import children
from umo.objects.presentation.rows import TableRow, quality_of, raw_of, sentence_of, value_of
from umo.objects.presentation.value_text import measure, span
from umo.process.frames import Reader
from umo.process.frames.search import find_elsewhere, is_path, meant_by, several_runs
from umo.process.start import LINUX
from umo.process.station import Station, StationError, find
from umo.states import TwoState
from umo.system.packages import MARK
from umo.system.streams import limit_waits
from umo.text import printable, some
from umo.wiring import Wired, resolve
from umo.wiring.wired import Wire
from umo_command.console import err, out, say
from umo_command.do.commanding import get_running, set_running
from umo_command.running_names import object_of
from umo_command.show.stations import attach, readers
from umo_command.station_options import machine_and_words, machine_of
from umo_command.values import number, state

UNTIMED_PAUSE = 0.01
"""Time in s between two readings of a machine that has no timer."""


def get_values(name: str, wiring: str | None, paths: list[str], unit: str | None, acknowledge: bool = False) -> None:
    """Print values, units and qualities, from the frames of a run or by connecting the machine. Paths may include
    options of the machine."""
    if (running := _running(name, wiring, paths)) is not None:
        get_running(running, paths, unit)
        return
    station = _station(name)
    machine, paths = machine_and_words(station, paths)
    items = [_atomic(machine, path, station.name) for path in paths]
    for item in items:
        converted(TableRow(described(item), 1.0), unit)  # before a device is opened
    file = station.wiring(wiring)
    wired = _resolved(machine, file)
    wires = {wire.item: wire for wire in wired.wires}
    limit_waits()
    connection = connect(machine, wired, acknowledge=acknowledge)
    _announce(connection, station, file, "reading")
    width = max(map(len, paths))
    with connection:
        for item in items:
            with suppress(BadInput):  # it was never read: it has no state
                item.read()
            out.print(sentence_of(converted(row_of(item), unit), width), soft_wrap=True)
            if line := _inspected(wires[item]):
                out.print(f"  {line}", soft_wrap=True)


def _inspected(wire: Wire) -> str:
    """Return the content of a sensor's circuit, as the driver reports it; empty if it reports nothing."""
    if isinstance(wire.item, Actuator):
        return ""
    try:
        return inspection_of(wire.driver, wire.channel)
    except OSError as error:
        return text_of(error)


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
    """Write one actuator, keep the loop running for `hold` s or until a signal, show readings, and reset. If the
    station runs, the actuator is taken under a lease. Errors in the command line are reported before a device is
    opened."""
    if (running := _running(name, wiring, arguments)) is not None:
        return set_running(running, path, text, hold, over)
    station = _station(name)
    machine = machine_of(station, arguments)
    item = _atomic(machine, path, station.name)
    if not isinstance(item, Actuator):
        raise PathError(f"{path} is a sensor; only actuators can be set")
    file = station.wiring(wiring)
    wired = _resolved(machine, file)
    value = _parse(item, text, wired)
    limit_waits()
    connection = connect(machine, wired, acknowledge=acknowledge)
    _announce(connection, station, file, "write")
    return _hold(connection, item, value, hold)


def _resolved(machine: Compound, file: Path | None) -> Wired:
    """Return the wiring. A machine with a timer is in real time, because there may be hardware."""
    return resolve(machine, file, {"realtime": LINUX and "timer" in children(machine)})


# Which station is meant ---------------------------------------------------------------------------------


def _running(name: str, wiring: str | None, arguments: Sequence[str]) -> Reader | None:
    """Return the run that a name means (`meant_by`), or None if the station does not run. If a wiring is given, only
    runs with this wiring or with one of its devices count. Raises FramesError if the name may mean several runs,
    OptionError for options of the machine."""
    if wiring is None and (elsewhere := find_elsewhere(name)) is not None:
        return elsewhere
    found = meant_by(name, readers())
    if wiring is not None and not name.isdigit():
        found = [reader for reader in found if _has_wiring(reader, name, wiring)]
    if len(found) > 1:
        raise FramesError(several_runs(name, found))
    if not found:
        return attach(name) if name.isdigit() and not Path(name).is_dir() else None  # FramesError: it has ended
    (reader,) = found
    about = reader.about
    here = Path(name).resolve()
    if not (name.isdigit() or is_path(name)) and (here / MARK).is_file() and about["place"] != str(here):
        raise FramesError(
            f"{name} names two stations: the one in this folder, which is not running, and {about['place']}, which is "
            f"running (pid {about['pid']}): give ./{name} or the pid"
        )
    if given := [each for each in arguments if each.startswith("--")]:
        raise OptionError(
            f"{about['station']} is running (pid {about['pid']}): options of its machine cannot be changed; leave out "
            f"{given[0]}"
        )
    return reader


def _has_wiring(reader: Reader, name: str, wiring: str) -> bool:
    """True if a run has this wiring of its station, or one of its devices."""
    if reader.about["wiring"] == Path(wiring).stem:
        return True
    try:
        station = find(name)
        wired = resolve(station.machine(**reader.about.get("options", {})), station.wiring(wiring), to_run=False)
    except (StationError, DeclarationError):  # the run has no folder of this name, or the folder has another machine
        return False
    return bool(set(wired.devices) & set(reader.about["devices"]))


def _station(name: str) -> Station:
    """Return a station that does not run. A StationError also names the running stations."""
    try:
        return find(name)
    except StationError as error:
        running = ", ".join(dict.fromkeys(str(reader.about["station"]) for reader in readers()))
        raise StationError(f"{error}; running: {running}" if running else str(error)) from error


# A station that does not run ----------------------------------------------------------------------------


def _announce(connection: connect[Any], station: Station, file: Path | None, what: str) -> None:
    """Print, before the first driver is opened, that the station is not running, and what this command does to its
    machine."""
    name = station.name if file is None else f"{station.name} ({file.stem})"

    @cache
    def say_once() -> None:
        wired = connection.wired
        opened = some(sorted(wired.devices) or [f"driver {each}" for each in wired.drivers])
        does = f"this {what} opens {opened}, and sets every actuator to its default before and afterwards"
        say(printable(f"{name} is not running: {does}"))

    connection.on_step = say_once


def _hold(connection: connect[Any], item: Any, value: Any, hold: float | None) -> int:
    with connection as m:
        taken = item.write(value)
        if item.synchronous:
            item.update()  # immediately, even if the wiring sends outputs at the next tick
        item.read()
        row = row_of(item)
        out.print(f"{item.path}  {value_of([row])}  raw {raw_of([row])}  {quality_of([row])}{_remark(item, taken)}")
        if hold is None:
            err.print("held until Ctrl-C; --for TIME ends it", soft_wrap=True)
        pause = 0.0 if connection.wired.realtime else connection.wired.period or UNTIMED_PAUSE
        _loop(m, hold, pause, partial(item.write, value) if item.expires is not None else None)
    out.print(f"{item.path}  reset to {described(item).text(item._default_value())}")
    return 128 + connection.stop.signal if connection.stop.signal and hold is not None else 0


def _remark(item: Any, taken: bool) -> str:
    """Return the reason why the shown value differs from the written value."""
    if not taken:
        return f"  (inhibited: {item.inhibited})" if item.inhibited else "  (clamped)"
    if item.read() != item.pending:
        why = "its slew rate is limited" if getattr(item, "slew_rate", None) else "its device has not confirmed it yet"
        return f"  (on its way to {described(item).text(item._number(item.pending))}: {why})"
    return ""


def _loop(m: Compound, hold: float | None, pause: float, again: Callable[[], object] | None) -> None:
    """Carry out periods of the machine without its control code, so that the watchdogs get requests. A command that
    expires is repeated. The periods take wall-clock time: `pause`, in s, is the pause in each period of a machine
    without a timer in real time."""
    timer = children(m).get("timer")
    end = inf if hold is None else time.monotonic() + hold
    while m.cycle.running and time.monotonic() < end:
        if isinstance(timer, DigitalSensor):
            timer.read()
        time.sleep(pause)
        m.sample()
        if again is not None:
            again()
        m.update()


def _atomic(machine: Compound, path: str, name: str) -> Any:
    item = object_of(machine, path, name)
    if not isinstance(item, Atomic):
        raise PathError(f"{path} is a compound object; name one of its parts: {', '.join(children(item))}")
    return item


def _parse(item: Any, text: str, wired: Wired) -> float | TwoState:
    """Return the value that a text means: a state's name, a number in the declared unit, or a number with a unit.
    Raises RangeError if the value is outside the wired range."""
    if item._has_states:
        states: dict[str, TwoState] = {each.name: each for each in item.states}
        return states[state(item.path, text, list(states))]
    value = number(item.path, text, item.units)
    (calibration,) = (wire.calibration for wire in wired.wires if wire.item is item)
    if not calibration.minimum <= value <= calibration.maximum and item.limits == "raise":
        outside = f"is outside {span(calibration.minimum, calibration.maximum)}"
        raise RangeError(f"{item.path}: {measure(value, item.units)} {outside}")
    return value

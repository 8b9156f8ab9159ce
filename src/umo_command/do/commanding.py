"""`umo do STATION mode`, `call`, `tune`, and `umo device get` and `umo device set` for a station that runs."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import inf
from typing import Any

from rich.table import Table

from umo.clients.remote import HeldLease, RemoteStation
from umo.clients.remote.remote_objects import RemoteObject
from umo.cycle.stage import Progress, Stage
from umo.digits import number_text, setting_text
from umo.errors import CommandRefused, EquipmentFault, FramesError, LeaseHeld, PathError, RangeError
from umo.objects import Quality
from umo.objects.description import converted
from umo.objects.presentation.rows import quality_of, sentence_of, value_of
from umo.objects.presentation.value_text import shown_unit, span
from umo.operation.commands.verbs import CALL, TUNE
from umo.process.frames import Reader, RunReader
from umo.process.source_files import changed_files, changed_text
from umo.system.streams import limit_waits
from umo.text import add_note, did_you_mean, printable, some
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.running_names import not_an_object
from umo_command.show.stations import attach, how_to_clear
from umo_command.tune.kept import toml_line
from umo_command.values import argument, number, state

PICTURE_PAUSE = 0.05
"""Time in s between two updates of the progress display."""
MIN_PAUSE = 0.001
"""Shortest time in s between two checks for a new frame."""


@contextmanager
def station_of(name: str) -> Iterator[RemoteStation]:
    with RemoteStation(attach(name)) as station:
        yield station


@contextmanager
def leased(station: RemoteStation, over: bool) -> Iterator[HeldLease]:
    """Return a context with the lease for a command. If another client has the lease, the message names the option that
    takes it over."""
    limit_waits()
    with ExitStack() as stack:
        try:
            lease = stack.enter_context(station.lease(over=over))
        except LeaseHeld as error:
            held = printable(str(error.__cause__))  # as the machine says it
            raise LeaseHeld(f"{held}; take it over with --take, or wait until it is given back") from error
        yield lease


@contextmanager
def hinting(reader: RunReader) -> Iterator[None]:
    """Return a context for commands. If equipment refuses a command because of its fault, the error is printed with the
    command that clears the fault."""
    try:
        yield
    except (EquipmentFault, CommandRefused) as error:
        faults = reader.faults(reader.latest())
        if found := [path for path in faults if f" {path} is in fault" in f" {error}"]:
            add_note(error, how_to_clear(str(reader.about["station"]), found))
        raise


def mode(name: str, wanted: str | None, over: bool) -> None:
    with station_of(name) as station:
        if wanted is not None:
            with leased(station, over):
                station.mode = wanted
        title, holder = station.reader.about["station"], printable(station.reader.now().holder)
        lease = f"  lease: {holder}" if holder and wanted is None else ""
        out.print(f"{title}  {wanted or station.mode or 'takes no commands'}{lease}")


def call(name: str, path: str | None, words: Sequence[str], over: bool, hold: float | None) -> int:
    """List the actions of a station, or call one action, show its progress and print its result. Return the exit
    status."""
    with station_of(name) as station:
        actions = {entry["path"]: entry for entry in station.reader.layout.actions}
        if path is None:
            out.print(actions_table(station.reader) if actions else f"{station.reader.about['station']} has no actions")
            return 0
        if path not in actions:
            raise PathError(
                f"there is no action {path!r}{did_you_mean(path, actions)}; `umo do {name} call` lists them"
            )
        given = arguments_of(actions[path], words)
        if hold is not None and not actions[path]["dead_man"]:
            raise RangeError(f"{path} ends by itself; --for can only be used with dead-man actions, such as a jog")
        status = 0
        with hinting(station.reader), leased(station, over) as lease:
            try:
                result = _called(station, actions[path], given)
            except KeyboardInterrupt:
                err.print(f"{path}: cancelled", soft_wrap=True)
                raise
            if held := path in lease.held:
                err.print(f"{path}: has begun", soft_wrap=True)
                status = hold_until(lease, path, hold)
        if held:
            err.print(f"{path}: released", soft_wrap=True)
        elif result is None:
            err.print(f"{path}: done", soft_wrap=True)
        elif isinstance(result, str):
            out.print(printable(result), soft_wrap=True, markup=False)
        else:
            out.print_json(data=result)
        return status


def _called(station: RemoteStation, action: dict[str, Any], given: dict[str, Any]) -> Any:
    """Call an action and return its result. Its progress is shown, but not the progress that was reported before."""
    with OneLine(err) as line:
        began, before = time.monotonic(), station.progress

        def show() -> None:
            progress = station.progress if station.progress != before else Progress()
            line.show(time.monotonic() - began, progress.text, progress.share if progress.total else None)

        return station.carry_out(CALL, action["path"], given, show)


def arguments_of(action: dict[str, Any], words: Sequence[str]) -> dict[str, Any]:
    """Return the values of arguments by name. A word without a name is the next argument. Raises RangeError for a name
    that is given twice."""
    known = {each["name"]: each for each in action["arguments"]}
    given: dict[str, Any] = {}
    for word in words:
        name, sign, text = word.partition("=")
        if not sign:
            name, text = next((each for each in known if each not in given), name), word
        if name not in known:
            names = " ".join(f"{each}=..." for each in known) or "none"
            near = did_you_mean(name, known)
            raise RangeError(f"{action['path']}: {word!r} is not one of its arguments{near}: {names}")
        if name in given:
            raise RangeError(f"{action['path']}: {name} is given twice")
        given[name] = argument(action["path"], known[name], text)
    return given


def hold_until(lease: HeldLease, path: str, seconds: float | None) -> int:
    """Hold the actuator while the thread of the lease sends heartbeats. Raises CommandRefused as soon as the machine
    ends the hold. Return the exit status. It is that of Ctrl-C if Ctrl-C comes before the end of `seconds`, otherwise
    0."""
    if seconds is None:
        err.print("held until Ctrl-C; --for TIME ends it", soft_wrap=True)
    end = time.monotonic() + (inf if seconds is None else seconds)
    try:
        while not (ended := lease.ended(path)) and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, PICTURE_PAUSE))
    except KeyboardInterrupt:
        err.print()
        return 0 if seconds is None else 128 + signal.SIGINT
    if ended:
        raise CommandRefused(f"{path} is no longer held: {ended}")
    return 0


def actions_table(reader: RunReader) -> Table:
    table = Table("action", "arguments", "", header_style="bold")
    for entry in reader.layout.actions:
        remarks = " (in automatic mode too)" if entry["harmless"] else ""
        remarks += " (dead-man: as long as it is held)" if entry["dead_man"] else ""
        table.add_row(entry["path"], "\n".join(map(_described, entry["arguments"])), entry["help"] + remarks)
    return table


def _described(about: dict[str, Any]) -> str:
    text = f"{about['name']}={about['kind'] if not about.get('choices') else '|'.join(about['choices'])}"
    if "unit" in about:
        text = f"{about['name']}={span(about['minimum'], about['maximum'], about['unit']) or 'number'}"
    return text if about["required"] else f"[{text}]"


def tune(name: str, path: str | None, text: str | None, over: bool) -> None:
    """Set a tunable number, show it, or list all tunable numbers."""
    with station_of(name) as station:
        known = {each.path: each for each in station.reader.layout.described.tunables}
        now = station.reader.tunables()
        if path is None:
            table = Table("number", "value", "unit", "range", header_style="bold")
            for each, entry in known.items():
                bounds = span(entry.minimum, entry.maximum)
                table.add_row(each, number_text(now[each]), shown_unit(entry.unit), bounds)
            out.print(table)
            return
        if path not in known:
            raise PathError(
                f"there is no tunable number {path!r}{did_you_mean(path, known)}; `umo tune number {name}` lists them"
            )
        unit = known[path].unit
        if text is None:
            out.print(f"{path}  {setting_text(now[path])} {shown_unit(unit)}".rstrip())
            return
        value = number(path, text, unit)
        with leased(station, over):
            station.carry_out(TUNE, path, {"value": value})
        given = setting_text(value)
        out.print(f"{path}  {setting_text(now[path])} -> {given} {shown_unit(unit)}".rstrip())
        if path in station.reader.kept:
            err.print("the number is declared kept: the next run begins with this value", soft_wrap=True)
            return
        keep = f"put {toml_line(path, given)} under [parameters] of the wiring {station.reader.about['wiring']}"
        err.print(f"this value lasts until the run ends; to keep it, {keep}", soft_wrap=True)


def get_running(reader: Reader, paths: Sequence[str], unit: str | None) -> None:
    """Print objects, signals and tunable numbers of a station that runs. All values are of the same period."""
    with RemoteStation(reader) as station:
        shown = {row.about.path: place for place, row in enumerate(reader.rows(None))}
        for path in paths:
            if path not in shown:
                raise _no_object(station, path, list(shown))
        places = [shown[path] for path in paths]
        if (frame := reader.latest()) is None:
            raise FramesError(f"{reader.about['station']} is running but has not finished a period yet")
        rows = [converted(row, unit) for row in reader.rows(frame, places)]
        width = max(map(len, paths))
        for row in rows:
            out.print(sentence_of(row, width), soft_wrap=True)
        about = reader.about
        say(f"read from the frames of {about['station']}, which is running (pid {about['pid']})")
        inspected = [row.about.path for row in rows if row.about.is_inspected]
        if inspected and "site" not in about:  # a station on another computer must be asked on that computer
            name = about["station"]
            say(
                f"the raw content of the circuit of {some(inspected)}, such as registers in each byte order, can be "
                f"read only while the station does not run: `umo do {name} stop`, then `umo device get {name} "
                f"{' '.join(inspected)}`"
            )
        if changed := changed_text(changed_files(about)):
            say(changed)


def _object(station: RemoteStation, path: str) -> RemoteObject:
    """Return an object of a running station. Raises PathError if no object has this path."""
    reader = station.reader
    if path not in reader.paths:
        if path in reader.tunables():
            raise PathError(f"{path} is a number: `umo tune number` changes it")
        raise _no_object(station, path, reader.paths)
    item: RemoteObject = station[path]
    return item


def _no_object(station: RemoteStation, path: str, known: Sequence[str]) -> PathError:
    """Return the error for an unknown path: with the nearest known one, or with the names below the path."""
    if what := not_an_object(path, station.reader.layout, str(station.reader.about["station"])):
        return PathError(what)
    try:
        item = station[path]
    except AttributeError:
        return PathError(f"there is no object {path!r}{did_you_mean(path, known)}")
    if below := [each for each in known if each.startswith(f"{path}.")]:
        of_objects = any(each.startswith(f"{path}.") for each in station.reader.paths)
        what = "a compound object" if of_objects else "not an object"
        return PathError(f"{path} is {what}; name one of its {'parts' if of_objects else 'numbers'}: {some(below)}")
    shown = "a number that is only shown and cannot be set" if isinstance(item, float | str) else "not an object"
    return PathError(f"{path} is {shown}")


def set_running(reader: Reader, path: str, text: str, hold: float | None, over: bool) -> int:
    """Take one actuator of a station that is in manual mode, hold it, and release it. Return the exit status."""
    with RemoteStation(reader) as station:
        item = _object(station, path)
        if not item.actuator:
            raise PathError(f"{path} is a sensor; only actuators can be set")
        value = state(path, text, item.states) if item.states else number(path, text, item.units)
        with hinting(reader), leased(station, over) as lease:
            item.write(value)
            _show(reader, path, "", value, "{}: its slew rate is limited")
            status = hold_until(lease, path, hold)
            item.release()
            default = reader.layout.described.objects[reader.index(path)].plain.get("default")
            _show(reader, path, "released: ", default, "its default {}, or written by the program")
        return status


def _show(reader: RunReader, path: str, what: str, aim: object, way: str) -> None:
    """Show an actuator that was written or released. If it does not have the number `aim` yet, say so: `way` is the end
    of this remark."""
    let_pass(reader, 2, 1.0)
    (row,) = reader.rows(reader.latest(), [reader.index(path)])
    shown, remark = value_of([row]), ""
    if isinstance(aim, float | int) and row.quality == Quality.GOOD and shown != (wanted := row.about.text(aim)):
        remark = f"  (on its way to {way.format(wanted)})"
    out.print(f"{path}  {what}{shown}  {quality_of([row])}{remark}")


def let_pass(reader: RunReader, periods: int, within: float) -> None:
    """Wait for some periods, for at most `within` s: the frame of a command does not show its effect yet if outputs are
    sent at the next tick, or if the application acts on it."""
    until, end = reader.now().periods + periods, time.monotonic() + within
    while reader.now().periods < until and reader.state is Stage.RUNNING and time.monotonic() < end:
        time.sleep(max(reader.about["period"], MIN_PAUSE))

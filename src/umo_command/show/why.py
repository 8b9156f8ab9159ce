"""`umo show why`: shows how the last run ended, and the causes of missed periods from the newest black box."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from umo.cycle.fault_log import FaultLog
from umo.digits import number_text
from umo.duration import duration
from umo.errors import FramesError
from umo.objects.presentation.run_facts import clock_text, title
from umo.process.frames import RunReader, blackbox
from umo.process.frames.causes import AFTER, CONTROL_CODE, WAKE, always_slow, counts, explain_all, sentences, split
from umo.process.frames.layout import USAGE
from umo.process.frames.search import frames_at, reading, station_name
from umo.system.folders import modified
from umo.system.packages import SHIPPED
from umo.text import Moment, did_you_mean, printable, shown_path, time_of_day
from umo_command.console import out
from umo_command.run.long_runs import RecordedRun, newest, recorded
from umo_command.run.record_beside import SUFFIX, check_installed
from umo_command.run.run_folder import RUNS
from umo_command.show.stations import attach, how_to_clear

if TYPE_CHECKING:
    from umo.recording.recording import Recording

PERIODS_BEFORE = 2
"""Number of periods that are shown before the period that reports the missed period."""
MAX_VERDICTS = 10
"""Number of missed periods that are explained. They are the latest ones."""
PROFILED = "which function takes the time, in virtual time (docs/howto-late-periods.md):"
"""Heading of the command that shows which function takes the time."""
PART_TITLES = {WAKE: "waking up", AFTER: "after update"}


def why(station: str | None, now: bool, file: Path | None) -> int:
    run = None if now or file is not None else _last_run(station)
    if run is not None and run.state == "running":
        station = run.station
    now = now or (file is None and station is not None and _is_shown_live(station))
    if now:
        file = _keep(station)
    elif file is None and run is not None:
        out.print(f"the last run in {RUNS}/: {printable(run.sentence)}", style="bold", soft_wrap=True)
        if (file := _box_of(run)) is None:
            _say_without_box(run)
            return 0
    elif file is None:
        file = _newest(station)
    elif file.suffix == SUFFIX:
        _report_recording(file)
        return 0
    with frames_at(file) as reader, reading(file):
        _report(reader, file, now)
    return 0


def _last_run(station: str | None) -> RecordedRun | None:
    """Return the newest run in `runs/`, of one station or of all stations, or None if there is no run, or if another
    machine, such as that of a program of its own, has left a newer black box."""
    run = next(iter(newest(recorded(station and station_name(station)))), None)
    box = next(reversed(blackbox.boxes(blackbox.folder())), None) if station is None else None
    if run is not None and box is not None and not _is_of(box, run.station) and modified(box) > run.written:
        return None
    return run


def _boxes_of(station: str) -> list[Path]:
    """Return the black boxes of a station, oldest first."""
    return [path for path in blackbox.boxes(blackbox.folder()) if _is_of(path, station)]


def _box_of(run: RecordedRun) -> Path | None:
    """Return the newest black box of a run, or None if it has none."""
    return next((path for path in reversed(_boxes_of(run.station)) if modified(path) >= run.started), None)


def _say_without_box(run: RecordedRun) -> None:
    """Say that a run has no black box, and name the newest one of an earlier run."""
    out.print("this run has no black box; a run in real time writes one when a period is missed or the run fails")
    if earlier := _boxes_of(run.station):
        when = time_of_day(modified(earlier[-1]))
        out.print(f"an earlier run has one, of {when}: `umo show why --file {earlier[-1]}`", soft_wrap=True)


def _is_shown_live(station: str) -> bool:
    """Return True if a station runs, and equipment is in fault or the run has no black box yet: an earlier black box
    does not show the present state."""
    try:
        reader = attach(station)
    except FramesError:
        return False
    with reader:
        name, started = str(reader.about["station"]), float(reader.about["started"])
        if reader.faults(reader.latest()):
            return True
        return not any(modified(box) >= started for box in _boxes_of(name))


def _is_of(box: Path, station: str) -> bool:
    return blackbox.station_of(box) == station_name(station)


def _newest(station: str | None) -> Path:
    boxes = blackbox.boxes(blackbox.folder())
    found = boxes if station is None else [path for path in boxes if _is_of(path, station)]
    if station is not None and boxes and not found:
        names = [blackbox.station_of(path) for path in boxes]
        known = ", ".join(dict.fromkeys(names))
        raise FramesError(
            f"nothing is known of {station!r}{did_you_mean(station, names)}: it is not running, no period was "
            f"missed, and no run has failed; there are black boxes of: {known}"
        )
    if not found:
        raise FramesError(
            "no black box yet: one is written when a period is missed in real time; `umo show why --now` writes one "
            "immediately"
        )
    return found[-1]


def _keep(station: str | None) -> Path:
    """Write a black box of a running station from its frames. Return the file."""
    with attach(station) as reader:
        file = blackbox.name_for(blackbox.folder(), str(reader.about["station"]), time.time())
        blackbox.save(reader, file, blackbox.ON_DEMAND)
        blackbox.thin(file.parent)
        return file


def _report(reader: RunReader, file: Path, now: bool) -> None:
    frames, about = reader.read(), reader.about
    if not len(frames):
        raise FramesError(f"{file} contains no period")
    began, kept = time_of_day(about["started"]), blackbox.kept_at(about)
    out.print(f"{reader.title}, run since {began}; black box of {kept}: {about.get('reason', '')}", soft_wrap=True)
    out.print(
        f"the last {len(frames)} periods of {duration(about['period'])}; {reader.now().missed} missed in the whole run"
    )
    log = FaultLog()
    for _, event in reader.events():
        log.add(event)
    for fault in list(log.last)[-MAX_VERDICTS:]:
        out.print(f"{fault.path}: {fault}", style="bold")
    for mistake in log.mistakes[:MAX_VERDICTS]:
        out.print(f"mistake: {mistake.path}: {printable(mistake.text)}", style="bold", soft_wrap=True)
    for row in reader.alarms(frames[-1])[:MAX_VERDICTS]:
        out.print(f"alarm {printable(str(row))}", soft_wrap=True)
    if log.standing and now:
        out.print(how_to_clear(str(reader.about["station"]), log.standing))
    verdicts = explain_all(frames, reader.layout)
    if not verdicts:
        out.print("none of these periods was missed; usual times:")
        out.print(_usual(reader, frames))
        return
    for line in sentences(frames, reader.layout, verdicts, MAX_VERDICTS):
        out.print(line, style="bold", soft_wrap=True)
    if CONTROL_CODE in always_slow(frames, reader.layout):
        out.print(f"{PROFILED} python -m cProfile -s tottime $(which umo) run {_station(about)}", soft_wrap=True)
    out.print(_around(reader, frames, verdicts[-1].row))
    out.print(str(file), style="dim")


def _station(about: Mapping[str, Any]) -> str:
    """Return the station of a run as a command line names it: by its name if it ships with umo, otherwise by the path
    of its folder."""
    place = Path(str(about.get("place", "")))
    return str(about["station"]) if place.parent in (Path(), SHIPPED) else shown_path(str(place))


def _report_recording(file: Path) -> None:
    """Print the black boxes of a recording, and the periods around the last missed period."""
    check_installed()
    from umo.recording.recording import Recording

    with Recording(file) as recording:
        boxes, about = recording.black_boxes, recording.about
        if not boxes:
            raise FramesError(f"{file} has no black box: no period was missed, and its run has not failed")
        name = title(about["station"], about.get("wiring"))
        for box in boxes[-MAX_VERDICTS:]:
            out.print(f"{name}, {Moment.at(box.time)}: {printable(box.reason)}", soft_wrap=True)
            for line in box.text.splitlines():
                out.print(f"  {line}", style="bold", soft_wrap=True)
        last = boxes[-1]
        frames = recording.frames(last.start, np.nextafter(last.time, np.inf))
        verdicts = explain_all(frames, recording.layout) if frames["phases"].any() else []
        if verdicts:
            out.print(_around(recording, frames, verdicts[-1].row))


def _parts(reader: RunReader | Recording, frames: Any) -> tuple[list[str], Any]:
    """Return the names of the parts into which the time of a period is divided, and their times in ns."""
    parts = split(frames, reader.layout)
    return [PART_TITLES.get(name, name) for name in parts], np.array(list(parts.values()))


def _usual(reader: RunReader, frames: Any) -> Table:
    names, times = _parts(reader, frames)
    table = Table("µs", *names, header_style="bold")
    for name, q in (("median", 50), ("99 %", 99), ("longest", 100)):
        table.add_row(name, *map(_microseconds, np.percentile(times, q, axis=1)))
    return table


def _around(reader: RunReader | Recording, frames: Any, row: int) -> Table:
    """Return a table of the periods before and after a missed period, with the changes of the counters from each period
    to the next."""
    names, times = _parts(reader, frames)
    rows = [i for i in range(row - PERIODS_BEFORE, row + 2) if 1 <= i < len(frames)]
    moments = (clock_text(frames["time"][i], reader.about["period"]) for i in rows)
    table = Table("", "median", *moments, header_style="bold")
    table.add_row("missed", "", *(str(frames["missed"][i] or "") for i in rows))
    for name, values in zip(names, times, strict=True):
        table.add_row(f"{name}, µs", _microseconds(np.median(values)), *(_microseconds(values[i]) for i in rows))
    units = {name: unit for name, _, _, unit in USAGE}
    for name, counted in counts(frames).items():
        if counted[rows].any():
            title, is_time = name.replace("_", " "), bool(units[name])
            cells = (_microseconds(counted[i]) if is_time else number_text(counted[i], 0) for i in rows)
            table.add_row(f"{title}, µs" if is_time else title, "", *cells, style="dim")
    return table


def _microseconds(ns: float) -> str:
    return number_text(ns * 1e-3, 1)

"""Limits the records of a run that lasts for months. The trace is written in parts, of which the oldest are removed; a
summary is written during the run; and `runs/` has a maximum number of folders."""

from __future__ import annotations

import json
import os
import shutil
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from math import inf
from pathlib import Path
from typing import Any

from umo.cycle.frame import Frame
from umo.cycle.trace import Trace, lines
from umo.errors import text_of
from umo.exit_status import ExitStatus
from umo.system.folders import remove, replaced
from umo.system.processes import identity, is_used
from umo_command.console import say
from umo_command.run.run_folder import RUNS, TRACE_PAUSE, RunSummary

PARTS = 10
"""Approximate number of parts into which a trace with a limit is divided."""
PENDING_ROWS = 4096
"""Largest number of rows that wait for the next writing."""
SUMMARY_PAUSE = 60.0
"""Time in s on the machine's clock between two summaries during the run."""


class TraceParts:
    """An observer that writes every period to `trace-000001.csv` and so on in a folder, with at most `limit` bytes in
    total. The oldest parts are removed. A write error is reported once and leaves a gap; `complete` is then False."""

    def __init__(self, folder: Path, limit: int) -> None:
        self._folder = folder
        self._limit = limit
        self._pending = Trace(PENDING_ROWS)
        self._parts: deque[Path] = deque()
        self._sizes: deque[int] = deque()
        self._number = 0
        self._next = -inf
        self._torn = False
        """True if the last part may end in the middle of a row."""
        self.complete = True

    def __call__(self, frame: Frame) -> None:
        self._pending(frame)
        if frame.time >= self._next or self._pending.full:
            self._next = frame.time + TRACE_PAUSE
            self.write()

    def write(self) -> None:
        """Write the waiting rows. This is also called at the end."""
        rows = b"".join(map(_encoded, lines(self._pending, after=-inf)))
        if rows:
            self._append(rows)
            self._pending.clear()

    def _append(self, rows: bytes) -> None:
        if self._torn or not self._parts or self._sizes[-1] + len(rows) > self._limit // PARTS:
            self._torn = False
            self._number += 1
            self._parts.append(self._folder / f"trace-{self._number:06}.csv")
            self._sizes.append(0)
            rows = _encoded(next(lines(self._pending))) + rows
        while len(self._parts) > 1 and sum(self._sizes) + len(rows) > self._limit:
            remove(self._parts.popleft())
            self._sizes.popleft()
        try:
            with self._parts[-1].open("ab") as file:
                file.write(rows)
        except OSError as error:
            self._give_up(error)
        else:
            self._sizes[-1] += len(rows)

    def _give_up(self, error: OSError) -> None:
        """Remove a row that was only partly written. If this succeeds, the rows after the gap go to the same part."""
        path, size = self._parts[-1], self._sizes[-1]
        try:
            os.truncate(path, size)
        except OSError:
            self._torn = True
        if not size:
            self._parts.pop()
            self._sizes.pop()
            remove(path)
        if self.complete:
            self.complete = False
            say(f"{path} cannot be written: {text_of(error)}; the run continues, and its trace has a gap", "red")


class RunningSummary:
    """An observer that writes the present summary of the run, at most once per minute."""

    def __init__(self, result: RunSummary, path: Path) -> None:
        self._result = result
        self._path = path
        self._next = -inf
        self._failed = False

    def __call__(self, frame: Frame) -> None:
        if frame.time < self._next:
            return
        self._next = frame.time + SUMMARY_PAUSE
        self._result.progress = frame.progress
        self._result.outcome.simulated = frame.time
        try:
            with replaced(self._path) as file:
                self._result.save(file, running=True)
        except OSError as error:
            if not self._failed:
                say(f"{self._path} cannot be written: {text_of(error)}; the run continues and tries again", "red")
            self._failed = True


@dataclass(frozen=True)
class RecordedRun:
    """A folder in `runs/`."""

    path: Path
    station: str
    state: str
    """The state: "ended", "running", or "killed", if `umo run` has ended without writing a summary."""
    status: int | None
    """Exit status; None unless the run has ended."""
    how: str
    """The failure of the run, who has stopped it, or "--until"; "" if none applies, or this is not known."""
    started: float
    """Wall-clock time in s of the start; 0 if it is not known."""
    written: float
    """Wall-clock time in s at which the folder was last changed."""

    @property
    def size(self) -> int:
        """Number of bytes of the files in the folder; 0 if the folder has been removed."""
        size = 0
        with suppress(OSError):
            for path in self.path.iterdir():
                size += path.lstat().st_size
        return size

    @property
    def failed(self) -> bool:
        return self.state == "killed" or self.status in (ExitStatus.FAILED, ExitStatus.UNREACHED)

    @property
    def sentence(self) -> str:
        """A sentence that says how the run ended."""
        status = "" if self.status is None else f" with status {self.status}"
        verb = {"killed": "was killed", "running": "is running"}.get(self.state, f"ended{status}")
        return f"{self.path.name} {verb}{f': {self.how}' if self.how else ''}"


def newest(runs: Iterable[RecordedRun]) -> list[RecordedRun]:
    """Return the newest run of each station, the newest first. `runs`: the result of `recorded`."""
    by_station = {run.station: run for run in runs}
    return sorted(by_station.values(), key=lambda run: -run.written)


def recorded(station: str | None = None) -> Iterator[RecordedRun]:
    """Return the runs in `runs/`, sorted by name, that is, by station and start. If a station is given, return only its
    runs."""
    for path in sorted(RUNS.glob("*/run.json")):
        folder, about = path.parent, _read(path)
        name = about.get("station")
        if folder.is_symlink() or not isinstance(name, str) or station not in (None, name):
            continue
        summary = _read(folder / "summary.json")
        status = summary.get("status") if isinstance(summary.get("status"), int) else None
        state = "ended" if status is not None else "running" if _lives(about) else "killed"
        yield RecordedRun(folder, name, state, status, _how(summary), _started(about), _written(folder))


def _how(summary: dict[str, Any]) -> str:
    failure, by = (summary.get(key) for key in ("failure", "stopped_by"))
    if isinstance(failure, str) and failure:
        return failure
    if isinstance(by, str) and by:
        return f"stopped by {by}"
    return "--until" if summary.get("status") == ExitStatus.TIME_OVER else ""


def prune(keep: int, station: str | None = None) -> dict[Path, int]:
    """Remove all but the newest `keep` runs of each station, or of the given one. Active runs are not removed. Return
    the removed folders, each with the number of bytes that it had."""
    by_station: dict[str, list[RecordedRun]] = {}
    for run in recorded(station):
        by_station.setdefault(run.station, []).append(run)
    old = [run for runs in by_station.values() for run in runs[: max(0, len(runs) - keep)] if run.state != "running"]
    sizes = {run.path: run.size for run in old}
    for path in sizes:
        shutil.rmtree(path, ignore_errors=True)
    return {path: size for path, size in sizes.items() if not path.exists()}


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


def _started(about: dict[str, Any]) -> float:
    try:
        return datetime.fromisoformat(str(about.get("started"))).timestamp()
    except (ValueError, OverflowError, OSError):
        return 0.0


def _written(folder: Path) -> float:
    """Return the time of day at which a folder was changed; 0 if it has just been removed."""
    with suppress(OSError):
        return folder.stat().st_mtime
    return 0.0


def _read(path: Path) -> dict[str, Any]:
    """Return a file's JSON; empty if it has none."""
    try:
        data = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _lives(about: dict[str, Any]) -> bool:
    """True if the process of a run is alive. Another process may have the same number by now, above all after a restart
    of the computer: a service gets nearly the same number at each boot."""
    pid, process = about.get("pid"), about.get("process")
    if not isinstance(pid, int) or pid <= 0:
        return False
    return is_used(pid) and (not process or process == identity(pid))

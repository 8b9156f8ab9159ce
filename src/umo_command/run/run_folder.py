"""The result of a run: its table, its summary, and its folder in `runs/`. From the beginning of the run the folder has
`run.json` and the trace; the summary, the failure and the plot are added at the end.

Every file is written completely or not at all. If `umo run` was killed, or could not read the frames to the end (status
4), the trace ends before the run.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from umo.cycle.fault_log import KEPT_FAULTS, FaultLog
from umo.cycle.frame import Frame
from umo.cycle.stage import Progress
from umo.cycle.trace import Statistics, Trace, lines
from umo.digits import NO_VALUE, number_text, with_short_numbers
from umo.drivers.faults.fault_syntax import InjectedFault
from umo.duration import duration
from umo.errors import UmoError, text_of
from umo.objects.presentation.run_facts import clock_text
from umo.process.job import Plan
from umo.process.outcome import Outcome
from umo.system.folders import remove, replaced
from umo.system.processes import identity
from umo.text import others, printable
from umo.wiring.json_values import as_plain
from umo_command.console import say

if TYPE_CHECKING:
    from umo.operation.alarms.alarm_log import AlarmLog

RUNS = Path("runs")
TRACE_PAUSE = 1.0
"""Time in s on the machine's clock between two writings of the trace during the run."""
MAX_SHOWN = 5
"""Number of faults of equipment that are shown."""
MAX_VALUE_LENGTH = 1000
"""Largest number of characters of a value in the table on a terminal. Nothing is cut in a file or a pipe."""


@dataclass
class RunSummary:
    """The data of one run for its table and its summary."""

    statistics: Statistics
    outcome: Outcome = field(default_factory=Outcome)
    progress: Progress = field(default_factory=Progress)
    """Last progress that the machine reported."""
    elapsed: float = 0.0
    """Wall-clock duration in s of a run in virtual time."""
    realtime: bool = False
    """True if the run keeps the pace of the wall clock."""
    injected: Sequence[str] = ()
    """Faults that were injected on purpose."""
    equipment_faults: FaultLog = field(default_factory=FaultLog)
    alarms: AlarmLog | None = None
    """The log of alarms; None if the machine has no alarms."""

    @property
    def realtime_factor(self) -> float | None:
        """How many times faster than the clock the run was; None in real time, and before the first period."""
        if self.realtime or not (self.elapsed and self.statistics.periods):
            return None
        return self.outcome.simulated / self.elapsed

    @property
    def failed(self) -> str:
        """The reason why the run failed, on one line; "" if it did not fail."""
        failure = self.outcome.failure
        return "" if failure is None else failure.message.partition("\n")[0]

    @property
    def not_begun(self) -> list[str]:
        """The injected faults whose time had not come when the run ended."""
        return [each for each in self.injected if float(InjectedFault.parse(each).at) > self.outcome.simulated]

    def summary(self, *, running: bool = False) -> dict[str, Any]:
        """Return the summary as plain data. This is also possible during the run."""
        statistics = self.statistics
        optional: dict[str, Any] = {"injected_faults": list(self.injected)} if self.injected else {}
        if not running and (not_begun := self.not_begun):
            optional["injected_faults_not_begun"] = not_begun
        if mistakes := self.equipment_faults.mistakes:
            optional["mistakes"] = [asdict(each) for each in mistakes]
        return optional | {
            "state": "running" if running else "ended",
            "status": None if running else self.outcome.status,
            "failure": self.failed,
            "stopped_by": self.outcome.stopper,
            "progress": self.progress._asdict(),
            "equipment_faults": self._faults(),
            "alarms": self._alarms(),
            "periods": statistics.periods,
            "missed_periods": statistics.missed,
            "period_us": {
                "median": _rounded(statistics.percentile(50), 2),
                "p99": _rounded(statistics.percentile(99), 2),
            },
            "realtime_factor": _rounded(self.realtime_factor, 3),
            "reports": self.outcome.reports,
            "result": self.outcome.result,
        }

    def save(self, path: Path, *, running: bool = False) -> None:
        path.write_text(json.dumps(self.summary(running=running), indent=2) + "\n", encoding="utf-8")

    def table(self, title: str, longest: int | None = None) -> Table:
        """Return the table of the run. Long values wrap; those with more than `longest` characters are cut. None means
        that no value is cut."""
        table = Table(title=title, title_justify="left", show_header=False)
        table.add_column(overflow="fold")
        table.add_column(overflow="fold")
        for name, value in self._rows():
            table.add_row(name, value if longest is None or len(value) <= longest else f"{value[:longest]}...")
        return table

    def _rows(self) -> Iterator[tuple[str, str]]:
        """Yield the rows of the table."""
        for fault in self.injected:
            end = f": it did not begin, as the run ended at {self.outcome.simulated:g} s"
            yield "injected fault", fault + (end if fault in self.not_begun else "")
        if self.progress.total:
            yield "progress", f"{self.progress.done} of {self.progress.total}, {self.progress.text}"
        yield from self._fault_rows()
        yield from self._alarm_rows()
        yield from self._mistake_rows()
        statistics = self.statistics
        why = " (why: `umo show why`)" if statistics.missed else ""
        yield "periods", f"{statistics.periods}, missed {statistics.missed}{why}"
        median, p99 = (NO_VALUE if us is None else duration(us * 1e-6) for us in map(statistics.percentile, (50, 99)))
        yield "execution time of a period", f"median {median}, p99 {p99}"
        factor = NO_VALUE if self.realtime_factor is None else number_text(self.realtime_factor)
        took = "real time" if self.realtime else f"{duration(self.elapsed)}, {factor} x real time"
        yield "time", f"{duration(self.outcome.simulated)} in {took}"
        for driver, report in self.outcome.reports.items():
            for name, value in rows("report", report):
                yield f"{driver}: {name}", value
        yield from rows("result", self.outcome.result)

    def standing_faults(self) -> list[str]:
        """Return a line for each of the first few parts that are in fault at the end, and the number of the others."""
        standing = self.equipment_faults.standing.values()
        lines = [
            f"still in fault at the end: {each.path}, since {clock_text(each.time)}: {each.reason}" for each in standing
        ]
        more = [f"and {len(lines) - MAX_SHOWN} more"] if len(lines) > MAX_SHOWN else []
        return lines[:MAX_SHOWN] + more

    def _faults(self) -> dict[str, Any]:
        """Return the faults of equipment as plain data."""
        faults = self.equipment_faults
        last = [asdict(fault) for fault in faults.last]
        return {"number": faults.number, "standing": list(faults.standing), "last": last}

    def _fault_rows(self) -> Iterator[tuple[str, str]]:
        """Yield a row with the number of the faults of equipment, and rows with the last faults."""
        faults = self.equipment_faults
        if not faults.number:
            return
        standing = len(faults.standing)
        ends = "all cleared" if not standing else f"{standing} not cleared"
        yield "faults of equipment", f"{faults.number}, {ends}"
        shown = list(faults.last)[-MAX_SHOWN:]
        for fault in shown:
            yield fault.path, _text(str(fault))
        if earlier := faults.number - len(shown):
            yield "", f"and {earlier} earlier"

    def _alarms(self) -> dict[str, Any]:
        """Return the alarms as plain data: the alarms that were raised, and the last times for which they were
        active."""
        log = self.alarms
        if log is None:
            return {"raised": 0, "active": [], "each": {}, "last": []}
        each = {
            alarm.path: {
                "text": alarm.text,
                "priority": str(alarm.priority),
                "raised": alarm.raised,
                "active_s": round(alarm.active_s(log.now), 9),
                "state": str(alarm.state),
            }
            for alarm in log.raised
        }
        last = [asdict(span) for span in list(log.spans)[-KEPT_FAULTS:]]
        return {"raised": log.number, "active": log.active, "each": each, "last": last}

    def _alarm_rows(self) -> Iterator[tuple[str, str]]:
        """Yield a row that says how often alarms were raised, and a row for each of the most important alarms."""
        log = self.alarms
        if log is None or not log.number:
            return
        active = len(log.active)
        yield "alarms", f"{log.number} raised, {f'{active} active at the end' if active else 'all cleared'}"
        shown = log.raised[:MAX_SHOWN]
        for alarm in shown:
            yield alarm.path, _text(alarm.in_words(log.now))
        if more := len(log.raised) - len(shown):
            yield "", f"and {others(more)}"

    def _mistake_rows(self) -> Iterator[tuple[str, str]]:
        """Yield rows with the first mistakes of the program, and a row with the number of the others."""
        mistakes = self.equipment_faults.mistakes
        for each in mistakes[:MAX_SHOWN]:
            yield f"mistake: {each.path}", printable(each.text)
        if more := len(mistakes[MAX_SHOWN:]):
            yield "", f"and {others(more)}"


def rows(name: str, data: Any) -> Iterator[tuple[str, str]]:
    """Return rows for plain data: one row for each entry if the data are a dict, otherwise one row under this name."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield printable(str(key).replace("_", " ")), _text(value)
    elif data is not None:
        yield name, _text(data)


def _text(value: Any) -> str:
    if value is None:
        return NO_VALUE
    if isinstance(value, dict) and value and all(isinstance(each, dict) for each in value.values()):
        return _lines_of(value)
    is_number = isinstance(value, float) and isfinite(value)
    return number_text(value) if is_number else with_short_numbers(printable(str(value)))


def _lines_of(tables: dict[str, dict[str, Any]]) -> str:
    """Return a line for each of the first few tables, with its numbers and strings. All values are in the summary."""
    lines = [
        f"{key}: {', '.join(f'{name} {each}' for name, each in table.items() if not isinstance(each, dict | list))}"
        for key, table in tables.items()
    ]
    more = [f"and {others(len(lines) - MAX_SHOWN)}"] if len(lines) > MAX_SHOWN else []
    return "\n".join(_text(line) for line in lines[:MAX_SHOWN] + more)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


class NotRecorded(UmoError, OSError):
    """Raised if a run cannot be recorded, because the disk of `runs/` is full, or `runs/` is read-only or not a
    folder."""


class RunFolder:
    def __init__(self, path: Path, alone: bool = False) -> None:
        self.path = path
        self._alone = alone
        """True if `runs/` was made for this folder."""
        self.complete = True
        """True if everything was written."""

    @classmethod
    def make(cls, plan: Plan) -> RunFolder:
        """Make a new folder, with the facts of the run in `run.json`. Raises NotRecorded if the folder cannot be
        written."""
        now, job = datetime.now(), plan.job
        about: dict[str, Any] = {"station": plan.name, "wiring": job.wiring or plan.wiring_name or None}
        about |= {"options": job.options, "manual": job.manual, "until": job.until}
        about |= {"started": now.astimezone().isoformat(), "pid": os.getpid(), "process": identity(os.getpid())}
        about |= {"command": sys.argv}
        folder, alone = None, not RUNS.exists()
        try:
            folder = cls(_new_folder(f"{plan.name}-{now:%Y%m%d-%H%M%S}"), alone)
            with replaced(folder.path / "run.json") as file:
                _write(file, json.dumps(about, indent=2, default=as_plain) + "\n")
        except OSError as error:
            if folder is not None:
                folder.discard()
            why = "it is not a folder" if RUNS.is_file() else error.strerror or text_of(error)
            raise NotRecorded(f"{RUNS}/ cannot be written: {why}; --no-record runs without a record") from error
        return folder

    def discard(self) -> None:
        """Remove the folder of a run in which nothing ran."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._alone:
            with suppress(OSError):  # `runs/` contains other folders
                RUNS.rmdir()

    def save(self, result: RunSummary, trace: Trace) -> None:
        """Write all files but the plot. If this fails, print the failure and mark the record as incomplete."""
        failure = result.outcome.failure
        if failure is not None:
            text = f"{failure.message}\n{failure.traceback}"
            self._save("failure.txt", lambda file: _write(file, text))
        self._save("summary.json", result.save)
        if not self._save("trace.csv", trace.save):
            remove(self.path / "trace.csv")  # the trace ends before the end of the run

    def _save(self, name: str, write: Callable[[Path], object]) -> bool:
        try:
            with replaced(self.path / name) as file:
                write(file)
        except OSError as error:
            self.lost(name, error)
            return False
        return True

    def lost(self, name: str, error: OSError) -> None:
        """Report that a file could not be written, and mark the record as incomplete."""
        self.complete = False
        say(f"{self.path / name} could not be written: {text_of(error)}", "red")


class TraceFile:
    """An observer that writes the rows of a trace during the run, so that they remain if `umo run` is killed."""

    def __init__(self, trace: Trace, path: Path) -> None:
        self._trace = trace
        self._path = path
        self._next = self._written = float("-inf")
        """Time of the next writing, and time of the last row that was written, on the machine's clock."""
        self._failed = False

    def __call__(self, frame: Frame) -> None:
        if frame.time < self._next or self._failed:
            return
        first = self._written == float("-inf")
        try:
            with self._path.open("a", newline="", encoding="utf-8", errors="backslashreplace") as file:
                file.writelines(lines(self._trace, after=None if first else self._written))
        except OSError as error:
            self._failed = True
            remove(self._path)  # the file may end in the middle of a row
            say(
                f"{self._path} cannot be written: {text_of(error)}; the run continues, and umo tries to write the "
                f"trace at the end",
                "red",
            )
        self._written, self._next = frame.time, frame.time + TRACE_PAUSE


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", errors="backslashreplace")


def _new_folder(name: str) -> Path:
    """Make a separate folder in runs/, even if two runs begin within the same second."""
    RUNS.mkdir(exist_ok=True)
    folder, number = RUNS / name, 1
    while True:
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            number += 1
            folder = RUNS / f"{name}-{number}"
        except FileNotFoundError:  # another run, which was refused, has removed it
            RUNS.mkdir(exist_ok=True)

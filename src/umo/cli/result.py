"""What came of a run: the table, the summary, the exit status."""

from __future__ import annotations

import json
import signal
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

import umo
from umo.cycle.record import Statistics
from umo.drivers import Driver
from umo.errors import (
    AlreadyRunning,
    DeclarationError,
    PathError,
    RangeError,
    StateError,
    StopError,
    UmoError,
    WiringError,
)
from umo.objects import Compound

from .station import StationError

USER_ERRORS = (
    WiringError,
    DeclarationError,
    PathError,
    RangeError,
    StateError,
    AlreadyRunning,
    StationError,
)


@dataclass
class Result:
    """One run, as its table and its summary show it. Lengths in um, angles in deg, times in s."""

    statistics: Statistics
    parts_placed: int | None = None
    parts_total: int | None = None
    error_um: float | None = None
    error_deg: float | None = None
    truth: bool = False
    """Whether the parts were counted by the plant itself, not by the control code."""
    simulated: float = 0.0
    elapsed: float = 0.0
    failure: BaseException | None = None
    stopped_by: int | None = None
    notes: list[str] = field(default_factory=list)

    def inspect(self, machine: Compound, drivers: Mapping[str, Driver]) -> None:
        """Count the parts: by a plant's own report where there is one, else as the control code did."""
        self.parts_total = getattr(machine, "parts_total", None)
        self.parts_placed = getattr(machine, "placed", None)
        for driver in drivers.values():
            report = getattr(driver, "report", None)
            if report is None:
                continue
            parts = report().parts
            self.truth = True
            self.parts_placed = sum(part.placed for part in parts)
            self.error_um = max((p.error_um for p in parts if p.error_um is not None), default=None)
            self.error_deg = max((p.error_deg for p in parts if p.error_deg is not None), default=None)

    @property
    def realtime_factor(self) -> float | None:
        return self.simulated / self.elapsed if self.elapsed and self.statistics.periods else None

    @property
    def all_placed(self) -> bool:
        return not self.parts_total or self.parts_placed == self.parts_total

    @property
    def status(self) -> int:
        """0: all placed. 1: not all, or the machine failed. 2: the user's mistake. 3: an output was not reached."""
        if self.failure is not None:
            return status_of(self.failure)
        if self.stopped_by is not None:
            return 128 + self.stopped_by
        return 0 if self.all_placed else 1

    def summary(self) -> dict[str, Any]:
        statistics = self.statistics
        return {
            "parts_placed": self.parts_placed,
            "parts_total": self.parts_total,
            "placing_error_um": _rounded(self.error_um, 3),
            "placing_error_deg": _rounded(self.error_deg, 6),
            "periods": statistics.periods,
            "missed_periods": statistics.missed,
            "period_us": {
                "median": _rounded(statistics.percentile(50), 2),
                "p99": _rounded(statistics.percentile(99), 2),
            },
            "realtime_factor": _rounded(self.realtime_factor, 3),
        }

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(self.summary(), indent=2) + "\n", encoding="utf-8")

    def table(self, title: str) -> Table:
        table = Table(title=title, title_justify="left", show_header=False)
        who = "by the plant's truth" if self.truth else "as counted by the control code"
        if self.parts_total is not None:
            table.add_row("parts placed", f"{self.parts_placed} of {self.parts_total}, {who}")
            table.add_row(
                "worst placing error", f"{_shown(self.error_um, '.1f')} um, {_shown(self.error_deg, '.3f')} deg"
            )
        statistics = self.statistics
        table.add_row("periods", f"{statistics.periods}, missed {statistics.missed}")
        median, p99 = (_shown(statistics.percentile(q), ".1f") for q in (50, 99))
        table.add_row("execution time of a period", f"median {median} us, p99 {p99} us")
        table.add_row(
            "time", f"{self.simulated:.2f} s in {self.elapsed:.2f} s, {_shown(self.realtime_factor, '.2f')} x real time"
        )
        return table


def status_of(failure: BaseException) -> int:
    if isinstance(failure, StopError):
        return 3
    return 2 if isinstance(failure, USER_ERRORS) else 1


def message_of(failure: BaseException) -> str:
    """One or two lines; for an exception of the user's own code with the place in it."""
    if isinstance(failure, StopError) and failure.__cause__ is not None:
        return f"{message_of(failure.__cause__)}\n{failure}"
    if isinstance(failure, UmoError):
        notes = getattr(failure, "__notes__", [])
        return "\n".join([str(failure), *notes])
    package = str(Path(umo.__file__).parent / "c")  # cycle, control, cli: never the user's
    frames = [frame for frame in traceback.extract_tb(failure.__traceback__) if not frame.filename.startswith(package)]
    where = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    return f"{type(failure).__name__}: {failure}{where} (--traceback shows all of it)"


def signal_name(number: int) -> str:
    return signal.Signals(number).name


def _shown(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)

"""The result of a run: table, summary, exit status."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.cycle.stage import Progress
from umo.cycle.trace import Statistics
from umo.presentation.digits import number_text
from umo.process.outcome import Outcome
from umo.text import printable

MAX_VALUE_LENGTH = 100
"""Characters of a value in the table, at most."""


@dataclass
class RunSummary:
    """One run, as its table and its summary show it."""

    statistics: Statistics
    outcome: Outcome = field(default_factory=Outcome)
    progress: Progress = field(default_factory=Progress)
    """Last progress that the machine told."""
    elapsed: float = 0.0
    """s of wall-clock time."""
    faults: Sequence[str] = ()
    """Faults that were injected on purpose."""

    @property
    def realtime_factor(self) -> float | None:
        return self.outcome.simulated / self.elapsed if self.elapsed and self.statistics.periods else None

    @property
    def failed(self) -> str:
        """Reason why the run failed, in a line; "": it did not."""
        failure = self.outcome.failure
        return "" if failure is None else failure.message.partition("\n")[0]

    def summary(self) -> dict[str, Any]:
        statistics = self.statistics
        injected = {"injected_faults": list(self.faults)} if self.faults else {}
        return injected | {
            "status": self.outcome.status,
            "failure": self.failed,
            "progress": self.progress._asdict(),
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

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(self.summary(), indent=2) + "\n", encoding="utf-8")

    def table(self, title: str) -> Table:
        table = Table(title=title, title_justify="left", show_header=False)
        for fault in self.faults:
            table.add_row("injected fault", fault)
        if self.progress.total:
            table.add_row("progress", f"{self.progress.done} of {self.progress.total}, {self.progress.text}")
        statistics = self.statistics
        why = " (why: `umo why`)" if statistics.missed else ""
        table.add_row("periods", f"{statistics.periods}, missed {statistics.missed}{why}")
        median, p99 = (_shown(statistics.percentile(q), ".1f") for q in (50, 99))
        table.add_row("execution time of a period", f"median {median} µs, p99 {p99} µs")
        factor = _shown(self.realtime_factor, ".2f")
        table.add_row("time", f"{self.outcome.simulated:.2f} s in {self.elapsed:.2f} s, {factor} x real time")
        for driver, report in self.outcome.reports.items():
            for name, value in rows("report", report):
                table.add_row(f"{driver}: {name}", value)
        for name, value in rows("result", self.outcome.result):
            table.add_row(name, value)
        return table


def rows(name: str, data: Any) -> Iterator[tuple[str, str]]:
    """Plain data: a row for each entry of a dict, else one under this name."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield printable(str(key).replace("_", " ")), _text(value)
    elif data is not None:
        yield name, _text(data)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    text = number_text(value) if isinstance(value, float) and isfinite(value) else printable(str(value))
    return text if len(text) <= MAX_VALUE_LENGTH else f"{text[:MAX_VALUE_LENGTH]}..."


def _shown(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)

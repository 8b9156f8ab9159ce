"""The result of a run: table, summary, exit status."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.cycle.trace import Statistics
from umo.process.outcome import Outcome


@dataclass
class Result:
    """One run, as its table and its summary show it."""

    statistics: Statistics
    outcome: Outcome = field(default_factory=Outcome)
    elapsed: float = 0.0
    """s of wall-clock time."""

    @property
    def realtime_factor(self) -> float | None:
        return self.outcome.simulated / self.elapsed if self.elapsed and self.statistics.periods else None

    def summary(self) -> dict[str, Any]:
        statistics, parts = self.statistics, self.outcome.parts
        return {
            "parts_placed": parts.placed,
            "parts_total": parts.total,
            "placing_error_um": _rounded(parts.error_um, 3),
            "placing_error_deg": _rounded(parts.error_deg, 6),
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
        parts = self.outcome.parts
        who = "by the plant's truth" if parts.truth else "as counted by the control code"
        if parts.total is not None:
            table.add_row("parts placed", f"{parts.placed} of {parts.total}, {who}")
            table.add_row(
                "worst placing error", f"{_shown(parts.error_um, '.1f')} um, {_shown(parts.error_deg, '.3f')} deg"
            )
        statistics = self.statistics
        table.add_row("periods", f"{statistics.periods}, missed {statistics.missed}")
        median, p99 = (_shown(statistics.percentile(q), ".1f") for q in (50, 99))
        table.add_row("execution time of a period", f"median {median} us, p99 {p99} us")
        factor = _shown(self.realtime_factor, ".2f")
        table.add_row("time", f"{self.outcome.simulated:.2f} s in {self.elapsed:.2f} s, {factor} x real time")
        return table


def _shown(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)

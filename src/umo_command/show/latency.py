"""`umo show latency`: measures whether this computer can keep a given sampling period."""

from __future__ import annotations

import json
from math import log10
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from umo.commissioning.latency import Samples, judge, measure
from umo.commissioning.latency.law_times import LawTimes, law_times
from umo.commissioning.latency.measure import Measured
from umo.commissioning.latency.verdict import advice, recommend
from umo.digits import number_text
from umo.duration import duration
from umo.errors import RangeError
from umo.process.start import LINUX
from umo_command.console import err, out, say
from umo_command.values import check_file

MIN_PERIOD, MAX_PERIOD = 50e-6, 1.0
QUANTILES = (("least", 0), ("median", 50), ("99 %", 99), ("99.9 %", 99.9), ("longest", 100))
BAR_WIDTH = 30


def latency(step: float, seconds: float, load: bool, file: Path | None) -> None:
    if not MIN_PERIOD <= step <= MAX_PERIOD:
        raise RangeError(f"--period {duration(step)}: umo show latency measures periods from 50 us to 1 s")
    if not LINUX:
        raise RangeError("umo show latency needs Linux: umo runs in real time on Linux only")
    check_file("--out", file)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    # without a drawing thread, which would run during the measurement
    with Progress(*columns, console=err, transient=True, auto_refresh=False, disable=not err.is_terminal) as bar:
        task = bar.add_task(f"{duration(step)}, umo's loop and a C loop alternately", total=1.0)
        bar.refresh()
        found = measure(
            step, seconds, load=load, progress=lambda share: bar.update(task, completed=share, refresh=True)
        )
    if found.c is None:
        say("no C compiler found (cc, gcc, clang): the C loop is not measured")
    out.print(_table(found, load))
    for line in _histogram(found):
        out.print(line)
    if advised := recommend(found):
        out.print(f"\n{advised}", soft_wrap=True)
    laws = law_times()
    if laws is not None:
        out.print(f"\n{laws.advice(step)}", soft_wrap=True)
    lines = advice(found)
    if lines:
        out.print("\nWhat would help:")
        for line in lines:
            out.print(f"- {line}", soft_wrap=True)
    answer = judge(found)
    out.print(f"\n{duration(step)}: {answer.word}. {answer.text}", style="bold", soft_wrap=True)
    if file is not None:
        file.write_text(json.dumps(_as_json(found, load, laws), indent=2) + "\n", encoding="utf-8")


def _table(found: Measured, load: bool) -> Table:
    beside = "with load on every core" if load else "without added load"
    table = Table(title=f"{duration(found.period)}, {beside}, µs", title_justify="left", header_style="bold")
    for name in ("", *(name for name, _ in QUANTILES), "missed", "processor"):
        table.add_column(name, justify="right" if name else "left")
    for title, pick in (("waking up", "wake"), ("working", "work"), ("together", "total")):
        for name, samples in found.loops.items():
            last = [str(samples.missed), f"{samples.busy:.0%}"] if pick == "total" else ["", ""]
            table.add_row(
                f"{title}, {name}", *(number_text(value, 1) for value in _quantiles(getattr(samples, pick))), *last
            )
    for name, umo in (("", found.umo), (", busy waiting", found.umo_busy)):
        if found.c is not None and len(found.c.total) and len(umo.total):
            ratios = _quantiles(umo.total) / _quantiles(found.c.total)
            table.add_row(f"umo{name} / C", *(number_text(ratio, 2) for ratio in ratios), "", "", style="bold")
    return table


def _quantiles(values: Any) -> Any:
    return np.percentile(values, [q for _, q in QUANTILES]) if len(values) else np.full(len(QUANTILES), np.nan)


def _histogram(found: Measured) -> list[str]:
    """Return a histogram of the sum of wake-up delay and work, in steps of a third of a decade, with both loops side by
    side."""
    loops = [("umo", found.by_itself)] + ([("C", found.c)] if found.c is not None else [])
    totals = [samples.total for _, samples in loops if len(samples.total)]
    if not totals:
        return []
    low, high = min(t.min() for t in totals), max(t.max() for t in totals)
    edges = 10 ** (np.arange(int(3 * log10(max(low, 0.1))), int(3 * log10(high)) + 2) / 3)
    counts = [np.histogram(samples.total, edges)[0] for _, samples in loops]
    lines = ["", f"{'µs, together':>16}  " + "  ".join(f"{name:<{BAR_WIDTH}}" for name, _ in loops).rstrip()]
    for row in range(len(edges) - 1):
        bars = "  ".join(f"{_bar(int(count[row]), int(count.sum())):<{BAR_WIDTH}}" for count in counts)
        lines.append(f"{edges[row]:>7.0f} -{edges[row + 1]:>7.0f}  {bars}".rstrip())
    return lines


def _bar(count: int, total: int) -> str:
    """Return a bar whose length is the logarithm of the count, so that a count of 1 in a million is still visible."""
    if not count:
        return ""
    room = BAR_WIDTH - 9
    return "█" * max(1, round(room * log10(count + 1) / log10(total + 1))) + f" {count:,}"


def _as_json(found: Measured, load: bool, laws: LawTimes | None) -> dict[str, Any]:
    answer = judge(found)
    loops = {"umo": found.umo, "umo_busy": found.umo_busy, "c": found.c, "c_busy": found.c_busy}
    return {
        "period_us": found.period * 1e6,
        "load": load,
        "busy_wait_us": found.busy_wait * 1e6,
        "default_busy_wait": found.granted,
        **{name: None if samples is None else _figures(samples) for name, samples in loops.items()},
        "verdict": answer.word,
        "why": answer.text,
        "recommendation": recommend(found),
        "laws_us": None if laws is None else {"python": laws.python * 1e6, "compiled": laws.compiled * 1e6},
        "advice": advice(found),
    }


def _figures(samples: Samples) -> dict[str, Any]:
    parts = {"wake_us": samples.wake, "work_us": samples.work, "together_us": samples.total}
    figures = {
        key: {name: round(float(v), 2) for (name, _), v in zip(QUANTILES, _quantiles(values), strict=True)}
        for key, values in parts.items()
    }
    return {**figures, "periods": len(samples.total), "missed": samples.missed, "processor": round(samples.busy, 3)}

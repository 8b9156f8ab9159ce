"""`python -m bench --kills`: the estimate, the bar, the table, and every try that was not as it must be."""

from __future__ import annotations

import platform

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bench.kills import box, campaign
from bench.kills.campaign import Row, Try
from bench.kills.kinds import KINDS, possible
from bench.report import duration

LINES = 100
"""Tries for a line, where there is no terminal for a bar."""
QUICK = 0.03
"""The share of the full numbers: about one try of each kind."""


def run(
    console: Console, *, quick: bool, only: str = "", seed: int = campaign.SEED, jobs: int = 1, first: int = 0
) -> int:
    """The whole campaign, from the `first` try on; the exit status, 1 if anything was unsafe or not as it must be."""
    if (why := box.missing()) is not None:
        console.print(f"not measured: {why}")
        return 1
    kinds = [kind for kind in KINDS if only.lower() in kind.name.lower()]
    if not kinds:
        console.print(f"no kind has {only!r} in its name")
        return 2
    for kind in kinds:
        if not possible(kind):
            console.print(f"left out, not permitted here: {kind.name}")
    kinds = [kind for kind in kinds if possible(kind)]
    share = QUICK if quick else 1.0
    numbers = campaign.counts(kinds, share)
    total, seconds = sum(numbers.values()), campaign.expected(kinds, numbers)
    console.print(
        f"{total} tries of {len(kinds)} kinds, about {duration(seconds / jobs)}; {platform.machine()}, seed {seed}"
    )
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    if first:
        console.print(f"from try {first} on")
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("kills", total=total, completed=first)

        def said(one: Try) -> None:
            bar.update(task, advance=1, description=one.kind)
            done = int(bar.tasks[task].completed)
            if not console.is_terminal and done % LINES == 0:
                console.print(f"{done} of {total} tries")
            if one.unsafe or one.wrong:
                console.print(str(one), markup=False, highlight=False, soft_wrap=True)

        rows = campaign.measure(kinds, share, seed, said, jobs, first)
    console.print(grid(rows))
    unsafe, wrong = (sum(len(getattr(row, what)) for row in rows) for what in ("unsafe", "wrong"))
    if oldest := max((one.kept_age for row in rows for one in row.tries), default=0.0):
        console.print(f"where all were killed at once, kept values were up to {oldest:.2f} s old")
    console.print(f"{sum(len(row.tries) for row in rows)} tries: {unsafe} unsafe, {wrong} not as they must be")
    return 1 if unsafe or wrong else 0


def grid(rows: list[Row]) -> Table:
    table = Table(title="from the strike to the last output at its default, ms")
    table.add_column("kind")
    for name in ("n", "median", "p99", "worst", "wrong", "unsafe"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(row.kind.name, str(len(row.tries)), *_times(row), _bad(row.wrong), _bad(row.unsafe))
    table.caption = "wrong: the exit status, a good reading that was not the box's, or what was kept"
    return table


def _times(row: Row) -> tuple[str, str, str]:
    if not row.times:
        return "-", "-", "-"
    middle, late, worst = (f"{value:,.0f}" for value in np.percentile(row.times, [50, 99, 100]))
    return middle, late, worst


def _bad(tries: list[Try]) -> str:
    return f"[red]{len(tries)}[/red]" if tries else "0"

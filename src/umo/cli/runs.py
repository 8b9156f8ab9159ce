"""`umo runs`: the runs in `runs/`."""

from __future__ import annotations

from .console import out, plain_table
from .long_runs import RecordedRun, prune, recorded
from .run_folder import RUNS


def show_runs(station: str | None, keep: int | None) -> None:
    """List the runs, after all but the newest `keep` were removed, where that is asked."""
    if keep is not None:
        removed = prune(keep, station)
        out.print(f"removed: {len(removed)} runs, {_megabytes(sum(run.size for run in removed))}")
    found = list(recorded(station))
    if not found:
        out.print(f"no run in {RUNS}/")
        return
    table = plain_table()
    for title in ("run", "state", "size"):
        table.add_column(title)
    for run in found:
        table.add_row(run.path.name, _state(run), _megabytes(run.size))
    out.print(table)


def _state(run: RecordedRun) -> str:
    return run.state if run.status is None else f"{run.state}, status {run.status}"


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"

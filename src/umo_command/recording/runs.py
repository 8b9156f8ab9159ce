"""`umo recording runs`: lists or removes the runs in `runs/`."""

from __future__ import annotations

from umo.text import did_you_mean, printable
from umo_command.console import out, plain_table
from umo_command.run.long_runs import RecordedRun, prune, recorded
from umo_command.run.run_folder import RUNS


def show_runs(station: str | None, keep: int | None) -> None:
    """List the runs. If `keep` is given, first remove all but the newest `keep` runs."""
    if keep is not None:
        removed = prune(keep, station)
        out.print(f"removed: {len(removed)} runs, {_megabytes(sum(removed.values()))}")
    found = list(recorded(station))
    if not found:
        out.print(_none(station))
        return
    table = plain_table()
    for title in ("run", "state", "size", "how it ended"):
        table.add_column(title, overflow="fold")
    for run in found:
        table.add_row(run.path.name, _state(run), _megabytes(run.size), printable(run.how))
    out.print(table)


def _none(station: str | None) -> str:
    others = {run.station for run in recorded()} if station is not None else set()
    if station is None or not others:
        return f"there are no runs in {RUNS}/"
    return f"there is no run of {printable(station)} in {RUNS}/{did_you_mean(station, others)}"


def _state(run: RecordedRun) -> str:
    return run.state if run.status is None else f"{run.state}, status {run.status}"


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"

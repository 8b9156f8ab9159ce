"""`umo` without a command: shows the running stations and the next steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.process.frames import RunReader, search
from umo.process.frames.alarm_list import AlarmRow
from umo.process.station import shipped
from umo.system.device_record import Ended
from umo.system.packages import MARK
from umo.text import count_of, printable

from .console import out
from .run.long_runs import newest, recorded
from .show.stations import MAX_STOPPED, show_stations, standing

Step = tuple[str, str]
"""A command with its description."""
STEPS = 3


def show_home() -> None:
    """Print the stations that run, the last failed runs of this folder, and three next steps that fit the situation."""
    show_stations()
    table = Table.grid(padding=(0, 3))
    found = search.readers()  # `show_stations` has named those that cannot be read
    failed = [run for run in newest(recorded()) if run.failed]
    for run in failed[:STEPS]:
        out.print(f"failed: {printable(run.sentence)}", no_wrap=True, overflow="ellipsis")
    for command, what in next_steps(Path.cwd(), found, standing(), [run.station for run in failed]):
        table.add_row(f"  {command}", what)
    out.print("\nNext:")
    out.print(table)
    out.print("\n`umo --help` shows all commands.")


def next_steps(
    folder: Path, found: Sequence[RunReader], stopped: Sequence[Ended] = (), failed: Sequence[str] = ()
) -> list[Step]:
    """Return three steps: first those for conditions that wait for an operator, then those that show or do something
    else. `stopped`: the machines that must be acknowledged; many of them have no step while a station runs, because
    they belong to other work. `failed`: the stations of runs that failed."""
    steps: list[Step] = []
    for reader in found:
        steps += _waiting(str(reader.about["station"]), reader, reader.latest())
    if not found or len(stopped) <= MAX_STOPPED:
        steps += [
            (
                f"umo do {printable(each.station)} acknowledge",
                "allow the next run, after you have inspected the machine",
            )
            for each in stopped
        ]
    steps += [(f"umo show why {printable(name)}", "show why its last run failed") for name in failed]
    steps = list(dict.fromkeys(steps))
    if found:
        steps = [*steps[: STEPS - 1], *_running(str(found[0].about["station"]))]
    return [*steps, *_idle(folder, failed)][:STEPS]


def _waiting(name: str, reader: RunReader, frame: Any) -> list[Step]:
    steps: list[Step] = []
    rows: list[AlarmRow] = reader.alarms(frame)
    if rows:
        are = "is" if len(rows) == 1 else "are"
        steps.append((f"umo alarm list {name}", f"{count_of(len(rows), 'alarm')} {are} not normal"))
    if faults := reader.faults(frame):
        steps.append((f"umo do {name} clear", f"end the fault of {', '.join(faults)}"))
    return steps


def _running(name: str) -> list[Step]:
    return [
        (f"umo show values {name}", "show its values, live; `umo show page --open` shows them in a browser"),
        (f"umo do {name}", "show its commands: mode, actions, stop"),
        (f"umo show why {name}", "show why a period was late, and the last faults"),
    ]


def _idle(folder: Path, failed: Sequence[str]) -> list[Step]:
    """Return the steps where nothing runs: for the station that failed last, for a station of this folder, or for one
    that ships with umo."""
    here = [each.name for each in (folder, *sorted(folder.glob("*/"))) if (each / MARK).is_file()]
    if (folder / MARK).is_file():
        here = ["."]
    again = next((name for name in failed if name in {*here, *shipped()}), "")
    name = again or (here[0] if here else "ztheta")
    what = "the station in this folder" if here else "a machine that ships with umo"
    what = "the station whose last run failed" if again else what
    return [
        (f"umo run {name} --realtime", f"run {what} in real time, to watch and operate it"),
        (f"umo check {name}", "find its errors without hardware"),
        ("umo new station my-machine", "create your own station; --copy ztheta copies one that ships with umo"),
    ]

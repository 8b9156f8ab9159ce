"""The commands that read recordings: their arguments and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import HelpPanel

command = HelpPanel("Recordings")

RecordingFile = Annotated[Path, typer.Argument(metavar="FILE.mcap", help="A recording (umo run --record, umo record).")]
From = Annotated[str | None, typer.Option("--from", metavar="TIME", help="From this time on the machine's clock on.")]
To = Annotated[str | None, typer.Option("--to", metavar="TIME", help="Up to this time, such as '90 s' or '5 min'.")]


@command(
    epilog="Examples: umo info run.mcap  |  umo info run.mcap --json",
    status="0 done; 2 it is no recording, told on stderr",
)
def info(file: RecordingFile, as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False) -> int:
    """Say what a recording is: its run, when, how long, what is missing, and whether it can be replayed."""
    from .recordings import info as work

    return work(file, as_json)


@command(
    epilog="Examples: umo export run.mcap run.parquet  |  umo export run.mcap z.csv --only z --from 2 --to '5 s'  |  "
    "umo export run.mcap run.npz --only 'zones.*.temperature'",
    status="0 done; 2 it is no recording, cannot be written, or a mistake, told on stderr; 130 Ctrl-C",
)
def export(
    file: RecordingFile,
    target: Annotated[Path, typer.Argument(metavar="OUT", help="What is written: .parquet, .csv or .npz.")],
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH", help="An object, a signal, a compound or a pattern; may be repeated."),
    ] = None,
    start: From = None,
    stop: To = None,
) -> int:
    """Write a recording as Parquet, CSV or NumPy (.npz), each period.

    Parquet has the table `values` of a fleet's history, a row for each value, so that one query covers both; CSV has a
    row for each period; .npz an array for each object and signal, its quality, and the times.
    """
    from .recordings import WhatIsWanted
    from .recordings import export as work

    return work(file, target, WhatIsWanted(only or (), start, stop))


@command(
    epilog="Examples: umo plot run.mcap  |  umo plot run.mcap z gripper.vacuum --from 2 --to 5 --out z.png",
    status="0 done; 2 it is no recording, cannot be written, or a mistake, told on stderr; 130 Ctrl-C",
)
def plot(
    file: RecordingFile,
    paths: Annotated[
        list[str] | None, typer.Argument(metavar="[PATH]...", help="Objects, signals, compounds or patterns.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Default: beside the recording, by its name.")
    ] = None,
    start: From = None,
    stop: To = None,
) -> int:
    """Draw a recording as a picture, as a run is drawn at its end."""
    from .recordings import WhatIsWanted
    from .recordings import plot as work

    return work(file, WhatIsWanted(paths or (), start, stop), out)

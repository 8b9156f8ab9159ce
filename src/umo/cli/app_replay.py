"""The commands for replays of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import HelpPanel

command = HelpPanel("Recordings")
RecordingArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A recording (.mcap).")]
STATUS = "0 identical; 1 different; 2 the recording cannot be replayed, or a mistake, told on stderr; 130 Ctrl-C"


@command(
    epilog="Examples: umo replay run.mcap  |  umo replay run.mcap my-machine  |  "
    "umo replay run.mcap --set z.servo.gain=0.004",
    status=STATUS,
)
def replay(
    file: RecordingArgument,
    station: Annotated[
        str | None,
        typer.Argument(metavar="[STATION]", help="Another station than that of the recording, such as a copy of it."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Give a number another value than in the recording, and draw what would have been commanded. May be "
            "repeated.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="File of this plot; default: FILE.what-if.png, beside the recording."),
    ] = None,
) -> int:
    """Run the control code of today on the inputs of a recording, and compare what it commands, to the bit.

    No device is opened. Times, missed periods, errors of drivers and the commands of clients are those of the recording
    too. The first difference is told with its period, its object, both values, and where each sequence stood.
    """
    from .replay_run import replay_file

    return replay_file(file, station, settings or (), plot)

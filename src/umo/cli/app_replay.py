"""The commands for replays of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import HelpPanel, finite

command = HelpPanel("Recordings")
RecordingArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A recording (.mcap).")]
STATION_HELP = (
    "The code: the folder or name of a station, or FILE.py:MACHINE:APPLICATION; default: the station that ships with "
    "umo or is installed under the recorded name."
)
Wiring = Annotated[
    str | None,
    typer.Option(metavar="NAME|FILE", help="A wiring of the station, or a file; default: the recorded one."),
]
STATUS = "0 identical; 1 different; 2 the recording cannot be replayed, or a mistake, told on stderr; 130 Ctrl-C"


@command(
    epilog="Examples: umo replay run.mcap  |  umo replay run.mcap my-machine  |  "
    "umo replay run.mcap --set z.servo.gain=0.004  |  umo replay run.mcap --at 12.3s  |  "
    "umo replay run.mcap --break 'abs(z.servo.error) > 50'",
    status=STATUS,
)
def replay(
    file: RecordingArgument,
    station: Annotated[
        str | None,
        typer.Argument(metavar="[STATION]", help=STATION_HELP),
    ] = None,
    wiring: Wiring = None,
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
    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME|PERIOD|first-difference|end",
            help="Stop there in a debugger, such as 12.3s, with the machine as it was.",
        ),
    ] = None,
    condition: Annotated[
        str | None,
        typer.Option(
            "--break", metavar="EXPR", help="Stop there each time that this becomes true: 'z.servo.error > 50'."
        ),
    ] = None,
) -> int:
    """Run the control code of today on the inputs of a recording, and compare what it commands, to the bit.

    No device is opened. Times, missed periods, errors of drivers and the commands of clients are those of the recording
    too. The first difference is told with its period, its object, both values, and where each sequence stood.

    A recording is data: code is only what STATION names, or, without it, the station that ships or is installed under
    the recorded name. Whether it is other code than that of the recorded run is told.

    The debugger is pdb with a few more commands (`help` lists them): it goes to any period, back too.
    """
    from umo.replay.code_given import CodeGiven

    from .replay_run import replay_file

    return replay_file(file, CodeGiven(station, wiring), settings or (), plot, at, condition)


@command(
    epilog="Examples: umo shrink run.mcap  |  umo shrink run.mcap -o test_crash.py --seconds 600  |  "
    "umo shrink run.mcap --closed",
    status="0 done; 2 the recording has no error or difference to shrink to, or a mistake, told on stderr",
)
def shrink(
    file: RecordingArgument,
    station: Annotated[str | None, typer.Argument(metavar="[STATION]", help=STATION_HELP)] = None,
    wiring: Wiring = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.mcap|FILE.py",
            help="A recording, or a test for pytest with a recording beside it; default: FILE.shrunk.mcap.",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=1.0, callback=finite, help="The longest time that it takes, s.")
    ] = 120.0,
    closed: Annotated[
        bool,
        typer.Option(
            "--closed", help="Leave out faults, options and commands instead, and run the station with its plant."
        ),
    ] = False,
) -> int:
    """Find the fewest periods of a recording that still give its error, or the same first difference.

    Periods are left out as inputs: open loop. That proves that the error follows from these inputs, not that a machine
    would give them. `umo replay` of the result compares the error alone. STATION is as in `umo replay`.
    """
    from umo.replay.code_given import CodeGiven

    from .replay_shrink import shrink_file

    return shrink_file(file, CodeGiven(station, wiring), output, seconds, closed)

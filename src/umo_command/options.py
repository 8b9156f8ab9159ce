"""The arguments and options that several commands have in common. Each is declared once, so that it has the same name
everywhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from umo.byte_size import byte_size
from umo.duration import seconds
from umo.errors import DeclarationError

from . import completion


def time_of(text: str | float) -> float:
    """Return a time in s, from a number of seconds or a string such as "5 min". An error is reported with the name of
    the option."""
    is_number = re.fullmatch(r"\s*[-+.\deE]+\s*", str(text))
    try:
        return seconds(float(text) if is_number else text)
    except (DeclarationError, ValueError) as error:
        raise typer.BadParameter(str(error)) from None


def duration_of(text: str | float) -> float:
    """Return a time like `time_of`, but refuse 0."""
    if not (found := time_of(text)):
        raise typer.BadParameter("the time must be more than 0 s")
    return found


def time_option(*names: str, help: str, may_be_0: bool = False) -> Any:
    """Return an option that takes a time. The value of the option is in s."""
    return typer.Option(*names, metavar="TIME", parser=time_of if may_be_0 else duration_of, help=help)


def size_of(text: str | int) -> int:
    """Return a size in bytes from a string such as "20 GB". It must be at least 1 MB."""
    try:
        return byte_size(text, 10**6)
    except DeclarationError as error:
        raise typer.BadParameter(str(error)) from None


def out_option(metavar: str, help: str) -> Any:
    """Return the option for the output file."""
    return typer.Option("--out", "-o", metavar=metavar, help=help)


def running_argument(metavar: str, help: str) -> Any:
    """Return an argument that names a running station."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=completion.running)


StationName = Annotated[
    str,
    typer.Argument(
        metavar="STATION",
        help="Folder of a station, name of a station that ships with umo (ztheta, conveyor, furnace, batch), or name "
        "or pid of a running station.",
        autocompletion=completion.stations_and_running,
    ),
]
OptionalStation = Annotated[
    str | None,
    typer.Argument(
        metavar="STATION",
        help="Folder of a station, or the name of a station that ships with umo (ztheta, conveyor, furnace, batch).",
        autocompletion=completion.stations,
    ),
]
"""The argument STATION of commands that start a station or its plant. They show the options of the station in their
help."""
NO_STATION = (
    "give the folder of a station, or the name of a station that ships with umo: ztheta, conveyor, furnace or batch"
)
Running = Annotated[str, running_argument("STATION", "Name or pid of a station that runs in real time (see `umo`).")]
OneRunning = Annotated[
    str | None, running_argument("[STATION]", "Name or pid of a station; default: the only running station.")
]
WiringName = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Name of a wiring of the station, or a TOML file; default: simulated, or else the first in alphabetical "
        "order.",
        autocompletion=completion.wirings,
    ),
]
RecordedWiring = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Name of a wiring of the station, or a TOML file; default: the recorded wiring.",
        autocompletion=completion.wirings,
    ),
]
RecordingFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE.mcap",
        help="A recording, made by umo run --record or umo recording make.",
        autocompletion=completion.recordings,
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="TEXT",
        help="Inject a fault: PATH KIND \\[amount] \\[at TIME] \\[for TIME], such as 'z.encoder stuck at 5 s'. May be "
        "repeated. Kinds: stuck, noise, drift, bit flip, delay, drop-out, disconnect, exception, wrong length, out of "
        "range.",
    ),
]
FaultSeed = Annotated[
    int | None, typer.Option("--fault-seed", min=0, help="Seed of the random numbers of injected faults; default: 0.")
]
Help = Annotated[bool, typer.Option("--help", "-h", help="Show this message, and the options of the station.")]
"""The option --help of commands that take the options of a station. Their help lists these options."""
MACHINE_OPTIONS = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Settings of commands that take options of a station's machine."""
Acknowledge = Annotated[
    bool, typer.Option("--acknowledge", help="Start even if the last run on a device ended unsafely.")
]
Take = Annotated[bool, typer.Option("--take", help="Take the lease over from another client.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Held = Annotated[
    float | None,
    time_option("--for", may_be_0=True, help="Time for which the value or the action is held; default: until Ctrl-C."),
]
From = Annotated[
    float | None, time_option("--from", may_be_0=True, help="Beginning of the part to use, on the machine's clock.")
]
To = Annotated[
    float | None, time_option("--to", may_be_0=True, help="End of the part to use, such as '90 s' or '5 min'.")
]
MayCommand = Annotated[
    bool | None,
    typer.Option(
        "--commands/--read-only",
        help="Let clients give the commands that their roles allow; default: clients can only read.",
    ),
]
KeepRuns = Annotated[
    int | None,
    typer.Option(
        "--keep-runs",
        metavar="NUMBER",
        min=0,
        help="Keep the newest NUMBER runs of each station in runs/, and remove older runs.",
    ),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address of a router or of another computer, such as tls/plant.local:7447. May be repeated.",
    ),
]
Listen = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address at which other computers reach this one, such as tls/0.0.0.0:7447. May be repeated.",
    ),
]
Certificates = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Folder with ca.pem, certificate.pem and key.pem, made by umo connect certificate."
    ),
]
JetStream = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="JetStream server that stores the published data, such as nats://HOST:4222 or tls://HOST:4222.",
    ),
]

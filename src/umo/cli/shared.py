"""The application `umo`, and what its commands share: help, options, and how a command ends."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from functools import partial, wraps
from typing import Annotated, Any, TypeVar

import typer

from umo.errors import UmoError, text_of
from umo.exit_status import ExitStatus

from .argument_parsing import CommandLine, Subcommand

app = typer.Typer(
    name="umo",
    cls=CommandLine,
    invoke_without_command=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    add_completion=False,
    rich_markup_mode="rich",
    help="Universal Mechatronic Objects: run, check and try out machines.\n\n"
    "Examples:  umo run ztheta  |  umo check my-machine  |  umo new my-machine",
)
F = TypeVar("F", bound=Callable[..., Any])
USUAL_STATUS = "0 done; 1 the machine, a device or code failed; 2 a mistake, told on stderr; 130 Ctrl-C"
"""Exit statuses of most commands (docs/command-line.md)."""


class HelpPanel:
    """A panel of the help. Makes commands in it, whose own help ends with examples and exit statuses, and whose errors
    are told as by `guarded`. A command returns its exit status, or None for 0."""

    def __init__(self, title: str) -> None:
        self._title = title

    def __call__(
        self, name: str | None = None, *, epilog: str, status: str = USUAL_STATUS, **options: Any
    ) -> Callable[[F], F]:
        end = f"{epilog}\n\nExit status: {status}"
        register = app.command(name, cls=Subcommand, epilog=end, rich_help_panel=self._title, **options)

        def command(work: F) -> F:
            register(wraps(work)(lambda **given: guarded(partial(work, **given))))
            return work

        return command


_STATION = typer.Argument(
    metavar="STATION", help="Directory of a station, or the name of a shipped one (ztheta, conveyor, furnace)."
)
StationName = Annotated[str, _STATION]
OptionalStation = Annotated[str | None, _STATION]
"""The station of commands that show its options in their help."""
NO_STATION = "give the directory of a station, or the name of a shipped one"
WiringName = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Name of a wiring of the station, or a TOML file; default: simulated, else the first by name.",
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
BoxWiring = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Modbus wiring that says which object is in which register; default: modbus, or the only one.",
    ),
]
PlantWiring = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE", help="Simulated wiring that has the plant; default: the station's first, simulated."
    ),
]
Help = Annotated[bool, typer.Option("--help", "-h", help="Show this message, and the options of the station.")]
"""The option --help of commands that take the options of a station and name them in their help."""
MACHINE_OPTIONS = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Settings of commands that take the options of the station's machine."""
Acknowledge = Annotated[
    bool, typer.Option("--acknowledge", help="Start even if the last run on a device ended unsafely.")
]
Take = Annotated[bool, typer.Option("--take", help="Take the lease over from whoever has it.")]


def guarded(work: Callable[[], int | None]) -> None:
    """Print any error in one or two lines on stderr and exit. Status 2: a user's mistake. 1 or 3: a device failed.
    1 with file and line: any other exception. 130: Ctrl-C before a machine was started."""
    from umo.process.outcome import message_of, status_of

    from .console import say

    try:
        status = work() or 0
    except (typer.Exit, typer.BadParameter):
        raise
    except UmoError as error:
        say(message_of(error))
        status = status_of(error)
    except (OSError, UnicodeError) as error:  # of files and folders that were named
        say(_about_file(error))
        status = ExitStatus.MISTAKE
    except KeyboardInterrupt:
        status = 128 + signal.SIGINT
    except BaseException as error:  # SystemExit too: whoever ends Python in the middle has not succeeded
        say(text_of(error))
        status = ExitStatus.FAILED
    raise typer.Exit(status)


def _about_file(error: OSError | UnicodeError) -> str:
    name, why = getattr(error, "filename", None), getattr(error, "strerror", None)
    return f"{os.fsdecode(name)}: {why}" if isinstance(name, str | bytes) and why else text_of(error)


def finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number of seconds")
    return value

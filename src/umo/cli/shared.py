"""The application `umo`, and what its commands share: how a line is read, help, options, and how a command ends."""

from __future__ import annotations

import math
import os
import re
import signal
import sys
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command_name

from umo.errors import Interrupted, UmoError, text_of
from umo.exit_status import ExitStatus
from umo.system.processes import HASH_SEED
from umo.system.signal_handling import SIGNALS, signal_name
from umo.text import cut_words, did_you_mean, in_brackets, place_of

from .console import err

F = TypeVar("F", bound=Callable[..., Any])
USUAL_STATUS = "0 done; 1 the machine, a device or code failed; 2 a mistake, told on stderr; 130 Ctrl-C"
"""Exit statuses of most commands (docs/command-line.md)."""
NEGATIVE = re.compile(r"-\.?\d")
"""The beginning of a negative number, with or without a unit. No option begins so."""


class Subcommand(TyperCommand):
    """Takes negative numbers as values: the parser would look for an option `-0`, and for `-h` in "-5 1/h". The value
    of --record may be left out: only FILE.mcap is one."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        args = [
            "--record=" if word == "--record" and not after.endswith(".mcap") else word
            for word, after in zip(args, [*args[1:], ""], strict=False)
        ]
        return list(super().parse_args(ctx, args))

    def make_parser(self, ctx: Any) -> Any:
        parser: Any = super().make_parser(ctx)
        process_option = parser._process_opts

        def process(word: str, state: Any) -> None:
            if NEGATIVE.match(word):
                state.largs.append(word)
            else:
                process_option(word, state)

        parser._process_opts = process
        return parser


class CommandLine(TyperGroup):
    """The command `umo` with its commands; typer would draw a box around a usage error."""

    def main(self, *given: Any, **named: Any) -> Any:
        try:
            status = super().main(*given, **named | {"standalone_mode": False})
        except typer.Abort:
            status = 1
        except Exception as error:
            if not hasattr(error, "format_message"):  # of click, which newer versions of typer hold inside
                raise
            err.print(in_a_line(error), soft_wrap=True)
            status = ExitStatus.MISTAKE
        sys.exit(status or 0)


def in_a_line(error: Any) -> str:
    """`umo view: no such option: --prot (did you mean '--port'?); umo view --help shows what it takes`."""
    context = error.ctx
    where = "umo" if context is None else context.command_path
    text = " ".join(error.format_message().split()).rstrip(".")
    if option := getattr(error, "option_name", "") if text.startswith("No such option") else "":
        text = f"No such option: {option}{did_you_mean(option, options_of_command(context))}"
    text = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1?)", text)
    told = cut_words(text[:1].lower() + text[1:]) + _hint(where, text, context)
    return f"{where}: {told}; `{where} --help` shows what it takes"


def _hint(where: str, text: str, context: Any) -> str:
    """Of an argument that is missing: the current folder if it is a station, and what was taken for the station."""
    from umo.system.packages import MARK

    if "STATION" in text and Path(MARK).is_file():
        return f" (the current folder is one: `{where} .`)"
    if text.startswith("Missing argument 'PATH") and (station := (context.params or {}).get("station")):
        return f" ({station} was taken for the STATION)"
    return ""


def options_of_command(context: Any) -> list[str]:
    """The options of a command by its context, as they are written: `--until`."""
    return [each for parameter in context.command.params for each in parameter.opts if each[:1] == "-"]


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


def keep_only(word: str) -> None:
    """Removes the other commands, if the word is one: typer makes each that is there, 50 ms at each start."""
    commands = [each for each in app.registered_commands if word == (each.name or _name_of(each.callback))]
    groups = [each for each in app.registered_groups if word == each.name]
    if commands or groups:
        app.registered_commands, app.registered_groups = commands, groups


def _name_of(callback: Callable[..., Any] | None) -> str:
    return get_command_name(getattr(callback, "__name__", ""))


class HelpPanel:
    """A panel of the help. Makes commands in it, whose own help ends with examples and exit statuses, and whose errors
    are told as by `guarded`. A command returns its exit status, or None for 0."""

    def __init__(self, title: str, group: typer.Typer = app) -> None:
        """`group`: the command whose subcommands they are."""
        self._title, self._group = title, group

    def __call__(
        self, name: str | None = None, *, epilog: str, status: str = USUAL_STATUS, **options: Any
    ) -> Callable[[F], F]:
        end = f"{epilog}\n\nExit status: {status}"
        register = self._group.command(name, cls=Subcommand, epilog=end, rich_help_panel=self._title, **options)

        def command(work: F) -> F:
            register(wraps(work)(lambda **given: guarded(partial(work, **given))))
            return work

        return command


_STATION = typer.Argument(
    metavar="STATION", help="Directory of a station, or the name of a shipped one (ztheta, conveyor, furnace, batch)."
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
    except KeyboardInterrupt as error:
        is_told = isinstance(error, Interrupted)
        say(text_of(error) if is_told else f"interrupted{in_brackets(place_of(error))}")
        status = 128 + (error.number if isinstance(error, Interrupted) else signal.SIGINT)
    except BaseException as error:  # SystemExit too: whoever ends Python in the middle has not succeeded
        say(text_of(error))
        status = ExitStatus.FAILED
    raise typer.Exit(status)


def _about_file(error: OSError | UnicodeError) -> str:
    name, why = getattr(error, "filename", None), getattr(error, "strerror", None)
    return f"{os.fsdecode(name)}: {why}" if isinstance(name, str | bytes) and why else text_of(error)


def import_from_here() -> None:
    """Modules of the current folder are found, and first."""
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))


def finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number of seconds")
    return value


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """A handler: the first signal raises KeyboardInterrupt as Ctrl-C does, later ones interrupt nothing."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt(signal_name(number))


def begin_again(seed: str) -> None:
    """Begin this command once more with another hash seed, which is read where a process starts. Does nothing
    where `umo` is not a process of its own."""
    if Path(sys.argv[0]).stem in ("umo", "umo_command") and sys.orig_argv[1:2] != ["-c"]:
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], os.environ | {HASH_SEED: seed})

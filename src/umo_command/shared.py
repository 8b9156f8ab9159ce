"""The application `umo`, and the functions that its commands share: reading the command line, help, options, and the
end of a command."""

from __future__ import annotations

import inspect
import math
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import partial, wraps
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup

from umo.errors import Interrupted, UmoError, text_of
from umo.exit_status import ExitStatus
from umo.system.processes import HASH_SEED
from umo.system.signal_handling import SIGNALS, signal_name
from umo.text import cut_words, did_you_mean, in_brackets, place_of
from umo_command.console import err
from umo_command.old_names import current, name_of

F = TypeVar("F", bound=Callable[..., Any])
USUAL_STATUS = (
    "0 done; 1 the machine, a device or code failed; 2 the command line, the wiring or a declaration is "
    "wrong (see stderr); 130 Ctrl-C"
)
"""Exit statuses of most commands (docs/command-line.md)."""
COMMANDS = ("new", "check", "run", "show", "do", "alarm", "recording", "connect", "tune", "device")
"""The commands in the order of the help."""
NEGATIVE = re.compile(r"-\.?\d")
"""The beginning of a negative number, with or without a unit. No option begins like this."""


class Subcommand(TyperCommand):
    """A subcommand that accepts negative numbers as values. Otherwise the parser would take them for options, such as
    `-0`, or `-h` in "-5 1/h". The value of --record may be left out; only a word FILE.mcap counts as its value. The
    helps of options name their defaults, so typer does not add them."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        for each in self.params:
            each.show_default = False  # type: ignore[attr-defined]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        args = [
            "--record=" if word == "--record" and not after.endswith(".mcap") else word
            for word, after in zip(args, [*args[1:], ""], strict=False)
        ]
        try:
            return list(super().parse_args(ctx, args))
        except Exception as error:
            if getattr(error, "ctx", ctx) is None:  # the parser of click leaves it out where a value is missing
                error.ctx = ctx  # type: ignore[attr-defined]
            raise

    def invoke(self, ctx: Any) -> Any:
        before = _running.set(ctx)
        try:
            return super().invoke(ctx)
        finally:
            _running.reset(before)

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

    def main(self, args: Any = None, *given: Any, **named: Any) -> Any:
        words = current(sys.argv[1:] if args is None else list(args), app)
        try:
            status = super().main(words, *given, **named | {"standalone_mode": False})
        except typer.Abort:
            status = 1
        except Exception as error:
            if not hasattr(error, "format_message"):  # of click, which newer versions of typer hold inside
                raise
            err.print(in_a_line(error), soft_wrap=True)
            status = ExitStatus.MISTAKE
        sys.exit(status or 0)

    def list_commands(self, ctx: Any) -> list[str]:
        found = list(super().list_commands(ctx))
        return found if ctx.parent is not None else sorted(found, key=COMMANDS.index)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args and ctx.parent is not None and not ctx.resilient_parsing:  # `umo show`: which of its commands?
            typer.echo(ctx.get_help())
            ctx.exit(ExitStatus.MISTAKE)
        return list(super().parse_args(ctx, args))


def in_a_line(error: Any) -> str:
    """Return a usage error on one line, such as "umo show page: no such option: --prot (did you mean '--port'?); `umo
    show page --help` shows what it takes"."""
    context = error.ctx
    where = "umo" if context is None else context.command_path
    text = plain(" ".join(error.format_message().split()).rstrip("."))
    if option := getattr(error, "option_name", "") if text.startswith("No such option") else "":
        text = f"No such option: {option}{did_you_mean(option, options_of_command(context))}"
    text = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1?)", text)
    told = cut_words(text[:1].lower() + text[1:]) + _hint(where, text, context)
    return f"{where}: {told}; `{where} --help` shows what it takes"


def plain(text: str) -> str:
    """Return a message of click in the words of umo."""
    return text.replace("is not a valid float", "is not a number").replace(
        "is not a valid integer", "is not a whole number"
    )


def _hint(where: str, text: str, context: Any) -> str:
    """Return a hint on a missing argument: the current folder if it is a station, and what was taken for the
    station."""
    from umo.system.packages import MARK

    if "STATION" in text and Path(MARK).is_file():
        return f" (the current folder is one: `{where} .`)"
    if text.startswith("Missing argument 'PATH") and (station := (context.params or {}).get("station")):
        return f" ({station} was taken for the STATION)"
    return ""


def options_of_command(context: Any) -> list[str]:
    """Return the options of a command as the user writes them, such as `--until`, from its context."""
    return [each for parameter in context.command.params for each in parameter.opts if each[:1] == "-"]


_running: ContextVar[Any] = ContextVar("_running", default=None)
"""The context of the command that runs."""


def command_that_runs() -> tuple[str, list[str]]:
    """Return the command that runs, as the user writes it, and its options; nothing if none runs."""
    context = _running.get()
    return ("", []) if context is None else (context.command_path, options_of_command(context))


HELP = {"help_option_names": ["--help", "-h"]}
app = typer.Typer(
    name="umo",
    cls=CommandLine,
    invoke_without_command=True,
    context_settings=HELP,
    rich_markup_mode="rich",
    help="Universal Mechatronic Objects: make, run, see and operate machines.",
    epilog="Examples: umo  |  umo run ztheta  |  umo check my-machine  |  umo new station my-machine\n\n"
    "Exit status: 0 done; the help of each command lists the others; docs/exit-status.md explains them",
)


def keep_only(words: Sequence[str], group: typer.Typer = app) -> None:
    """Remove the commands that the words do not name, because typer needs 50 ms to build each remaining command."""
    word = words[0] if words else ""
    commands = [each for each in group.registered_commands if word == name_of(each)]
    groups = [each for each in group.registered_groups if word == each.name]
    if commands or groups:
        group.registered_commands, group.registered_groups = commands, groups
    for each in groups:
        if each.typer_instance is not None:
            keep_only(words[1:], each.typer_instance)


class HelpPanel:
    """A panel of the help. Calling it returns a decorator that creates a command in this panel. The help of the command
    ends with examples and exit statuses, and its errors are reported as by `guarded`. A command returns its exit
    status, or None for 0."""

    def __init__(self, title: str, group: typer.Typer = app) -> None:
        """`group`: the command whose subcommands they are."""
        self._title, self.group = title, group

    def __call__(
        self, name: str | None = None, *, epilog: str, status: str = USUAL_STATUS, **options: Any
    ) -> Callable[[F], F]:
        end = f"{epilog}\n\nExit status: {status}"
        text = options.pop("help", None)

        def command(work: F) -> F:
            about = paragraphs(text or work.__doc__ or "")
            register = self.group.command(
                name, cls=Subcommand, epilog=end, rich_help_panel=self._title, help=about, **options
            )
            register(wraps(work)(lambda **given: guarded(partial(work, **given))))
            return work

        return command


def paragraphs(text: str) -> str:
    """Return a docstring with one line for each paragraph, because the terminal wraps the lines."""
    return "\n\n".join(" ".join(each.split()) for each in inspect.cleandoc(text).split("\n\n"))


def group(
    name: str, panel: str, text: str, examples: str, parent: typer.Typer = app, cls: type[TyperGroup] = CommandLine
) -> HelpPanel:
    """Create a command with subcommands, in a panel of the help of `parent`. Like a `HelpPanel`, the result creates its
    subcommands."""
    made = typer.Typer(cls=cls, rich_markup_mode="rich", context_settings=HELP)
    end = f"Examples: {examples}\n\nExit status: 0 done; the help of each command lists the others"
    parent.add_typer(made, name=name, help=text, epilog=end, rich_help_panel=panel)
    return HelpPanel("Commands", made)


def guarded(work: Callable[[], int | None]) -> None:
    """Carry out a command and exit with its status. Any error is printed on one or two lines on stderr. The status is
    then 2 for an error of the user, 1 or 3 if a device failed, 1 (with file and line) for any other exception, and 130
    for Ctrl-C before a machine was started."""
    from umo.process.outcome import message_of, status_of
    from umo_command.console import say

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
    """Make Python find modules in the current folder, before all others."""
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))


def finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """Handle a signal: the first one raises KeyboardInterrupt like Ctrl-C; later ones have no effect."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt(signal_name(number))


def begin_again(seed: str) -> None:
    """Restart this command with another hash seed, because Python reads the seed only when a process starts. Do nothing
    if `umo` is not a separate process."""
    program = Path(sys.argv[0])
    if (program.stem == "umo" or program == Path(__file__).with_name("__main__.py")) and sys.orig_argv[1:2] != ["-c"]:
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], os.environ | {HASH_SEED: seed})

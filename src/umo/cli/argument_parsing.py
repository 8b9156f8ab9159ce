"""The command line as umo reads it: a negative number is a value. Usage errors are one line, as all other mistakes are
told: the command, what is wrong, the nearest valid choice."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from umo.exit_status import ExitStatus
from umo.text import did_you_mean

from .console import err

NEGATIVE = re.compile(r"-\.?\d")
"""The beginning of a negative number, with or without a unit. No option begins so."""


class Subcommand(TyperCommand):
    """A command that takes negative numbers as values; the parser would look for an option `-0`, and for `-h` in
    "-5 1/h"."""

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

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        try:
            status = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
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
        known = [each for parameter in context.command.params for each in parameter.opts if each[:1] == "-"]
        text = f"No such option: {option}{did_you_mean(option, known)}"
    text = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1?)", text)
    return f"{where}: {text[:1].lower()}{text[1:]}; `{where} --help` shows what it takes"

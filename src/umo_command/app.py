"""The command `umo`: its commands in the order of the help, and its behaviour without a command."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated

import typer

from umo.system.packages import umo_version

from .old_names import name_of
from .shared import COMMANDS, app

__all__ = ["app"]

for _each in COMMANDS:
    import_module(f"umo_command.{_each}.commands")
import_module("umo_command.connect.certificates")
FIRST_LEVEL = {name_of(each): each for each in app.registered_commands}
"""The commands without subcommands by name, also those that `keep_only` removes."""


def _version(value: bool) -> None:
    if value:
        typer.echo(f"umo {umo_version()}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        from .home import show_home

        show_home()

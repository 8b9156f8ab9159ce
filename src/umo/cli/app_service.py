"""The commands for runs that nobody watches: at boot, and what they leave behind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import MACHINE_OPTIONS, HelpPanel, StationName, WiringName

command = HelpPanel("Stations")


@command(
    epilog="Examples: umo service press -w modbus  |  umo service press -w modbus --as operator -o press.service  |  "
    "umo service press -w modbus --keep '1 GB' --user",
    status="0 the unit is written; 2 a mistake, told on stderr",
    context_settings=MACHINE_OPTIONS,
)
def service(
    context: typer.Context,
    station: StationName,
    wiring: WiringName = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the unit; default: umo- and the station's.")
    ] = None,
    as_: Annotated[
        str | None, typer.Option("--as", metavar="USER", help="User that it runs as; default: who calls this.")
    ] = None,
    user: Annotated[
        bool, typer.Option("--user", help="Write a unit for the user's own manager (systemctl --user).")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", metavar="FILE", help="Write the unit to this file; default: print it.")
    ] = None,
) -> None:
    """Write a systemd unit that runs a station at boot, in the current folder, and say what to do with it.

    The wiring is checked. What follows are options of `umo run`, and those of the station. Where no systemd is, the
    same command line is shown for the foreground.

    The unit restarts a run that has failed with every actuator at its default. It does not restart after status 2, 3 or
    4: a mistake, a machine that stands stopped, an actuator that is not at its default, a record that is not written.
    """
    from .service import write_unit

    write_unit(station, wiring, context.args, name=name, user=as_, own_manager=user, output=output)


@command(epilog="Examples: umo runs  |  umo runs press  |  umo runs press --prune 20")
def runs(
    station: Annotated[str | None, typer.Argument(metavar="[STATION]", help="Name of a station; default: all.")] = None,
    prune: Annotated[
        int | None,
        typer.Option(metavar="NUMBER", min=0, help="Remove all but the newest so many runs of each station."),
    ] = None,
) -> None:
    """List the runs in runs/, with how they ended and their size, or remove the oldest.

    A run that goes on is never removed.
    """
    from .runs import show_runs

    show_runs(station, prune)

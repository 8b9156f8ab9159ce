"""`umo check`: its arguments, and the functions that carry it out."""

from __future__ import annotations

from typing import Annotated

import typer

from umo_command.options import MACHINE_OPTIONS, StationName, WiringName
from umo_command.shared import HelpPanel

command = HelpPanel("Make")


@command(
    epilog="Examples: umo check ztheta  |  umo check ztheta -w modbus  |  umo check ztheta --all  |  "
    "umo check furnace --zones 100  |  umo check furnace --target compile",
    status="0 no error was found; 2 errors were found, or the command line is wrong (see stderr)",
    context_settings=MACHINE_OPTIONS,
)
def check(
    context: typer.Context,
    station: StationName,
    wiring: WiringName = None,
    every: Annotated[bool, typer.Option("--all", help="Check every wiring of the station.")] = False,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="TARGET",
            help="Also list the code that cannot be translated to C for this target. The targets of umo new controller "
            "are host, cortex-m, avr and arduino. The target of a wiring with compile = true is 'compile'.",
        ),
    ] = None,
) -> int:
    """Find the errors in a station without touching hardware.

    The command checks the wiring, the declarations and the code of the machine, for example for sequences that are
    never awaited. Without -w it checks the default wiring, and names the wirings that it did not check. Options of the
    machine follow the station's name.
    """
    from umo_command.check.report import check_station
    from umo_command.station_named import station_named

    return check_station(station_named(station), wiring, every, context.args, target)

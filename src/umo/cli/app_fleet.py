"""The commands of a fleet: their arguments and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import CommandLine, HelpPanel, app, finite

PANEL = "Fleets"
fleet = typer.Typer(cls=CommandLine, rich_markup_mode="rich", context_settings={"help_option_names": ["--help", "-h"]})
app.add_typer(
    fleet,
    name="fleet",
    rich_help_panel="Running stations",
    help="Many stations on many computers, over Zenoh: publish those of this computer, join computers.",
)
command = HelpPanel(PANEL, fleet)

Connect = Annotated[
    list[str] | None,
    typer.Option(metavar="ADDRESS", help="Router, or other computer, such as tls/plant.local:7447; may be repeated."),
]
Listen = Annotated[
    list[str] | None,
    typer.Option(metavar="ADDRESS", help="Address at which others reach this computer, such as tls/0.0.0.0:7447."),
]
Certificates = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="Folder with ca.pem, certificate.pem, key.pem (umo fleet certificate)."),
]
SERVED = "0 ended by Ctrl-C or SIGTERM; 1 the network cannot be reached; 2 a mistake, told on stderr"


@command(
    epilog="Examples: umo fleet serve  |  umo fleet serve --commands  |  "
    "umo fleet serve --site cell7 --connect tls/plant.local:7447 --certificates ~/fleet/cell7",
    status=SERVED,
)
def serve(
    site: Annotated[
        str | None, typer.Option(help="First part of its stations' names; default: the name of this computer.")
    ] = None,
    commands: Annotated[
        bool, typer.Option("--commands", help="Clients may command, as far as their roles allow; default: they read.")
    ] = False,
    rate: Annotated[float, typer.Option(callback=finite, help="Values a second of each station at most.")] = 10.0,
    connect: Connect = None,
    listen: Listen = None,
    certificates: Certificates = None,
) -> int:
    """Publish the stations that run on this computer, also those that start later, until Ctrl-C.

    `umo ps --fleet` lists them, and SITE/STATION is their name for `umo watch`, `umo attach` and the others. Without
    addresses this computer only is reached. The file ~/.config/umo/fleet.toml has the same settings.
    """
    from .serve_fleet import serve_gateway

    changes = {"site": site, "connect": connect, "listen": listen, "certificates": certificates}
    return serve_gateway(changes, commands=commands, rate=rate)


@command(epilog="Examples: umo fleet router --listen tls/0.0.0.0:7447 --certificates ~/fleet/plant", status=SERVED)
def router(connect: Connect = None, listen: Listen = None, certificates: Certificates = None) -> int:
    """Join the computers of a site, until Ctrl-C: stations and their users connect to it.

    It passes on what each may see and say, by the rules of its certificates. Routers connect to each other
    (--connect).
    """
    from .serve_fleet import serve_router

    return serve_router({"connect": connect, "listen": listen, "certificates": certificates})

"""`umo fleet certificate`: its commands and their arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .app_fleet import PANEL, fleet
from .shared import CommandLine, HelpPanel

certificate = typer.Typer(
    cls=CommandLine, rich_markup_mode="rich", context_settings={"help_option_names": ["--help", "-h"]}
)
fleet.add_typer(
    certificate,
    name="certificate",
    rich_help_panel=PANEL,
    help="Who belongs to a fleet: make the certificates of its computers and users, and the rules of who may do what.",
)
command = HelpPanel(PANEL, certificate)
STATUS = "0 done; 2 a mistake, told on stderr"
DEFAULT = Path("~/fleet")

Folder = Annotated[
    Path, typer.Option("--authority", metavar="FOLDER", help="Folder of the authority; default: ~/fleet.")
]
CertificateName = Annotated[str, typer.Argument(metavar="NAME", help="Letters, digits, _ . - (48 at most).")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="HOST", help="Name or address at which others reach it; may be repeated."),
]


@command(epilog="Examples: umo fleet certificate authority  |  umo fleet certificate authority ~/fleet", status=STATUS)
def authority(folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Default: ~/fleet.")] = DEFAULT) -> int:
    """Make the authority of a fleet, once. It is valid for 20 years.

    Whoever has the key in FOLDER/authority can make any certificate: keep it on one computer, and copy it to a safe
    place.
    """
    from .fleet_authority import make_authority

    return make_authority(folder)


@command(epilog="Examples: umo fleet certificate router plant --host plant.local --host 192.168.1.10", status=STATUS)
def router(name: CertificateName, hosts: Hosts = None, folder: Folder = DEFAULT) -> int:
    """Make the certificate of a router, which joins the computers of a site (umo fleet router)."""
    from .fleet_authority import make

    return make(folder, "router", name, hosts or ())


@command(
    epilog="Examples: umo fleet certificate site cell7  |  umo fleet certificate site cell7 --host cell7.local",
    status=STATUS,
)
def site(name: CertificateName, hosts: Hosts = None, folder: Folder = DEFAULT) -> int:
    """Make the certificate of a computer with stations (umo fleet serve): NAME is the first part of their names.

    With --host others may connect to this computer itself, without a router.
    """
    from .fleet_authority import make

    return make(folder, "site", name, hosts or ())


@command(
    epilog="Examples: umo fleet certificate user ann  |  umo fleet certificate user bob --site cell7", status=STATUS
)
def user(
    name: CertificateName,
    sites: Annotated[
        list[str] | None,
        typer.Option(
            "--site", metavar="SITE", help="Only stations of this site are open to them; may be repeated. Default: all."
        ),
    ] = None,
    folder: Folder = DEFAULT,
) -> int:
    """Make the certificate of a person or a program, who sees stations and commands them under this name.

    What they may command is in the file of roles on the computer of the station.
    """
    from .fleet_authority import make

    return make(folder, "user", name, sites=sites or ())


@command(epilog="Examples: umo fleet certificate withdraw ann", status=STATUS)
def withdraw(name: CertificateName, folder: Folder = DEFAULT) -> int:
    """Take a certificate off the rules: nobody accepts it from the next start of the routers on."""
    from .fleet_authority import withdraw_rule

    return withdraw_rule(folder, name)


@command("list", epilog="Examples: umo fleet certificate list", status=STATUS)
def list_(folder: Folder = DEFAULT) -> int:
    """List what was issued: whose it is, until when it is valid, and whether it was withdrawn."""
    from .fleet_authority import list_issued

    return list_issued(folder)

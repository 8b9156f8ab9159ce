"""`umo connect certificate`: its commands and their arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command.connect.commands import command as connect
from umo_command.shared import group

command = group(
    "certificate",
    "Commands",
    "Make the certificates of the computers and users of a fleet, and the rules that say who may do what.",
    "umo connect certificate authority  |  umo connect certificate site cell7  |  umo connect certificate user ann",
    connect.group,
)
STATUS = "0 done; 2 the command line is wrong (see stderr)"
DEFAULT = Path("~/fleet")

Folder = Annotated[Path, typer.Option("--authority", metavar="DIR", help="Folder of the authority; default: ~/fleet.")]
CertificateName = Annotated[
    str, typer.Argument(metavar="NAME", help="Name: at most 48 letters, digits and the characters _ . -")
]
Hosts = Annotated[
    list[str] | None,
    typer.Option(
        "--host", metavar="HOST", help="Name or address at which other computers reach this one. May be repeated."
    ),
]


@command(
    epilog="Examples: umo connect certificate authority  |  umo connect certificate authority ~/second-fleet",
    status=STATUS,
)
def authority(
    folder: Annotated[Path, typer.Argument(metavar="[DIR]", help="Folder of the fleet; default: ~/fleet.")] = DEFAULT,
) -> int:
    """Make the authority of a fleet, which signs its certificates. Do this once; the authority is valid for 20 years.

    Anybody who has the key in DIR/authority can make any certificate. Keep the key on one computer, and a copy in a
    safe place.
    """
    from umo_command.connect.fleet_authority import make_authority

    return make_authority(folder)


@command(
    epilog="Examples: umo connect certificate authority  |  "
    "umo connect certificate router plant --host plant.local --host 192.168.1.10",
    status=STATUS,
)
def router(name: CertificateName, hosts: Hosts = None, folder: Folder = DEFAULT) -> int:
    """Make the certificate of a router, which connects the computers of a site (umo connect router)."""
    from umo_command.connect.fleet_authority import make

    return make(folder, "router", name, hosts or ())


@command(
    epilog="Examples: umo connect certificate authority  |  "
    "umo connect certificate site cell7  |  umo connect certificate site cell8 --host cell8.local",
    status=STATUS,
)
def site(name: CertificateName, hosts: Hosts = None, folder: Folder = DEFAULT) -> int:
    """Make the certificate of a computer with stations (umo connect fleet). NAME is the first part of the names of the
    stations.

    With --host other computers may connect to this computer directly, without a router.
    """
    from umo_command.connect.fleet_authority import make

    return make(folder, "site", name, hosts or ())


@command(
    epilog="Examples: umo connect certificate authority  |  "
    "umo connect certificate user ann  |  umo connect certificate user bob --site cell7",
    status=STATUS,
)
def user(
    name: CertificateName,
    sites: Annotated[
        list[str] | None,
        typer.Option(
            "--site", metavar="SITE", help="Site whose stations the user may see; default: all sites. May be repeated."
        ),
    ] = None,
    folder: Folder = DEFAULT,
) -> int:
    """Make the certificate of a user: a person or a program that sees and commands stations under this name.

    The file roles.toml on the station's computer says which commands the user may give.
    """
    from umo_command.connect.fleet_authority import make

    return make(folder, "user", name, sites=sites or ())


@command(epilog="Examples: umo connect certificate user ann  |  umo connect certificate withdraw ann", status=STATUS)
def withdraw(name: CertificateName, folder: Folder = DEFAULT) -> int:
    """Withdraw a certificate. A router refuses it from its next start on."""
    from umo_command.connect.fleet_authority import withdraw_rule

    return withdraw_rule(folder, name)


@command("list", epilog="Examples: umo connect certificate list", status=STATUS)
def list_(folder: Folder = DEFAULT) -> int:
    """List the certificates with their owner and end of validity, and show which are withdrawn."""
    from umo_command.connect.fleet_authority import list_issued

    return list_issued(folder)

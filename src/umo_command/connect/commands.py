"""`umo connect`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import Certificates, Connect, JetStream, Listen, MayCommand
from umo_command.shared import finite, group

command = group(
    "connect",
    "Connect",
    "Connect stations with other systems and computers: OPC UA, EPICS, MQTT, Prometheus, and fleets of umo over Zenoh.",
    "umo connect face opcua  |  umo connect fleet  |  umo connect certificate site cell7",
)


SERVED = "0 ended by Ctrl-C or SIGTERM; 1 the network cannot be reached; 2 the command line is wrong (see stderr)"


@command(
    epilog="Examples: umo connect face prometheus  |  umo connect face opcua epics --station ztheta --commands  |  "
    "umo connect face prometheus --set prometheus.port=9465",
    status="0 ended by Ctrl-C or SIGTERM; 1 a port or a file is not available; 2 the command line or the wiring is "
    "wrong (see stderr)",
)
def face(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FACE]...",
            help="epics, homeassistant, opcua, prometheus, sparkplug, or your own face as module:Class; default: the "
            "faces in the table `faces` of the wiring.",
            autocompletion=completion.faces,
        ),
    ] = None,
    station: Annotated[
        str | None,
        typer.Option(
            metavar="STATION",
            help="Name, folder or pid of the station; required if several run. The station may start later.",
            autocompletion=completion.running,
        ),
    ] = None,
    commands: MayCommand = None,
    rate: Annotated[
        float | None, typer.Option(callback=finite, help="Number of readings of the machine per second; default: 10.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="FACE.NAME=VALUE",
            help="Set an option of a face; the face's page in docs/ lists its options. May be repeated.",
        ),
    ] = None,
) -> int:
    """Serve a running station to clients of other protocols, until Ctrl-C.

    A face does not disturb the station. When the station ends, every value becomes stale; when the station starts
    again, the face continues. Without --commands clients can only read.
    """
    from umo_command.connect.faces import FaceOptions, serve

    return serve(FaceOptions(names or [], station, commands, rate, settings or []))


@command(
    epilog="Examples: umo connect fleet  |  umo connect fleet --commands  |  "
    "umo connect fleet --site cell7 --connect tls/plant.local:7447 --certificates ~/fleet/cell7",
    status=SERVED,
)
def fleet(
    site: Annotated[
        str | None,
        typer.Option(
            metavar="SITE", help="First part of the names of the stations; default: the name of this computer."
        ),
    ] = None,
    commands: MayCommand = None,
    rate: Annotated[
        float, typer.Option(callback=finite, help="Largest number of values per second of each station; default: 10.")
    ] = 10.0,
    connect: Connect = None,
    listen: Listen = None,
    certificates: Certificates = None,
    jetstream: JetStream = None,
) -> int:
    """Publish the stations of this computer, also stations that start later, until Ctrl-C.

    `umo show stations --fleet` lists the stations. For `umo show values`, `umo.attach` and other commands, write the
    name of a station as SITE/STATION. If neither --connect nor --listen is given, only this computer can reach the
    stations. These options can also be set in the file ~/.config/umo/fleet.toml.
    """
    from umo_command.connect.fleet import serve_gateway

    changes = {"site": site, "connect": connect, "listen": listen, "certificates": certificates}
    return serve_gateway(changes, commands=bool(commands), rate=rate, jetstream=jetstream)


@command(epilog="Examples: umo connect router --listen tls/0.0.0.0:7447 --certificates ~/fleet/plant", status=SERVED)
def router(connect: Connect = None, listen: Listen = None, certificates: Certificates = None) -> int:
    """Run a router, which connects the computers of a site, until Ctrl-C. Stations and users connect to the router.

    The rules of the certificates say what each computer and user may see and publish; the router forwards nothing else.
    Routers connect to each other with --connect.
    """
    from umo_command.connect.fleet import serve_router

    return serve_router({"connect": connect, "listen": listen, "certificates": certificates})

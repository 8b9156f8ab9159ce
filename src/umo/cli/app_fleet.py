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
    help="Many stations on many computers, over Zenoh: publish those of this computer, join computers, keep a history.",
    epilog='Examples: umo fleet serve  |  umo fleet record  |  umo fleet query "FROM gaps"\n\n'
    "Exit status: 0 ended; the help of each command has the others",
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
JetStream = Annotated[
    str | None,
    typer.Option(metavar="URL", help="JetStream that keeps what is published, as nats://HOST:4222 or tls://HOST:4222."),
]
HistoryFolder = Annotated[
    Path, typer.Argument(metavar="[FOLDER]", help="Folder of the history; default: fleet-history.")
]
HISTORY = Path("fleet-history")
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
    jetstream: JetStream = None,
) -> int:
    """Publish the stations that run on this computer, also those that start later, until Ctrl-C.

    `umo ps --fleet` lists them, and SITE/STATION is their name for `umo watch`, `umo.attach` and the others. Without
    addresses this computer only is reached. The file ~/.config/umo/fleet.toml has the same settings.
    """
    from .serve_fleet import serve_gateway

    changes = {"site": site, "connect": connect, "listen": listen, "certificates": certificates}
    return serve_gateway(changes, commands=commands, rate=rate, jetstream=jetstream)


@command(epilog="Examples: umo fleet router --listen tls/0.0.0.0:7447 --certificates ~/fleet/plant", status=SERVED)
def router(connect: Connect = None, listen: Listen = None, certificates: Certificates = None) -> int:
    """Join the computers of a site, until Ctrl-C: stations and their users connect to it.

    It passes on what each may see and say, by the rules of its certificates. Routers connect to each other
    (--connect).
    """
    from .serve_fleet import serve_router

    return serve_router({"connect": connect, "listen": listen, "certificates": certificates})


@command(
    epilog="Examples: umo fleet record  |  umo fleet record /srv/history --stations 'cell7/*' --keep 30d  |  "
    "umo fleet record --connect tls/plant.local:7447 --certificates ~/fleet/history",
    status=SERVED,
)
def record(
    folder: HistoryFolder = HISTORY,
    stations: Annotated[
        list[str] | None,
        typer.Option(metavar="SITE/STATION", help="Those that are recorded, as 'cell7/*'; may be repeated; all."),
    ] = None,
    keep: Annotated[
        str | None, typer.Option(metavar="TIME", help="Remove what is older, as 30d or '12 h'; default: keep it.")
    ] = None,
    connect: Connect = None,
    certificates: Certificates = None,
    jetstream: JetStream = None,
) -> int:
    """Write the values and events of all stations to Parquet files, by station and hour, until Ctrl-C.

    `umo fleet query` asks them, and every program that reads Parquet can. What did not come is in them as a gap with
    its count. A recorder that is begun again goes on where it was. With --jetstream it reads what gateways have put
    there (umo fleet serve --jetstream), also what it missed while it was away for long.
    """
    from .record_fleet import record_history

    changes = {"connect": connect, "certificates": certificates}
    return record_history(folder, changes, stations or ["*/*"], keep, jetstream)


@command(
    epilog='Examples: umo fleet query "SELECT station, path, avg(value) FROM values WHERE time > now() - INTERVAL 1 '
    "HOUR GROUP BY ALL\"  |  umo fleet query \"SELECT * FROM events WHERE asked = 'fault' AND time::DATE = "
    '\'2026-11-25\'"  |  umo fleet query "FROM gaps" /srv/history --csv gaps.csv',
)
def query(
    sql: Annotated[str, typer.Argument(metavar="SQL", help="One SELECT, in the SQL of DuckDB.")],
    folder: HistoryFolder = HISTORY,
    last: Annotated[
        str | None, typer.Option(metavar="TIME", help="Read the files of the last 2h, or so; default: all.")
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Rows of the table at most.")] = 100,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write all rows to a file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all rows as JSON.")] = False,
) -> int:
    """Ask the history of a fleet in SQL.

    Views: values (site, station, time, time_error, run, number, delta, path, value, state, quality), events (site,
    station, time, run, number, path, text, who, asked, state, command), gaps (site, station, time, run, of, first,
    last, count, why), objects (site, station, run, started, wiring, path, kind, unit, minimum, maximum, states). Times
    are UTC.
    """
    from .record_fleet import query_history

    return query_history(folder, sql, last=last, rows=rows, csv=csv, as_json=as_json)

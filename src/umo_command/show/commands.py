"""`umo show`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo.errors import OptionError
from umo_command import completion
from umo_command.options import (
    MACHINE_OPTIONS,
    Json,
    StationName,
    WiringName,
    out_option,
    running_argument,
    time_option,
)
from umo_command.shared import group

command = group(
    "show",
    "See",
    "Show what runs and how it is doing: values, a page in the browser, causes, parts.",
    "umo show values ztheta  |  umo show page --open  |  umo show why ztheta",
)

PartPath = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[PATH]", help="An object or a list of the machine, such as z.", autocompletion=completion.paths
    ),
]


@command(epilog="Examples: umo show stations  |  umo show stations --json  |  umo show stations --fleet")
def stations(
    as_json: Json = False,
    fleet: Annotated[
        bool, typer.Option("--fleet", help="List the stations of the fleet, on all computers (see umo connect fleet).")
    ] = False,
) -> None:
    """List the stations that run in real time, and the devices whose last run ended unsafely."""
    if fleet:
        from umo_command.show.fleet_stations import ps_fleet

        ps_fleet(as_json)
        return
    from umo_command.show.stations import show_stations

    show_stations(as_json)


@command(
    epilog="Examples: umo show values  |  umo show values z gripper.vacuum  |  "
    "umo show values '*.encoder' --once  |  umo show values ztheta z.encoder --for 10"
)
def values(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[STATION] [PATH]...",
            help="Name or pid of a station (see `umo`), required if several run; then paths of objects or compounds, "
            "or patterns such as 'zones.*.temperature'.",
            autocompletion=completion.running_and_paths,
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Show the current values once, then exit.")] = False,
    lasting: Annotated[float | None, time_option("--for", help="Exit after this time.")] = None,
) -> None:
    """Show the values, traces and missed periods of a running station, live. This does not disturb the station.

    Similar objects of a list are folded into one line. Keys in a terminal: arrows, page up, page down, home and end
    move the cursor; enter folds or unfolds a line; 'a' folds or unfolds all lines; 'q' quits. If the output is not a
    terminal, or with --once, every object is shown once.

    For the examples, start `umo run ztheta --manual` in another terminal.
    """
    from umo_command.show.values_live import watch as show

    show(words or [], once, lasting)


@command(
    epilog="Examples: umo show page  |  umo show page ztheta --open  |  umo show page --port 8300  |  "
    "umo run ztheta --record run.mcap  |  umo show page run.mcap  |  umo show page --fleet  |  "
    "UMO_TOKEN=SECRET-TEXT umo show page --host 0.0.0.0 --certificate cell.pem --key cell.key",
    status="0 ended by Ctrl-C; 2 the command line is wrong (see stderr)",
)
def page(
    station: Annotated[
        str | None,
        typer.Argument(
            metavar="[STATION|FILE.mcap]",
            help="Name, folder or pid of the station to show first, which may start later; or SITE/STATION of a "
            "fleet; or a recording.",
            autocompletion=completion.running_and_recordings,
        ),
    ] = None,
    second: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE2.mcap]",
            help="A second recording, drawn over the first.",
            autocompletion=completion.recordings,
        ),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port; default: 8270, or any free port if 8270 is taken.")
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    host: Annotated[
        str,
        typer.Option(
            metavar="HOST",
            help="Address to listen at; default: 127.0.0.1. Any address other than loopback needs --token.",
        ),
    ] = "127.0.0.1",
    operate: Annotated[
        bool,
        typer.Option(
            "--operate", help="Let other computers also operate machines; default: other computers can only watch."
        ),
    ] = False,
    token: Annotated[
        str | None,
        typer.Option(
            "--token",
            "--password",
            envvar="UMO_TOKEN",
            help="Token that a browser must give, at least 8 characters; default: a random token. Other users of this "
            "computer can see --token in the list of processes; the environment variable UMO_TOKEN is hidden from "
            "them.",
        ),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE.pem", help="Certificate for TLS (https); needs --key.")
    ] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE.key", help="Private key of the certificate.")] = None,
    proxy: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address at which a reverse proxy serves the page, such as https://cell.example. All visitors then "
            "need the token, and none has the rights of the user who runs this command.",
        ),
    ] = None,
    fleet: Annotated[
        bool, typer.Option("--fleet", help="Also show the stations of other computers (see umo connect fleet).")
    ] = False,
    code: Annotated[
        str | None,
        typer.Option(
            "--station",
            metavar="STATION",
            help="For a recording: folder or name of the station whose twin is drawn; default: the shipped or "
            "installed station with the recorded name.",
        ),
    ] = None,
) -> None:
    """Show running stations in a browser, and print the address of the page, which contains a token.

    The page has the tabs Scope, Machine, Twin and Operate. A separate process serves it and does not disturb the
    station. Ctrl-C ends the page; the stations continue.

    By default the page listens on loopback and can command machines. Every address needs the token. With another
    address (--host) or a proxy (--proxy) you must give a token, and the page is read-only without --operate. Give a
    certificate too: otherwise the token can be read on the network. With the printed token, your programs on this
    computer may do everything. With a token that you gave, a visitor has the role of the page in roles.toml
    (docs/security.md).

    A recording is shown with a slider for its time and marks for its events. It takes no commands. Two recordings are
    aligned at their beginnings; the objects of the second are in the part "second".
    """
    from umo_command.show.page import ViewOptions
    from umo_command.show.page import view as show

    show(ViewOptions(station, host, port, token, open_, operate, certificate, key, proxy, fleet, second, code))


@command(
    epilog="Examples: umo show why  |  umo show why ztheta  |  umo show why ztheta --now  |  "
    "umo show why ztheta z.motor"
)
def why(
    station: Annotated[str | None, running_argument("[STATION]", "Name of a station; default: all stations.")] = None,
    path: Annotated[
        str | None,
        typer.Argument(
            metavar="[PATH]",
            help="An actuator of a running station: who drives it, and why.",
            autocompletion=completion.paths,
        ),
    ] = None,
    now: Annotated[bool, typer.Option("--now", help="Write a black box of the running station, and show it.")] = False,
    file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Read this black box, or the black boxes in this recording."),
    ] = None,
) -> None:
    """Show why the last run ended, and why periods were missed: how long each phase took, and the cause.

    The last run is the newest one in runs/; without runs/ it is that of the newest black box. The times come from the
    newest black box of the run, which is written when a period is missed or a run in real time fails. The last faults
    of equipment are also shown. A named station that runs is shown as with `--now` if equipment is in fault, or if the
    run has no black box yet. If you give the path of an actuator, the command shows its claim: who drives the
    actuator, and why. It also shows which value the actuator gets when this claim ends.

    For the examples, start `umo run ztheta --manual` in another terminal.
    """
    option = "--now" if now else "" if file is None else "--file"
    if option and path is not None:
        raise OptionError(f"{option} is about missed periods, {path} is an actuator: give one of the two")
    if now and file is not None:
        raise OptionError("--now writes a black box, --file reads one: give one of the two")
    if file is not None and station is not None:
        raise OptionError(f"--file: {file} names its station itself: leave {station} out")
    if station is not None and path is not None:
        from umo_command.show.claimed import show_claim

        show_claim(station, path)
    else:
        from umo_command.show.why import why as say_why

        say_why(station, now, file)


@command(
    epilog="Examples: umo show parts ztheta  |  umo show parts ztheta z -w second_generation  |  "
    "umo show parts furnace --zones 3 --all",
    context_settings={"ignore_unknown_options": True},
)
def parts(
    station: StationName,
    words: PartPath = None,
    wiring: WiringName = None,
    everything: Annotated[bool, typer.Option("--all", help="Show every member of a list.")] = False,
) -> int:
    """Show the hierarchy of objects with units, ranges and wiring (the paper's Figure 4).

    If a list has three or more similar members, only the parts of the first member are shown, with the wires of the
    first and of the last member. Different members are shown separately. Options of the machine follow the station's
    name.
    """
    from umo_command.show.part_tree import show_tree
    from umo_command.station_named import station_named

    return show_tree(station_named(station), wiring, words or [], everything)


@command(
    epilog="Examples: umo show period conveyor  |  umo show period ztheta -w second_generation",
    context_settings=MACHINE_OPTIONS,
)
def period(context: typer.Context, station: StationName, wiring: WiringName = None) -> int:
    """Show the phases of a machine's period, and the parts that act in each.

    Options of the machine follow the station's name.
    """
    from umo_command.show.period_table import show_period
    from umo_command.station_named import station_named

    return show_period(station_named(station), wiring, context.args)


@command(epilog="Examples: umo show latency  |  umo show latency --period 500us --for '1 min' --load")
def latency(
    period: Annotated[float, time_option(help="Sampling period, such as 500us; default: 1 ms.")] = 0.001,
    lasting: Annotated[
        float, time_option("--for", help="Measuring time of each of the two loops; default: 10 s.")
    ] = 10.0,
    load: Annotated[bool, typer.Option("--load", help="Load every core during the measurement.")] = False,
    out: Annotated[Path | None, out_option("FILE.json", "Write the results to this file.")] = None,
) -> None:
    """Measure whether this computer can keep a sampling period, with umo's loop and a bare loop in C.

    The answer is "yes" if no period was missed, and the longest sum of wake-up delay and work is less than half of the
    period. It is "with care" if at most one period in a thousand was missed, and the sum is less than the period in
    99.9 % of the periods. Otherwise it is "no". The result is valid for the measured time and load only.
    """
    from umo_command.show.latency import latency as answer

    answer(period, lasting, load, out)

"""The commands for stations that run: their arguments and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo.errors import OptionError

from .shared import HelpPanel, Take, WiringName, finite

command = HelpPanel("Running stations")

Running = Annotated[
    str, typer.Argument(metavar="STATION", help="Name or pid of a station that runs in real time (see `umo ps`).")
]


@command(epilog="Examples: umo ps  |  umo ps --json  |  umo ps --fleet")
def ps(
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
    fleet: Annotated[
        bool, typer.Option("--fleet", help="Those of the fleet, on all computers (see umo fleet --help).")
    ] = False,
) -> None:
    """List the stations that run in real time, and the devices whose last run ended unsafely."""
    if fleet:
        from .ps_fleet import ps_fleet

        ps_fleet(as_json)
        return
    from .ps import ps as show

    show(as_json)


@command(
    epilog="Examples: umo watch  |  umo watch z gripper.vacuum  |  umo watch 'zones.*.temperature'  |  "
    "umo watch ztheta z.encoder --seconds 10"
)
def watch(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[STATION] [PATH]...",
            help="Station name or pid (see `umo ps`), required if several run; paths of objects or compounds, or "
            "patterns such as 'zones.*.temperature'.",
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Show the current values once, then exit.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.0, callback=finite, help="Exit after this time in s.")] = None,
) -> None:
    """Watch a running station: values, traces, missed periods. Watching does not disturb the station.

    Like objects of lists are folded into one line. In a terminal: arrows, page up and down, home and end move; enter
    folds and unfolds; a: all; q quits. Without a terminal, or with --once, every object is shown once.
    """
    from .watch import watch as show

    show(words or [], once, seconds)


@command(
    epilog="Examples: umo face prometheus  |  umo face opcua epics --station ztheta --commands  |  "
    "umo face prometheus --option prometheus.port=9465",
    status="0 ended by Ctrl-C or SIGTERM; 1 a port or a file cannot be had; 2 a mistake, told on stderr",
)
def face(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FACE]...",
            help="epics, homeassistant, opcua, prometheus, sparkplug, or a face of your own as module:Class; default: "
            "those of the table `faces` of the wiring.",
        ),
    ] = None,
    station: Annotated[
        str | None, typer.Option(help="Name, folder or pid; required if several run. It may start later.")
    ] = None,
    commands: Annotated[
        bool | None,
        typer.Option("--commands/--read-only", help="Whether clients may command; default: they only read."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(callback=finite, help="Looks at the machine a second; default: 10.")
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FACE.NAME=VALUE", help="An option of a face, as its page in docs/ lists them; may be repeated."
        ),
    ] = None,
) -> int:
    """Serve a running station to clients of other protocols, until Ctrl-C.

    A face reads the frames of the station, as `umo view` does, and disturbs nothing. When the station ends every value
    becomes stale; when it starts again the face goes on. Without --commands clients only read.
    """
    from .serve_faces import FaceOptions, serve

    return serve(FaceOptions(names or [], station, commands, rate, option or []))


@command(
    epilog="Examples: umo view  |  umo view ztheta --open  |  umo view --port 8300  |  "
    "umo view run.mcap  |  umo view today.mcap yesterday.mcap  |  "
    "umo view --fleet  |  umo view --host 0.0.0.0 --certificate cell.pem --key cell.key",
    status="0 ended by Ctrl-C; 2 a mistake, told on stderr",
)
def view(
    station: Annotated[
        str | None,
        typer.Argument(
            metavar="[STATION|FILE.mcap]",
            help="Name, directory or pid of the station to show first, which may start later; SITE/STATION of a fleet; "
            "or a recording.",
        ),
    ] = None,
    second: Annotated[
        Path | None, typer.Argument(metavar="[FILE2.mcap]", help="Another recording, laid over the first one.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port; default: 8270, or any free one if it is taken.")
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen at. Any other than this computer's own loopback needs a token.")
    ] = "127.0.0.1",
    operate: Annotated[
        bool, typer.Option("--operate", help="Let other computers operate machines, not only see them.")
    ] = False,
    token: Annotated[
        str | None,
        typer.Option(
            "--token",
            "--password",
            envvar="UMO_TOKEN",
            help="What a browser must give, at least 8 characters; default: "
            "a random token. Other users see --token in the list of processes, but not the variable.",
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
            help="Address at which a reverse proxy serves the page, as https://cell.example: nobody is this user then.",
        ),
    ] = None,
    fleet: Annotated[
        bool, typer.Option("--fleet", help="With the stations of all computers (see umo fleet --help).")
    ] = False,
    code: Annotated[
        str | None,
        typer.Option(
            "--station",
            metavar="STATION",
            help="Of a recording: the station, by folder or name, whose twin is drawn; default: the one that ships or "
            "is installed under the recorded name.",
        ),
    ] = None,
) -> None:
    """Show running stations in a browser: scope, machine, twin, operate. Prints the address, which carries a token.

    The page is served by a process of its own, which reads the frames: it does not disturb the station. It listens
    on loopback, where pages may command (tab Operate), and needs the token everywhere. At another address (--host), and
    through a proxy (--proxy), a token must be given, and the page is read-only unless --operate is given; give a
    certificate there, or the token can be read on the network. Who comes with the printed token, from a program of
    yours on this computer, may do everything; who comes with the one that was given, what roles.toml gives to the page
    (docs/security.md). Ctrl-C ends it; the stations go on.

    A recording has a slider for its time, with what happened on it; nothing is commanded. Of two, the second begins
    where the first does: its objects are those of the part "second".
    """
    from .page import ViewOptions
    from .page import view as show

    show(ViewOptions(station, host, port, token, open_, operate, certificate, key, proxy, fleet, second, code))


@command(epilog="Examples: umo mode ztheta  |  umo mode ztheta manual  |  umo mode ztheta automatic --take")
def mode(
    station: Running,
    wanted: Annotated[str | None, typer.Argument(metavar="[automatic|manual]", help="The new mode.")] = None,
    take: Take = False,
) -> None:
    """Show the mode of a running station and who has its lease, or change the mode.

    automatic: the application runs; numbers can be tuned. manual: the application waits, and no time passes for it;
    what it drives stops or is held, as declared; control laws go on; actuators can be set and actions called. What a
    client has begun ends when the mode changes. Back to automatic is refused if the application cannot go on.
    """
    from .commanding import mode as work

    work(station, wanted, take)


@command(
    epilog="Examples: umo call ztheta  |  umo call ztheta home  |  umo call ztheta z.move_to 'position=100 mm'  |  "
    "umo call ztheta z.jog velocity=-5000 --hold 2",
    status="0 done; 1 the machine, a device or code failed; 2 a mistake, or it is held no longer, told on stderr; "
    "130 Ctrl-C, but 0 where it is held until Ctrl-C",
)
def call(
    station: Running,
    action: Annotated[str | None, typer.Argument(metavar="[ACTION]", help="Such as z.move_to.")] = None,
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME=VALUE]...", help="Numbers may have a unit.")
    ] = None,
    hold: Annotated[
        float | None,
        typer.Option(min=0.0, callback=finite, help="Of a jog: how long it is held in s; default: until Ctrl-C."),
    ] = None,
    take: Take = False,
) -> int:
    """Call an action of a running station and wait for its end; without an action, list them.

    Ctrl-C cancels the action.
    """
    from .commanding import call as work

    return work(station, action, arguments or [], take, hold)


@command(epilog="Examples: umo tune ztheta  |  umo tune ztheta z.servo.gain  |  umo tune ztheta z.servo.gain 0.004")
def tune(
    station: Running,
    path: Annotated[str | None, typer.Argument(metavar="[PATH]", help="Such as z.servo.gain.")] = None,
    value: Annotated[str | None, typer.Argument(metavar="[VALUE]", help="A number, or one with a unit.")] = None,
    take: Take = False,
    save: Annotated[
        bool, typer.Option("--save", help="Print the lines of the wiring that keep what was tuned in this run.")
    ] = False,
) -> None:
    """Change a tunable number of a running station, show it, or list them all.

    --save prints what was tuned since the start, by whomever, as [parameters] for the wiring file. Numbers that are
    declared kept need no line there.
    """
    from .commanding import tune as work

    work(station, path, value, take, save)


@command(
    epilog="Examples: umo kept press  |  umo kept press -w modbus  |  umo kept press --forget count",
    status="0 done; 2 a mistake, nothing is kept, or a run keeps it, told on stderr",
)
def kept(
    station: Annotated[str, typer.Argument(metavar="STATION", help="Name or folder of a station; it need not run.")],
    wiring: WiringName = None,
    forget: Annotated[
        str | None, typer.Option(metavar="PATH", help="Forget the kept value of this number: it has its default again.")
    ] = None,
) -> None:
    """List the values that are kept over the end of a station's runs in real time, with their file and age.

    The next run takes over what is declared kept=True. `umo run STATION --fresh` starts without them all.
    """
    from .kept import kept as work

    work(station, wiring, forget)


@command(epilog="Examples: umo acknowledge conveyor  |  umo acknowledge conveyor sorter.belt sorter.diverter")
def acknowledge(
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION", help="Name or pid of a station that runs, or what stands stopped (see `umo ps`)."
        ),
    ],
    paths: Annotated[
        list[str] | None,
        typer.Argument(metavar="[PATH]...", help="Such as belt, or patterns such as 'zones.*.heater'; default: all."),
    ] = None,
    take: Take = False,
) -> None:
    """Acknowledge the latched interlocks of a running station, or of some of its objects, in any mode.

    What they inhibit is free again: the program may write it in the next period. Refused while the condition of one
    still holds.

    Of a station that does not run, the unsafe end of its last run is acknowledged: by the name of the station, or of
    the device. Inspect the machine first: the next run starts without --acknowledge.
    """
    from .clearing import acknowledge as work

    work(station, paths or [], take)


@command(epilog="Examples: umo clear batch  |  umo clear batch reactors.1  |  umo clear batch line 'reactors.*'")
def clear(
    station: Running,
    paths: Annotated[
        list[str] | None,
        typer.Argument(metavar="[PATH]...", help="Such as reactors.1, or patterns such as 'reactors.*'; default: all."),
    ] = None,
    take: Take = False,
) -> None:
    """Clear the faults of a running station: of the equipment at these paths or around them, or of all, in any mode.

    What had failed is initialised again, and the application can go on with it. An axis that has lost its reference
    must be homed. `umo ps` says what is in fault, and why. Refused while a sensor of the equipment cannot be read.
    """
    from .clearing import clear as work

    work(station, paths or [], take)


@command(
    epilog="Examples: umo alarms  |  umo alarms plant  |  umo alarms plant --acknowledge tank.overfill  |  "
    "umo alarms plant --acknowledge 'tanks.*'  |  umo alarms plant --shelve tank.cold --for '10 min'"
)
def alarms(
    station: Annotated[
        str | None, typer.Argument(metavar="[STATION]", help="Name or pid; default: the only one that runs.")
    ] = None,
    acknowledge: Annotated[str | None, typer.Option(metavar="PATH", help="Acknowledge these alarms.")] = None,
    reset: Annotated[
        str | None, typer.Option(metavar="PATH", help="Reset latched alarms that are acknowledged and not active.")
    ] = None,
    shelve: Annotated[str | None, typer.Option(metavar="PATH", help="Put alarms away for a time; needs --for.")] = None,
    lasting: Annotated[
        str | None, typer.Option("--for", metavar="TIME", help="How long, such as '10 min'; at most 7 days.")
    ] = None,
    unshelve: Annotated[str | None, typer.Option(metavar="PATH", help="End a shelf before its time.")] = None,
    remove: Annotated[
        str | None, typer.Option(metavar="PATH", help="Put alarms out of service, until they are returned.")
    ] = None,
    return_: Annotated[str | None, typer.Option("--return", metavar="PATH", help="Return alarms to service.")] = None,
    history: Annotated[
        bool, typer.Option("--history", help="The changes that are kept over restarts, of a station that ended too.")
    ] = False,
    raised: Annotated[
        bool, typer.Option("--raised", help="List those too that are normal now and were raised in this run.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="List as JSON.")] = False,
    take: Take = False,
) -> None:
    """List the alarms of a running station that are not normal, or acknowledge, reset or shelve some, in any mode.

    What is to be acknowledged stands first, then what is of a higher priority. PATH is an alarm (tank.overfill), an
    object or compound for all alarms in it, or a pattern such as 'tanks.*.overfill'.
    """
    from .alarms import AlarmOptions, Listing
    from .alarms import alarms_or_history as work

    options = AlarmOptions(acknowledge, reset, shelve, unshelve, remove, return_)
    work(station, options, lasting, Listing(as_json, raised), take, history)


@command(epilog="Examples: umo stop ztheta  |  umo stop 4711")
def stop(station: Running) -> None:
    """End a run safely: every actuator goes to its default. It needs no lease."""
    from .commanding import stop as work

    work(station)


@command(
    epilog="Examples: umo why  |  umo why ztheta  |  umo why ztheta --now  |  umo why --file kept.box  |  "
    "umo why conveyor sorter.diverter"
)
def why(
    station: Annotated[
        str | None, typer.Argument(metavar="[STATION]", help="Name of a station; default: all stations.")
    ] = None,
    path: Annotated[
        str | None, typer.Argument(metavar="[PATH]", help="An actuator of a running station: who drives it, and why.")
    ] = None,
    now: Annotated[bool, typer.Option("--now", help="First write a black box of the running station.")] = False,
    file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Read this black box, or those of a recording."),
    ] = None,
) -> None:
    """Show why periods were missed: the newest black box, the duration of each phase, and the cause.

    It tells the last faults of equipment too. With the path of an actuator: who drives it, why, and what comes next.
    """
    option = "--now" if now else "" if file is None else "--file"
    if option and path is not None:
        raise OptionError(f"{option} is about missed periods, {path} is an actuator: give one of the two")
    if now and file is not None:
        raise OptionError("--now writes a black box, --file reads one: give one of the two")
    if file is not None and station is not None:
        raise OptionError(f"--file: {file} says itself of which station it is: leave {station} out")
    if station is not None and path is not None:
        from .claimed import show_claim

        show_claim(station, path)
    else:
        from .why import why as say_why

        say_why(station, now, file)

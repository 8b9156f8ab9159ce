"""The command `umo`: its arguments and where they go. The other modules of this package do the work."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from umo.errors import UmoError
from umo.text import cause_of, located

app = typer.Typer(
    name="umo",
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    add_completion=False,
    rich_markup_mode="rich",
    help="Universal Mechatronic Objects: run, check and try out machines.\n\n"
    "Examples:  umo run ztheta  |  umo check my-machine  |  umo new my-machine",
)

StationName = Annotated[
    str,
    typer.Argument(
        metavar="STATION", help="Directory of a station, or the name of a shipped one (ztheta, conveyor, furnace)."
    ),
]
OptionalStation = Annotated[
    str | None,
    typer.Argument(
        metavar="STATION", help="Directory of a station, or the name of a shipped one (ztheta, conveyor, furnace)."
    ),
]
"""Of commands that show the options of the station in their help."""
NO_STATION = "give the directory of a station, or the name of a shipped one"
WiringName = Annotated[
    str | None,
    typer.Option("--wiring", "-w", metavar="NAME|FILE", help="Name of a wiring of the station, or a TOML file."),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="TEXT",
        help="Inject a fault: PATH KIND \\[amount] \\[at TIME] \\[for TIME], such as 'z.encoder stuck at 5 s'. May be "
        "repeated. Kinds: stuck, noise, drift, bit flip, delay, drop-out, disconnect, exception, wrong length, out of "
        "range.",
    ),
]
FaultSeed = Annotated[
    int | None, typer.Option("--fault-seed", min=0, help="Seed of the random numbers of injected faults; default: 0.")
]
OF_THE_MACHINE = {"allow_extra_args": True, "ignore_unknown_options": True}
"""For commands that take the options of the station's machine."""
Acknowledge = Annotated[
    bool, typer.Option("--acknowledge", help="Start even if the last run on a device ended unsafely.")
]
Take = Annotated[bool, typer.Option("--take", help="Take the lease over from whoever has it.")]


def guarded(work: Callable[[], int | None]) -> None:
    """Print any error in one or two lines on stderr and exit. Status 2: a user's mistake. 1 or 3: a device failed.
    1 with file and line: any other exception. 130: Ctrl-C before a machine was started."""
    from umo.process.outcome import FAILED, MISTAKE, message_of, status_of

    try:
        status = work() or 0
    except UmoError as error:
        status = _said(message_of(error), status_of(error))
    except (OSError, UnicodeError) as error:  # of files and folders that were named
        status = _said(_about_file(error), MISTAKE)
    except KeyboardInterrupt:
        status = 128 + signal.SIGINT
    except BaseException as error:  # SystemExit too: whoever ends Python in the middle has not succeeded
        status = _said(f"{located(error)}", FAILED)
    raise typer.Exit(status)


def _said(text: str, status: int) -> int:
    typer.echo(f"umo: {text}", err=True)
    return status


def _about_file(error: OSError | UnicodeError) -> str:
    name, why = getattr(error, "filename", None), getattr(error, "strerror", None)
    return f"{os.fsdecode(name)}: {why}" if isinstance(name, str | bytes) and why else cause_of(error)


def _finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number of seconds")
    return value


@app.command(
    epilog="Examples: umo run ztheta  |  umo run ztheta --parts 2 --turn 45  |  umo run ztheta -w modbus  |  "
    "umo run ztheta --fault 'z.encoder stuck at 5 s'  |  umo run ztheta --help",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def run(
    context: typer.Context,
    station: OptionalStation = None,
    wiring: WiringName = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Run in wall-clock time, whatever the wiring's timer.")
    ] = False,
    manual: Annotated[
        bool,
        typer.Option("--manual", help="Start in manual mode, in wall-clock time: see umo mode, umo call, umo set."),
    ] = False,
    summary: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write a summary of the run to this file.")
    ] = None,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    acknowledge: Acknowledge = False,
    full_traceback: Annotated[
        bool, typer.Option("--traceback", help="Show the full traceback of an exception.")
    ] = False,
    help_: Annotated[
        bool, typer.Option("--help", "-h", help="Show this message, and the options of the station.")
    ] = False,
) -> None:
    """Run a station. Exit status 0: its application has returned.

    The options of the station are the parameters of its machine, its application and its drivers. They follow its
    name.

    In real time the loop runs in its own process. A guardian process resets the machine if the loop dies or hangs.
    Trace (CSV) and plot (PNG) go to runs/. Ctrl-C stops safely: every actuator goes to its default.
    """
    if help_:
        typer.echo(context.get_help())
        guarded(lambda: _show_options(station, wiring))
    if station is None:
        raise typer.BadParameter(NO_STATION, param_hint="STATION")

    def work() -> int:
        from umo.process.job import Job
        from umo.process.station import find

        from .run import run_station
        from .station_options import parse

        options = parse(find(station), wiring, context.args) | _injected(fault, fault_seed)
        options |= {"realtime": True} if realtime or manual else {}
        job = Job(station, wiring=wiring, options=options, acknowledge=acknowledge, manual=manual)
        return run_station(job, summary=summary, full_traceback=full_traceback)

    guarded(work)


def _injected(faults: list[str] | None, seed: int | None) -> dict[str, Any]:
    """The options of a run for the faults to inject."""
    return ({"fault": faults} if faults else {}) | ({} if seed is None else {"fault_seed": seed})


def _show_options(station: str | None, wiring: str | None, application: bool = True) -> None:
    if station is not None:
        from umo.process.station import find

        from .console import out
        from .station_options import help_panel

        out.print(help_panel(find(station), wiring, application=application))


@app.command(
    epilog="Examples: umo check ztheta  |  umo check ztheta -w modbus  |  umo check furnace --zones 100",
    context_settings=OF_THE_MACHINE,
)
def check(context: typer.Context, station: StationName, wiring: WiringName = None) -> None:
    """Find every fault of a wiring, without touching hardware. Options of the machine follow the station's name."""
    from umo.process.station import find

    from .show import check_station

    guarded(lambda: check_station(find(station), wiring, context.args))


@app.command(
    epilog="Examples: umo tree ztheta  |  umo tree ztheta z -w second_generation  |  umo tree furnace --zones 3 --all",
    context_settings={"ignore_unknown_options": True},
)
def tree(
    station: StationName,
    words: Annotated[
        list[str] | None, typer.Argument(metavar="[PATH]", help="An object or a list of the machine, such as z.")
    ] = None,
    wiring: WiringName = None,
    everything: Annotated[bool, typer.Option("--all", help="Show every member of a list.")] = False,
) -> None:
    """Show the hierarchy of objects with units, ranges and wiring (the paper's Figure 4).

    Three or more like members of a list are shown once: with the parts of the first, and the wires of the first and
    the last. Members that differ are shown by themselves. Options of the machine follow the station's name.
    """
    from umo.process.station import find

    from .tree import show_tree

    guarded(lambda: show_tree(find(station), wiring, words or [], everything))


@app.command(
    epilog="Examples: umo conform oven/wiring/modbus.toml  |  umo conform oven -w modbus --only coil:3 --yes  |  "
    "umo conform oven -w bench --loopback dac:0=adc:0",
    context_settings=OF_THE_MACHINE,
)
def conform(
    context: typer.Context,
    target: Annotated[
        str, typer.Argument(metavar="WIRING|STATION", help="A wiring file of a station, or a station (with -w).")
    ],
    wiring: WiringName = None,
    driver: Annotated[
        str | None, typer.Option(metavar="NAME", help="The driver to test; default: the only one with hardware.")
    ] = None,
    loopback: Annotated[
        list[str] | None,
        typer.Option(metavar="OUT=IN", help="The input that reads the level of an output. Can be repeated."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="Use this channel or object, and no others. Can be repeated."),
    ] = None,
    refused: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="A channel that the device refuses: its text. Can be repeated."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(min=0.0, callback=_finite, help="Of loop-backs, in the unit of the output.")
    ] = 0.0,
    cycles: Annotated[int, typer.Option(min=1, help="Transfers in the search for leaks.")] = 10_000,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the certificate to this file.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Drive the outputs without asking.")] = False,
    acknowledge: Acknowledge = False,
) -> None:
    """Prove that a driver keeps its contract, with its device. Exit status 1: it breaks a rule.

    The outputs are driven over the ranges of their objects, after you have agreed to it; all go to their defaults at
    the end. A driver with the options host and port, or serial, is also tested with a disturbed line to its device.
    """
    from .conform import Choice, conform_wiring

    choice = Choice(driver, only or (), loopback or (), refused or (), tolerance, cycles, json_file, yes, acknowledge)
    guarded(lambda: conform_wiring(target, wiring, choice, context.args))


@app.command(
    epilog="Examples: umo drivers  |  umo drivers modbus  |  umo drivers .card:Card  |  "
    "umo drivers fmu --model tank.fmu",
    context_settings=OF_THE_MACHINE,
)
def drivers(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="A driver: its name, module:Class, or .module:Class for a module of the station in this folder.",
        ),
    ] = None,
) -> None:
    """List the drivers, or describe one: its options, channels and functions.

    Some drivers know their channels only with their options; give these after the name.
    """
    from .describe import show_driver, show_drivers

    guarded(lambda: show_drivers() if name is None else show_driver(name, context.args))


@app.command(
    epilog="Examples: umo get ztheta z.encoder  |  umo get ztheta z.encoder gripper.pressure --unit mm",
    context_settings={"ignore_unknown_options": True},
)
def get(
    station: StationName,
    paths: Annotated[list[str], typer.Argument(metavar="PATH...", help="Objects, such as z.encoder.")],
    wiring: WiringName = None,
    unit: Annotated[str | None, typer.Option(help="Show digital values in this unit.")] = None,
    acknowledge: Acknowledge = False,
) -> None:
    """Read objects by path: from the frames if the station is running; otherwise connect, read and reset. Options of
    the machine follow the station's name."""
    from umo.process.station import find

    from .hand import get_values

    guarded(lambda: get_values(find(station), wiring, paths, unit, acknowledge))


@app.command(
    "set",
    epilog="Examples: umo set ztheta gripper.vacuum ON --hold 2  |  umo set ztheta z.motor '500 mV' --hold 1",
    context_settings=OF_THE_MACHINE,
)
def set_(
    context: typer.Context,
    station: StationName,
    path: Annotated[str, typer.Argument(help="An actuator, such as gripper.vacuum.")],
    value: Annotated[str, typer.Argument(help="A state (ON), a number, or a number with a unit ('80 mm').")],
    wiring: WiringName = None,
    hold: Annotated[
        float | None, typer.Option(min=0.0, callback=_finite, help="Hold time in s; default: until Ctrl-C.")
    ] = None,
    acknowledge: Acknowledge = False,
    take: Take = False,
) -> None:
    """Connect, write and hold one actuator, show its value, then reset. No control code runs. Options of the machine
    follow the value.

    Of a station that runs, the actuator is taken by hand; that needs its manual mode (`umo mode`).
    """
    from umo.process.station import find

    from .hand import set_value

    guarded(lambda: set_value(find(station), wiring, path, value, hold, acknowledge, take, context.args))


@app.command(
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
    seconds: Annotated[float | None, typer.Option(min=0.0, callback=_finite, help="Exit after this time in s.")] = None,
) -> None:
    """Watch a running station: values, traces, missed periods. Watching does not disturb the station.

    Like objects of lists are folded into one line. In a terminal: arrows, page up and down, home and end move; enter
    folds and unfolds; a: all; q quits. Without a terminal, or with --once, every object is shown once.
    """
    from .watch import watch as show

    guarded(lambda: show(words or [], once, seconds))


@app.command(
    epilog="Examples: umo view  |  umo view ztheta --open  |  umo view --port 8300  |  "
    "umo view --host 0.0.0.0 --token 'a long secret' --certificate cell.pem --key cell.key"
)
def view(
    station: Annotated[
        str | None,
        typer.Argument(metavar="[STATION]", help="Name or directory of the station to show first; it may start later."),
    ] = None,
    wiring: WiringName = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port; default: 8270, or any free one if it is taken.")
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen at. Any other than this computer's own loopback needs a token.")
    ] = "127.0.0.1",
    hands: Annotated[bool, typer.Option("--hands", help="Let other computers command too, not only see.")] = False,
    token: Annotated[
        str | None,
        typer.Option(
            "--token", "--password", envvar="UMO_TOKEN", help="What a browser must give; default: a random token."
        ),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE.pem", help="Certificate for TLS (https); needs --key.")
    ] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE.key", help="Private key of the certificate.")] = None,
) -> None:
    """Show running stations in a browser: scope, machine, twin. Prints the address, which carries a token.

    The page is served by a process of its own, which reads the frames: it does not disturb the station. It listens
    on loopback. At another address (--host) it asks for the token, and is read-only unless --hands is given; give a
    certificate there, or the token can be read on the network. Ctrl-C ends it; the stations go on.
    """
    from .page import ViewOptions
    from .page import view as show

    guarded(lambda: show(ViewOptions(station, wiring, host, port, token, open_, hands, certificate, key)))


@app.command(epilog="Examples: umo ps  |  umo ps --json")
def ps(as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False) -> None:
    """List the stations that run in real time, and the devices whose last run ended unsafely."""
    from .running import ps as show

    guarded(lambda: show(as_json))


@app.command(epilog="Examples: umo latency  |  umo latency --period 500us --seconds 60 --load")
def latency(
    period: Annotated[str, typer.Option(help="The sampling period, such as 1ms or 500us.")] = "1ms",
    seconds: Annotated[
        float, typer.Option(min=0.1, callback=_finite, help="Measuring time of each of the two loops in s.")
    ] = 10.0,
    load: Annotated[bool, typer.Option("--load", help="Load every core during the measurement.")] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the results to this file.")
    ] = None,
) -> None:
    """Measure whether this computer can keep a sampling period, with umo's loop and a bare loop in C.

    yes: no period missed, and the longest wake-up plus work below half of the period. with care: at most one of a
    thousand missed and 99.9 % below the period. no: otherwise. The result is valid for the measured time and load only.
    """
    from .latency import latency as answer

    guarded(lambda: answer(period, seconds, load, json_file))


@app.command(epilog="Examples: umo why  |  umo why ztheta  |  umo why ztheta --now  |  umo why --file kept.box")
def why(
    station: Annotated[
        str | None, typer.Argument(metavar="[STATION]", help="Name of a station; default: all stations.")
    ] = None,
    now: Annotated[bool, typer.Option("--now", help="First write a black box of the running station.")] = False,
    file: Annotated[
        Path | None, typer.Option(metavar="FILE.box", help="Read this black box instead of the newest one.")
    ] = None,
) -> None:
    """Show why periods were missed: the newest black box, the duration of each phase, and the cause."""
    from .why import why as say_why

    guarded(lambda: say_why(station, now, file))


@app.command(
    epilog="Examples: umo plant ztheta  |  umo plant ztheta --port 1502 --seed 7 --faults leaky-cup  |  "
    "umo plant my-machine -w modbus --help",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def plant(
    context: typer.Context,
    station: OptionalStation = None,
    wiring: Annotated[
        str | None,
        typer.Option(
            "--wiring",
            "-w",
            metavar="NAME|FILE",
            help="Modbus wiring that says which object is in which register; default: modbus, or the only one.",
        ),
    ] = None,
    plant_wiring: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE", help="Simulated wiring that has the plant; default: the station's first, simulated."
        ),
    ] = None,
    host: Annotated[str | None, typer.Option(help="Address to serve at; default: the wiring's.")] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port; 0: any free port; default: the wiring's.")
    ] = None,
    watchdog: Annotated[
        float | None, typer.Option(help="Watchdog timeout in s, at most 65.535; 0: off; default: the wiring's.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write the plant's own report to this file.")
    ] = None,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    help_: Annotated[
        bool, typer.Option("--help", "-h", help="Show this message, and the options of the plant.")
    ] = False,
) -> None:
    """Serve a station's plant over Modbus TCP in real time, like the controller boxes of the machine.

    The simulated wiring says which plant channel each object is on, the Modbus wiring in which register of which box.
    The options of the plant's drivers follow the name of the station.
    """
    if help_:
        typer.echo(context.get_help())
        guarded(lambda: _show_options(station, plant_wiring, application=False))

    if station is None:
        raise typer.BadParameter(NO_STATION, param_hint="STATION")

    def work() -> None:
        from umo.process.station import find

        from .plant import serve_plant

        changes = {"host": host, "port": port, "watchdog": watchdog}
        injected = _injected(fault, fault_seed)
        serve_plant(find(station), wiring, plant_wiring, context.args, changes, report, injected)

    guarded(work)


@app.command(epilog="Examples: umo new my-machine && umo run my-machine")
def new(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")],
) -> None:
    """Create a small working station with tests."""
    from .new import make_station

    guarded(lambda: make_station(directory))


@app.command(
    "new-driver",
    epilog="Examples: umo new-driver my_card && pytest test_my_card.py",
)
def new_driver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_card.")],
) -> None:
    """Create a driver with its tests in this folder: NAME.py and test_NAME.py.

    The driver works at once, with a device in memory. Its tests run the conformance kit, which proves that a driver
    keeps the contract. Replace the device in memory by the calls of the real one; the tests stay.
    """
    from .new import make_driver

    guarded(lambda: make_driver(name, Path.cwd()))


from . import app_running  # noqa: E402, F401  (its commands)


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        typer.echo(f"umo {version('umo')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass

"""The command `umo`: its arguments and where they go. The other modules of this package do the work."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from umo.errors import UmoError, text_of

from .mistakes import MISTAKE, CommandLine, Subcommand

app = typer.Typer(
    name="umo",
    cls=CommandLine,
    invoke_without_command=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    add_completion=False,
    rich_markup_mode="rich",
    help="Universal Mechatronic Objects: run, check and try out machines.\n\n"
    "Examples:  umo run ztheta  |  umo check my-machine  |  umo new my-machine",
)
F = TypeVar("F", bound=Callable[..., Any])
USUAL = "0 done; 1 the machine, a device or code failed; 2 a mistake, told on stderr; 130 Ctrl-C"
"""Exit statuses of most commands (docs/command-line.md)."""


class HelpPanel:
    """A panel of the help. Makes commands in it, whose own help ends with examples and exit statuses."""

    def __init__(self, title: str) -> None:
        self._title = title

    def __call__(
        self, name: str | None = None, *, epilog: str, status: str = USUAL, **options: Any
    ) -> Callable[[F], F]:
        end = f"{epilog}\n\nExit status: {status}"
        return app.command(name, cls=Subcommand, epilog=end, rich_help_panel=self._title, **options)


command = HelpPanel("Stations")

_STATION = typer.Argument(
    metavar="STATION", help="Directory of a station, or the name of a shipped one (ztheta, conveyor, furnace)."
)
StationName = Annotated[str, _STATION]
OptionalStation = Annotated[str | None, _STATION]
"""The station of commands that show its options in their help."""
NO_STATION = "give the directory of a station, or the name of a shipped one"
WiringName = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Name of a wiring of the station, or a TOML file; default: simulated, else the first by name.",
    ),
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
BoxWiring = Annotated[
    str | None,
    typer.Option(
        "--wiring",
        "-w",
        metavar="NAME|FILE",
        help="Modbus wiring that says which object is in which register; default: modbus, or the only one.",
    ),
]
PlantWiring = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE", help="Simulated wiring that has the plant; default: the station's first, simulated."
    ),
]
Help = Annotated[bool, typer.Option("--help", "-h", help="Show this message, and the options of the station.")]
"""The option --help of commands that take the options of a station and name them in their help."""
OF_THE_MACHINE = {"allow_extra_args": True, "ignore_unknown_options": True}
"""For commands that take the options of the station's machine."""
Acknowledge = Annotated[
    bool, typer.Option("--acknowledge", help="Start even if the last run on a device ended unsafely.")
]
Take = Annotated[bool, typer.Option("--take", help="Take the lease over from whoever has it.")]


def guarded(work: Callable[[], int | None]) -> None:
    """Print any error in one or two lines on stderr and exit. Status 2: a user's mistake. 1 or 3: a device failed.
    1 with file and line: any other exception. 130: Ctrl-C before a machine was started."""
    from umo.process.outcome import FAILED, message_of, status_of

    try:
        status = work() or 0
    except UmoError as error:
        status = _said(message_of(error), status_of(error))
    except (OSError, UnicodeError) as error:  # of files and folders that were named
        status = _said(_about_file(error), MISTAKE)
    except KeyboardInterrupt:
        status = 128 + signal.SIGINT
    except BaseException as error:  # SystemExit too: whoever ends Python in the middle has not succeeded
        status = _said(f"{text_of(error)}", FAILED)
    raise typer.Exit(status)


def _said(text: str, status: int) -> int:
    from .console import err

    err.print(f"umo: {text}", soft_wrap=True)
    return status


def _about_file(error: OSError | UnicodeError) -> str:
    name, why = getattr(error, "filename", None), getattr(error, "strerror", None)
    return f"{os.fsdecode(name)}: {why}" if isinstance(name, str | bytes) and why else text_of(error)


def finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number of seconds")
    return value


@command(
    epilog="Examples: umo run ztheta  |  umo run ztheta --parts 2 --turn 45  |  umo run ztheta -w modbus  |  "
    "umo run ztheta --fault 'z.encoder stuck at 5 s'  |  umo run ztheta --help",
    status="0 the application has returned; 1 the machine, a device or code failed; 2 a mistake, nothing ran; 3 an "
    "actuator is not at its default; 4 runs/ cannot be written: nothing ran, or all but the record went well; 124 "
    "ended by --until; 128 and its number: ended by a signal, 130 by Ctrl-C",
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
    until: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="End the run at this time on the machine's clock: in s, or such as '5 min'."),
    ] = None,
    summary: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write a summary of the run to this file.")
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Write nothing to runs/.")] = False,
    no_plot: Annotated[bool, typer.Option("--no-plot", help="Draw no plot at the end.")] = False,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    acknowledge: Acknowledge = False,
    full_traceback: Annotated[
        bool, typer.Option("--traceback", help="Show the full traceback of an exception.")
    ] = False,
    help_: Help = False,
) -> None:
    """Run a station until its application returns.

    The options of the station are the parameters of its machine, its application and its drivers. They follow its
    name.

    In real time the loop runs in its own process. A guardian process resets the machine if the loop dies or hangs.
    Trace (CSV) and plot (PNG) go to runs/. Ctrl-C stops safely: every actuator goes to its default.
    """
    name = _named(context, help_, station, wiring)

    def work() -> int:
        from umo.process.job import Job
        from umo.process.station import find

        from .run import Recording, run_station
        from .station_options import parse
        from .values import duration

        options = parse(find(name), wiring, context.args) | _injected(fault, fault_seed)
        options |= {"realtime": True} if realtime or manual else {}
        end = None if until is None else duration("--until", until)
        job = Job(name, wiring=wiring, options=options, acknowledge=acknowledge, manual=manual, until=end)
        return run_station(job, Recording(not no_record, not no_plot, summary), full_traceback=full_traceback)

    guarded(work)


def _injected(faults: list[str] | None, seed: int | None) -> dict[str, Any]:
    """The options of a run for the faults to inject."""
    return ({"fault": faults} if faults else {}) | ({} if seed is None else {"fault_seed": seed})


def _named(
    context: typer.Context, help_: bool, station: str | None, wiring: str | None, application: bool = True
) -> str:
    """The station that is named. With --help: show the help and the options of the station, and exit."""
    if help_:
        typer.echo(context.get_help())
        guarded(lambda: _show_options(station, wiring, application))
    if station is None:
        raise typer.BadParameter(NO_STATION, param_hint="STATION")
    return station


def _show_options(station: str | None, wiring: str | None, application: bool) -> None:
    if station is not None:
        from umo.process.station import find

        from .console import out
        from .station_options import help_panel

        out.print(help_panel(find(station), wiring, application=application))


@command(
    epilog="Examples: umo plant ztheta  |  umo plant ztheta --port 1502 --seed 7 --faults leaky-cup  |  "
    "umo plant my-machine -w modbus --help",
    status="0 ended by Ctrl-C; 1 the plant failed; 2 a mistake, told on stderr",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def plant(
    context: typer.Context,
    station: OptionalStation = None,
    wiring: BoxWiring = None,
    plant_wiring: PlantWiring = None,
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
    help_: Help = False,
) -> None:
    """Serve a station's plant over Modbus TCP in real time, like the controller boxes of the machine.

    The simulated wiring says which plant channel each object is on, the Modbus wiring in which register of which box.
    The options of the plant's drivers follow the name of the station.
    """
    name = _named(context, help_, station, plant_wiring, application=False)

    def work() -> None:
        from umo.process.station import find

        from .plant import serve_plant

        changes = {"host": host, "port": port, "watchdog": watchdog}
        injected = _injected(fault, fault_seed)
        serve_plant(find(name), wiring, plant_wiring, context.args, changes, report, injected)

    guarded(work)


@command(epilog="Examples: umo latency  |  umo latency --period 500us --seconds 60 --load")
def latency(
    period: Annotated[str, typer.Option(help="The sampling period, such as 1ms or 500us.")] = "1ms",
    seconds: Annotated[
        float, typer.Option(min=0.1, callback=finite, help="Measuring time of each of the two loops in s.")
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


from . import app_running, app_wiring  # noqa: E402, F401  (their commands)


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        typer.echo(f"umo {version('umo')}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(MISTAKE)

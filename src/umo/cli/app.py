"""The command `umo`: its arguments and where they go. The other modules of this package do the work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from umo.errors import OptionError
from umo.exit_status import ExitStatus

from .shared import (
    NO_STATION,
    Acknowledge,
    BoxWiring,
    Faults,
    FaultSeed,
    Help,
    HelpPanel,
    OptionalStation,
    PlantWiring,
    WiringName,
    app,
    finite,
    options_of_command,
)

__all__ = ["app"]

command = HelpPanel("Stations")


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
    keep: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Write every period to runs/.../trace-000001.csv and so on, at most so much, such as '200 MB': the "
            "oldest parts are removed. For runs that go on for months.",
        ),
    ] = None,
    keep_runs: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER", min=1, help="Remove the oldest runs of this station in runs/ but for so many with this."
        ),
    ] = None,
    record: Annotated[
        str | None,
        typer.Option(
            "--record",
            metavar="\\[FILE.mcap]",
            help="Record every period, bit by bit; default: recording.mcap in runs/... (see umo record).",
        ),
    ] = None,
    last: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Flight recorder: record only the last '10 min'; saved if the run fails, or on demand."
        ),
    ] = None,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    acknowledge: Acknowledge = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start without the kept values of the last run (see umo kept).")
    ] = False,
    no_faces: Annotated[
        bool, typer.Option("--no-faces", help="Do not serve the faces of the wiring (see umo face).")
    ] = False,
    full_traceback: Annotated[
        bool, typer.Option("--traceback", help="Show the full traceback of an exception.")
    ] = False,
    help_: Help = False,
) -> int:
    """Run a station until its application returns.

    The options of the station are the parameters of its machine, its application and its drivers. They follow its
    name.

    In real time the loop runs in its own process. A guardian process resets the machine if the loop dies or hangs.
    The faces of the wiring are served by another process.
    Trace (CSV) and plot (PNG) go to runs/. Ctrl-C stops safely: every actuator goes to its default.
    """
    name = _named(context, help_, station, wiring)
    from umo.process.job import Job
    from umo.process.station import find

    from .run import Record, run_station
    from .station_options import parse
    from .values import duration, size

    options = parse(find(name), wiring, context.args, options_of_command(context)) | _injected(fault, fault_seed)
    options |= {"realtime": True} if realtime or manual else {}
    end = None if until is None else duration("--until", until)
    job = Job(name, wiring=wiring, options=options, acknowledge=acknowledge, manual=manual, until=end, fresh=fresh)
    if no_record and (keep is not None or keep_runs is not None):
        raise OptionError("--keep and --keep-runs are for the record: leave out --no-record")
    room = None if keep is None else size("--keep", keep, least=10**6)
    file = None if record is None else Path(record)
    left = Record(not no_record, not no_plot, summary, room, keep_runs, file, {} if last is None else {"last": last})
    return run_station(job, left, full_traceback=full_traceback, serve=not no_faces)


def _injected(faults: list[str] | None, seed: int | None) -> dict[str, Any]:
    return ({"fault": faults} if faults else {}) | ({} if seed is None else {"fault_seed": seed})


def _named(
    context: typer.Context, help_: bool, station: str | None, wiring: str | None, application: bool = True
) -> str:
    """The station that is named. With --help: show the help and the options of the station, and exit."""
    if help_:
        typer.echo(context.get_help())
        if station is not None:
            from umo.process.station import find

            from .console import out
            from .station_options import help_panel

            out.print(help_panel(find(station), wiring, application=application))
        raise typer.Exit
    if station is None:
        raise typer.BadParameter(NO_STATION, param_hint="STATION")
    return station


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

    from umo.process.station import find

    from .plant import serve_plant

    changes = {"host": host, "port": port, "watchdog": watchdog}
    injected = _injected(fault, fault_seed)
    serve_plant(find(name), wiring, plant_wiring, context.args, changes, report, injected)


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

    answer(period, seconds, load, json_file)


from . import (  # noqa: E402  (their commands)
    app_fleet,  # noqa: F401
    app_fleet_certificates,  # noqa: F401
    app_record,  # noqa: F401
    app_recordings,  # noqa: F401
    app_replay,  # noqa: F401
    app_running,  # noqa: F401
    app_service,  # noqa: F401
    app_tuning,  # noqa: F401
    app_wiring,  # noqa: F401
)


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
        raise typer.Exit(ExitStatus.MISTAKE)

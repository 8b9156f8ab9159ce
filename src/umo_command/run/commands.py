"""`umo run`: its arguments, and the functions that carry it out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from umo.errors import OptionError
from umo_command.options import (
    NO_STATION,
    Acknowledge,
    Faults,
    FaultSeed,
    Help,
    OptionalStation,
    WiringName,
    size_of,
    time_option,
)
from umo_command.shared import HelpPanel, options_of_command

command = HelpPanel("Run")


@command(
    epilog="Examples: umo run ztheta  |  umo run furnace --realtime  |  umo run ztheta --parts 2 --turn 45  |  "
    "umo run ztheta -w second_generation  |  umo run ztheta --fault 'z.encoder stuck at 5 s'  |  umo run ztheta --help",
    status="0 the application has returned; 1 the machine, a device or code failed; 2 the command line, the wiring or "
    "a declaration is wrong, and nothing ran; 3 an actuator is not at its default; 4 the folder runs/ cannot be "
    "written: nothing ran, or the run succeeded but its record is incomplete; 124 --until ended the run; 130 Ctrl-C "
    "ended the run; 128 plus N: signal number N ended the run; 143 also after `umo do "
    "STATION stop`",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def run(
    context: typer.Context,
    station: OptionalStation = None,
    wiring: WiringName = None,
    realtime: Annotated[
        bool,
        typer.Option("--realtime", help="Run in real time, even if the wiring has a simulated timer."),
    ] = False,
    manual: Annotated[
        bool,
        typer.Option("--manual", help="Start in manual mode, in real time (see umo do)."),
    ] = False,
    until: Annotated[
        float | None, time_option(help="End the run at this time on the machine's clock, such as 30 (in s) or '5 min'.")
    ] = None,
    summary: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write a summary of the run to this file.")
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Write nothing to runs/.")] = False,
    no_plot: Annotated[bool, typer.Option("--no-plot", help="Draw no plot at the end.")] = False,
    keep: Annotated[
        int | None,
        typer.Option(
            metavar="SIZE",
            parser=size_of,
            help="Write every period to runs/.../trace-000001.csv and the files that follow, and remove the oldest so "
            "that their total size stays below SIZE, such as '200 MB'. For runs of months.",
        ),
    ] = None,
    keep_runs: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER", min=1, help="Keep the newest NUMBER runs of this station in runs/, and remove older runs."
        ),
    ] = None,
    record: Annotated[
        str | None,
        typer.Option(
            "--record",
            metavar="[FILE.mcap]",
            help="Record the exact values of every period in this file (see umo recording make). Without a name: "
            "recording.mcap in runs/...",
        ),
    ] = None,
    last: Annotated[
        float | None,
        time_option(
            help="Flight recorder: keep only the newest data, for a length of time such as '10 min'. They are saved if "
            "the run fails, and by umo recording save."
        ),
    ] = None,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    acknowledge: Acknowledge = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start without the kept values of the last run (see umo tune kept).")
    ] = False,
    no_faces: Annotated[
        bool, typer.Option("--no-faces", help="Do not serve the faces of the wiring (see umo connect face).")
    ] = False,
    full_traceback: Annotated[
        bool, typer.Option("--traceback", help="Show the full traceback of an exception, also of one in equipment.")
    ] = False,
    help_: Help = False,
) -> int:
    """Run a station until its application returns.

    The options of the station are the parameters of its machine, its application and its drivers. They follow its
    name.
    `umo show parts STATION` shows where the files of a station are. To change a station that ships with umo, such as
    its wiring, make a copy of your own: `umo new station NAME --copy STATION`.

    In real time the loop runs in its own process. A guardian process resets the machine if the loop dies or hangs.
    The faces of the wiring are served by another process. Changes of alarms and of the mode, faults and interlocks
    are printed while the station runs.
    The trace (CSV) and the plot (PNG) are written to runs/. Ctrl-C stops safely: every actuator goes to its default.
    """
    name = named(context, help_, station, wiring)
    from umo.process.job import Job
    from umo.process.station import find
    from umo_command.run.station_run import Record, run_station
    from umo_command.station_options import parse

    options = parse(find(name), wiring, context.args, options_of_command(context)) | injected(fault, fault_seed)
    options |= {"realtime": True} if realtime or manual else {}
    job = Job(name, wiring=wiring, options=options, acknowledge=acknowledge, manual=manual, until=until, fresh=fresh)
    if no_record and (keep is not None or keep_runs is not None):
        raise OptionError("--keep and --keep-runs are for the record: leave out --no-record")
    file = None if record is None else Path(record)
    left = Record(not no_record, not no_plot, summary, keep, keep_runs, file, {} if last is None else {"last": last})
    return run_station(job, left, full_traceback=full_traceback, serve=not no_faces)


def injected(faults: list[str] | None, seed: int | None) -> dict[str, Any]:
    return ({"fault": faults} if faults else {}) | ({} if seed is None else {"fault_seed": seed})


def named(
    context: typer.Context, help_: bool, station: str | None, wiring: str | None, application: bool = True
) -> str:
    """Return the named station. With --help, show the help and the options of the station, and exit."""
    if help_:
        typer.echo(context.get_help())
        if station is not None:
            from umo.process.station import find
            from umo_command.console import out
            from umo_command.station_options import help_panel

            out.print(help_panel(find(station), wiring, application=application))
        raise typer.Exit
    if station is None:
        raise typer.BadParameter(NO_STATION, param_hint="STATION")
    return station

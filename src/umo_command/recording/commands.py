"""`umo recording`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import (
    Certificates,
    Connect,
    From,
    JetStream,
    Json,
    KeepRuns,
    RecordedWiring,
    RecordingFile,
    Running,
    To,
    out_option,
    time_option,
)
from umo_command.shared import group

command = group(
    "recording",
    "Records",
    "Record a station exactly. Export, plot, replay and repair recordings. List runs. Store and query the history of "
    "a fleet.",
    "umo recording make ztheta  |  umo recording info run.mcap  |  umo recording replay run.mcap",
)

OptionalFile = Annotated[
    Path | None, typer.Argument(metavar="[FILE.mcap]", help="The recording to write; default: STATION-DATE-TIME.mcap.")
]
FROM_RECORDING = (
    "0 done; 2 the file is not a recording, the output cannot be written, or the command line is wrong "
    "(see stderr); 130 Ctrl-C"
)
STATION_HELP = (
    "Code to run: the folder or name of a station, or FILE.py:MACHINE:APPLICATION; default: the shipped or installed "
    "station with the recorded name."
)
RecordedCode = Annotated[
    str | None, typer.Argument(metavar="[STATION]", help=STATION_HELP, autocompletion=completion.stations)
]
PathsOfRecording = Annotated[
    list[str] | None,
    typer.Argument(metavar="[PATH]...", help="Paths of objects, signals or compounds, or patterns; default: all."),
]
HistoryFolder = Annotated[Path, typer.Argument(metavar="[DIR]", help="Folder of the history; default: fleet-history.")]
HISTORY = Path("fleet-history")


@command(
    epilog="Examples: umo recording make ztheta  |  umo recording make ztheta run.mcap --for '10 s'  |  "
    "umo recording make ztheta long.mcap --rotate '1 h' --keep '20 GB'  |  "
    "umo recording make ztheta --last '10 min'",
    status="0 the run has ended, or --for or Ctrl-C has ended the recording; 1 a file cannot be read or written; 2 the "
    "command line is wrong (see stderr); 4 not everything was recorded",
)
def make(
    station: Running,
    file: OptionalFile = None,
    lasting: Annotated[
        float | None,
        time_option("--for", help="End the recording after this time; default: when the run ends, or Ctrl-C."),
    ] = None,
    last: Annotated[
        float | None,
        time_option(
            help="Flight recorder: keep only the newest data, for a length of time such as '10 min'. They are saved if "
            "the run fails, and by umo recording save.",
        ),
    ] = None,
    rotate: Annotated[float | None, time_option(help="Begin a new file after this time; default: 1 h.")] = None,
    size: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Begin a new file at this size, such as '500 MB'; default: 1 GB.")
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Limit the total size, such as '20 GB', by reducing the oldest files to what a replay needs.",
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Number of messages per second for Foxglove, PlotJuggler and Rerun; default: 100."),
    ] = None,
) -> int:
    """Record the exact values of every period of a running station.

    The file is an MCAP file, which Foxglove, PlotJuggler and Rerun can open too. Recording does not disturb the
    station. The recording begins with the periods before the command that the station still has in memory. To replay a
    run, record it from its beginning (umo run --record). Periods that could not be recorded are
    counted and marked.

    For the examples, start `umo run ztheta --manual` in another terminal.
    """
    from umo_command.recording.making import record_station

    changes = {"last": last, "rotate": rotate, "size": size, "keep": keep, "rate": rate}
    return record_station(station, file, lasting, changes)


@command(
    epilog="Examples: umo recording save ztheta  |  umo recording save ztheta jam.mcap",
    status="0 done; 1 the file cannot be written; 2 the command line is wrong (see stderr)",
)
def save(station: Running, file: OptionalFile = None) -> int:
    """Save the content of a station's flight recorder (umo recording make --last, umo run --record --last).

    For the examples, start `umo run ztheta --realtime --last '10 min'` in another terminal.
    """
    from umo_command.recording.making import save_flight

    return save_flight(station, file)


@command(
    epilog="Examples: umo run ztheta --record run.mcap  |  umo recording repair run.mcap",
    status="0 the file is now complete; 2 the file is not a recording, or cannot be written (see stderr)",
)
def repair(file: RecordingFile) -> int:
    """Repair a file that is incomplete or damaged."""
    from umo_command.recording.making import repair_file

    return repair_file(file)


@command(
    epilog="Examples: umo run ztheta --record run.mcap  |  umo recording info run.mcap  |  "
    "umo recording info run.mcap --json",
    status="0 done; 2 the file is not a recording (see stderr)",
)
def info(file: RecordingFile, as_json: Json = False) -> int:
    """Describe a recording: its run, time and duration, missing periods, and whether it can be replayed."""
    from umo_command.recording.files import info as work

    return work(file, as_json)


@command(
    epilog="Examples: umo run ztheta --record run.mcap  |  umo recording export run.mcap --out run.parquet  |  "
    "umo recording export run.mcap z --out z.csv --from 2 --to '5 s'  |  "
    "umo recording export run.mcap '*.encoder' --out run.npz",
    status=FROM_RECORDING,
)
def export(
    file: RecordingFile,
    paths: PathsOfRecording = None,
    out: Annotated[
        Path | None,
        out_option(
            "FILE", "File to write; its ending selects the format: .parquet, .csv or .npz; default: FILE.parquet."
        ),
    ] = None,
    start: From = None,
    stop: To = None,
) -> int:
    """Write every period of a recording as Parquet, CSV or NumPy (.npz).

    Parquet has one row for each value, like the table `values` of a fleet's history, so that one query covers both. CSV
    has one row for each period. NumPy has the times, and an array of values and an array of qualities for each object
    and signal.
    """
    from umo_command.recording.files import ValueSelection
    from umo_command.recording.files import export as work

    return work(file, out or file.with_suffix(".parquet"), ValueSelection(paths or (), start, stop))


@command(
    epilog="Examples: umo run ztheta --record run.mcap  |  umo recording plot run.mcap  |  "
    "umo recording plot run.mcap z gripper.vacuum --from 2 --to 5 --out z.png",
    status=FROM_RECORDING,
)
def plot(
    file: RecordingFile,
    paths: PathsOfRecording = None,
    out: Annotated[
        Path | None, out_option("FILE.png", "Picture to write; default: FILE.png, next to the recording.")
    ] = None,
    start: From = None,
    stop: To = None,
) -> int:
    """Draw a recording as a picture, like the plot of a run."""
    from umo_command.recording.files import ValueSelection
    from umo_command.recording.files import plot as work

    return work(file, ValueSelection(paths or (), start, stop), out)


@command(
    epilog="Examples: umo run ztheta --record run.mcap  |  umo recording replay run.mcap  |  "
    "umo recording replay run.mcap ztheta  |  "
    "umo recording replay run.mcap --set z.servo.gain=0.004  |  umo recording replay run.mcap --at 12.3s  |  "
    "umo recording replay run.mcap --break 'abs(z.servo.error) > 50'",
    status="0 the commands are identical; 1 they differ; 2 the recording cannot be replayed, or the command line is "
    "wrong (see stderr); 130 Ctrl-C",
)
def replay(
    file: RecordingFile,
    station: RecordedCode = None,
    wiring: RecordedWiring = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Change the value of a number, and draw how the commands change. May be repeated.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        out_option("FILE.png", "File for the plot of --set; default: FILE.what-if.png, next to the recording."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME|PERIOD|first-difference|end",
            help="Stop in a debugger at this time, such as 12.3s, or in this period. The machine is in the state that "
            "it had then.",
        ),
    ] = None,
    condition: Annotated[
        str | None,
        typer.Option(
            "--break",
            metavar="EXPR",
            help="Stop in a debugger each time this expression becomes true, such as 'z.servo.error > 50'.",
        ),
    ] = None,
) -> int:
    """Run the present control code with the inputs of a recording, and compare its commands with the recorded ones, bit
    by bit.

    No device is opened. Times, missed periods, errors of drivers and the commands of clients also come from the
    recording. The first difference is printed with its period, its object, both values, and the line of each sequence.

    A recording contains no code: STATION names the code to run. A notice says if this is not the code of the recorded
    run.

    The debugger is pdb with a few more commands (`help` lists them). It can go to any period, forward and back.
    """
    from umo.recording.replay.code_given import CodeGiven
    from umo_command.recording.replay_run import replay_file

    return replay_file(file, CodeGiven(station, wiring), settings or (), out, at, condition)


@command(
    epilog="Examples: umo run ztheta --record failed.mcap --fault 'z.encoder stuck at 5 s'  |  "
    "umo recording shrink failed.mcap  |  umo recording shrink failed.mcap -o test_crash.py --for 600  |  "
    "umo recording shrink failed.mcap -o test_closed.py --closed",
    status="0 done; 2 the recording has no error and no difference, or the command line is wrong (see stderr)",
)
def shrink(
    file: RecordingFile,
    station: RecordedCode = None,
    wiring: RecordedWiring = None,
    out: Annotated[
        Path | None,
        out_option(
            "FILE.mcap|FILE.py",
            "Recording to write, or pytest file to write together with a recording; default: FILE.shrunk.mcap.",
        ),
    ] = None,
    lasting: Annotated[float, time_option("--for", help="Time limit; default: 2 min.")] = 120.0,
    closed: Annotated[
        bool,
        typer.Option(
            "--closed",
            help="Run the station with its plant (closed loop), and remove faults, options and commands instead of "
            "periods.",
        ),
    ] = False,
) -> int:
    """Find the fewest periods of a recording that still lead to its error, or to its first difference.

    The command removes the inputs of periods, and replays in open loop. The result proves that the error follows from
    the remaining inputs. It does not prove that a real machine would produce these inputs. `umo recording replay` of
    the result compares only the error.
    """
    from umo.recording.replay.code_given import CodeGiven
    from umo_command.recording.replay_shrink import shrink_file

    return shrink_file(file, CodeGiven(station, wiring), out, lasting, closed)


@command(
    epilog="Examples: umo recording runs  |  umo recording runs ztheta  |  umo recording runs ztheta --keep-runs 20"
)
def runs(
    station: Annotated[
        str | None,
        typer.Argument(
            metavar="[STATION]", help="Name of a station; default: all.", autocompletion=completion.stations
        ),
    ] = None,
    keep_runs: KeepRuns = None,
) -> None:
    """List the runs in runs/ with their end and their size, or remove the oldest runs.

    A run that has not ended is never removed.
    """
    from umo_command.recording.runs import show_runs

    show_runs(station, keep_runs)


@command(
    epilog="Examples: umo recording history  |  umo recording history --stations 'cell7/*' --last 30d  |  "
    "umo recording history --connect tls/plant.local:7447 --certificates ~/fleet/history",
    status="0 ended by Ctrl-C or SIGTERM; 1 the network cannot be reached; 2 the command line is wrong (see stderr)",
)
def history(
    folder: HistoryFolder = HISTORY,
    stations: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SITE/STATION", help="Stations to record, such as 'cell7/*'; default: all. May be repeated."
        ),
    ] = None,
    last: Annotated[
        float | None,
        time_option(help="Remove data that are older than this time, such as 30d; default: keep all data."),
    ] = None,
    connect: Connect = None,
    certificates: Certificates = None,
    jetstream: JetStream = None,
) -> int:
    """Write the values and events of the stations of a fleet to Parquet files, one for each station and hour, until
    Ctrl-C.

    `umo recording query` and every program that reads Parquet can query the files. Data that did not arrive are
    recorded as gaps. If you start the command again, it continues where it stopped. With --jetstream it reads the data
    that gateways have stored (umo connect fleet --jetstream), also data from times when this command did not run.
    """
    from umo_command.recording.fleet_history import record_history

    changes = {"connect": connect, "certificates": certificates}
    return record_history(folder, changes, stations or ["*/*"], last, jetstream)


@command(
    epilog='Examples: umo recording query "FROM gaps" --out gaps.csv  |  '
    'umo recording query "SELECT station, path, avg(value) FROM values '
    'WHERE time > now() - INTERVAL 1 HOUR GROUP BY ALL"  |  '
    "umo recording query \"SELECT * FROM events WHERE asked = 'fault' AND time::DATE = '2026-11-25'\"",
)
def query(
    sql: Annotated[str, typer.Argument(metavar="SQL", help="One SELECT statement in the SQL of DuckDB.")],
    folder: HistoryFolder = HISTORY,
    last: Annotated[
        float | None,
        time_option(help="Read only the files that are not older than this time, such as 2h; default: all files."),
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Largest number of rows to print; default: 100.")] = 100,
    out: Annotated[Path | None, out_option("FILE.csv", "Write all rows to this file.")] = None,
    as_json: Json = False,
) -> int:
    """Query the history of a fleet with SQL.

    The tables, with their columns: values (site, station, time, time_error, run, number, delta, path, value, state,
    quality), events (site, station, time, run, number, path, text, who, asked, state, command), gaps (site, station,
    time, run, of, first, last, count, why), objects (site, station, run, started, wiring, path, kind, unit, minimum,
    maximum, states). Times are UTC.
    """
    from umo_command.recording.fleet_history import query_history

    return query_history(folder, sql, last=last, rows=rows, csv=out, as_json=as_json)

"""The command for recordings: its arguments and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import HelpPanel

command = HelpPanel("Running stations")


@command(
    epilog="Examples: umo record ztheta  |  umo record ztheta run.mcap --rotate '1 h' --keep '20 GB'  |  "
    "umo record ztheta --last '10 min'  |  umo record --save ztheta  |  umo record --repair run.mcap",
    status="0 the run, or Ctrl-C, has ended it; 1 a file cannot be read or written; 2 a mistake, told on stderr; 4 not "
    "everything was recorded",
)
def record(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="STATION [FILE.mcap]",
            help="Name or pid of a station that runs in real time; the file, default: STATION-DATE-TIME.mcap. With "
            "--repair only the file.",
        ),
    ] = None,
    last: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Flight recorder: keep the last '10 min'; saved if the run fails, or by --save."
        ),
    ] = None,
    rotate: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin a new file after this time; default: 1 h.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Begin a new file at this size, such as '500 MB'; default: 1 GB.")
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Of older files beyond this size keep only what replay needs."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Messages a second for other people's tools; default: 100.")
    ] = None,
    save: Annotated[bool, typer.Option("--save", help="Save what the flight recorder of the station has.")] = False,
    repair: Annotated[bool, typer.Option("--repair", help="Make a file that was cut or torn whole.")] = False,
) -> int:
    """Record a running station, bit by bit, in an MCAP file that other people's tools open.

    A process reads the frames of the station and disturbs nothing. What is recorded from the beginning of a run on
    (umo run --record) can be replayed. Frames that are lost are counted and marked.
    """
    from .record import checked, record_station, repair_file, save_flight

    given = words or []
    checked(given, save, repair)
    if repair:
        return repair_file(Path(given[0]))
    file = Path(given[1]) if len(given) > 1 else None
    if save:
        return save_flight(given[0], file)
    return record_station(given[0], file, {"last": last, "rotate": rotate, "size": size, "keep": keep, "rate": rate})

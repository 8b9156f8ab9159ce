"""`umo why STATION PATH`: who drives an actuator, why, and what comes next."""

from __future__ import annotations

from contextlib import closing

from rich.table import Table

from umo.errors import FramesError, OptionError
from umo.frames import Reader
from umo.objects.claims import Rank
from umo.presentation.durations import duration
from umo.presentation.rows import value_of as shown_value
from umo.remote.search import find_running

from .console import out, say


def show_claim(station: str, path: str) -> None:
    """PathError, FramesError and OptionError for what is not there, does not run, and is no actuator."""
    with closing(find_running(station, say)) as reader:
        number, frame = reader.index(path), reader.latest()
        if not reader.layout.described.objects[number].is_actuator:
            raise OptionError(f"{path} is a sensor, which nobody drives; `umo get {station} {path}` shows it")
        if frame is None:
            raise FramesError(f"no period of {station} has ended yet")
        out.print(_table(reader, frame, number))


def _table(reader: Reader, frame: object, number: int) -> Table:
    about, claim = reader.layout.described.objects[number], reader.claim(frame, number)
    (row,) = reader.rows(frame, [number])
    table = Table(title=about.path, title_justify="left", show_header=False)
    table.add_row("value", shown_value((row,)))
    table.add_row("driven by", claim.who)
    if claim.rank is Rank.PROGRAM and reader.mode is not None:
        table.add_row("mode", str(reader.mode))
    table.add_row("next", claim.ends)
    table.add_row("default", about.default_text)
    if about.expires:
        table.add_row("expires", f"{duration(about.expires)} after a write of the program the default is sent")
    if about.is_held:
        table.add_row("when suspended", "it holds its value")
    return table

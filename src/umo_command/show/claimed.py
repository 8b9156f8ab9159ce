"""`umo show why STATION PATH`: shows who drives an actuator, why, and the next steps."""

from __future__ import annotations

from contextlib import closing

from rich.table import Table

from umo.duration import duration
from umo.errors import FramesError, OptionError
from umo.objects.claims import Rank
from umo.objects.presentation.rows import value_of as shown_value
from umo.process.frames import RunReader
from umo.process.frames.search import find_running
from umo_command.console import out, say


def show_claim(station: str, path: str) -> None:
    """Print who drives an actuator. Raises PathError, FramesError or OptionError if the path does not exist, the
    station does not run, or the path is not that of an actuator."""
    with closing(find_running(station, say)) as reader:
        number, frame = reader.index(path), reader.latest()
        if not reader.layout.described.objects[number].is_actuator:
            raise OptionError(f"{path} is a sensor, which cannot be driven; `umo device get {station} {path}` shows it")
        if frame is None:
            raise FramesError(f"no period of {station} has ended yet")
        out.print(_table(reader, frame, number))


def _table(reader: RunReader, frame: object, number: int) -> Table:
    about, claim = reader.layout.described.objects[number], reader.claim(frame, number)
    (row,) = reader.rows(frame, [number])
    table = Table(title=about.path, title_justify="left", show_header=False)
    table.add_row("value", shown_value((row,)))
    table.add_row("driven by", claim.who)
    if claim.rank is Rank.PROGRAM and (mode := reader.now().mode) is not None:
        table.add_row("mode", str(mode))
    table.add_row("next", claim.ends)
    table.add_row("default", about.default_text)
    if about.expires:
        table.add_row("expires", f"the default is sent {duration(about.expires)} after the last write of the program")
    if about.is_held:
        table.add_row("when suspended", "the actuator holds its value")
    return table

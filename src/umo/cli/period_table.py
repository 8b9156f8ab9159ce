"""`umo tree --period`: the phases of a period of a station, and who acts in each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.table import Table

from umo.cycle.laid_out import laid_out
from umo.cycle.period import PHASES
from umo.errors import OptionError
from umo.presentation.durations import duration
from umo.process.station import Station
from umo.wiring import resolve

from .console import out
from .station_options import machine_and_words

FEW = 8
"""Who acts in a phase: so many are named at most."""


def show_period(station: Station, wiring: str | None, words: Sequence[str] = ()) -> int:
    """The phases in their order; nothing is opened. `words`: options of the machine."""
    root, paths = machine_and_words(station, words)
    if paths:
        raise OptionError(f"unexpected argument {paths[0]!r}: --period is about the whole machine")
    wired = resolve(root, station.wiring(wiring))
    with laid_out(root, wired) as machine:
        out.print(period_table(machine.phases.bound(), f"{station.name}: {_every(wired.period)}"))
    out.print("While it runs, clients are asked in COMMANDS; frames, the recorder and other observers are in SHOW.")
    return 0


def _every(period: float | None) -> str:
    return "no timer: a period begins with each `sample`" if period is None else f"every {duration(period)}"


def period_table(bound: dict[str, list[str]], title: str) -> Table:
    """The phases, with who is bound to each; one in which nobody acts is not called."""
    table = Table("call", "phase", "what it does", "an error in it", "here", title=title, title_justify="left")
    for call, each in groupby(PHASES, lambda phase: phase.call):
        phases = list(each)
        for phase in phases:
            acting, is_first, is_last = bound[phase.name], phase is phases[0], phase is phases[-1]
            cells = call if is_first else "", phase.name, phase.does, phase.error, _named(acting)
            table.add_row(*cells, style="" if acting else "dim", end_section=is_last)
    return table


def _named(acting: Sequence[str]) -> str:
    more = [f"{len(acting) - FEW:,} others"] if len(acting) > FEW + 1 else []
    return "\n".join([*(acting[:FEW] if more else acting), *more]) or "-"

"""`umo show period`: shows the phases of a station's period, and which parts act in each phase."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from itertools import groupby
from math import inf
from types import FunctionType, MethodType
from typing import Any

from rich.table import Table

from umo.cycle.columns import Block
from umo.cycle.laid_out import laid_out
from umo.cycle.machine import ConnectedMachine
from umo.cycle.period import PHASES
from umo.drivers.contract import Direction
from umo.drivers.wrapping import bare
from umo.duration import duration
from umo.errors import OptionError
from umo.process.station import Station
from umo.text import count_of
from umo.wiring import resolve
from umo_command.console import out
from umo_command.station_options import machine_and_words

MAX_NAMED_PARTS = 8
"""Maximum number of parts that are named for a phase."""


def show_period(station: Station, wiring: str | None, words: Sequence[str] = ()) -> int:
    """Print the phases of the period in their order. No device is opened. `words`: options of the machine."""
    root, paths = machine_and_words(station, words)
    if paths:
        raise OptionError(f"unexpected argument {paths[0]!r}: umo show period shows the whole machine")
    wired = resolve(root, station.wiring(wiring), to_run=False)
    with laid_out(root, wired) as machine:
        out.print(period_table(acting_in(machine), f"{station.name}: {_every(wired.period)}"))
    out.print(
        "While the machine runs, the phase COMMANDS also takes the commands of clients, and the phase SHOW also "
        "writes the frames, the recording and other observers."
    )
    return 0


def _every(period: float | None) -> str:
    return "no timer: a period begins with each `sample`" if period is None else f"every {duration(period)}"


def period_table(bound: dict[str, list[str]], title: str) -> Table:
    """Return the table of phases, with the parts bound to each. A phase without parts is not called."""
    table = Table("call", "phase", "what it does (where)", "if it fails", "here", title=title, title_justify="left")
    for call, each in groupby(PHASES, lambda phase: phase.call):
        phases = list(each)
        for phase in phases:
            acting, is_first, is_last = bound[phase.name], phase is phases[0], phase is phases[-1]
            cells = call if is_first else "", phase.name, f"{phase.does} ({phase.where})", phase.error, _named(acting)
            table.add_row(*cells, style="" if acting else "dim", end_section=is_last)
    return table


def acting_in(machine: ConnectedMachine) -> dict[str, list[str]]:
    """Return, for the name of each phase of a machine, the parts that act in this phase, as text."""
    period, whole, parts = machine.phases, machine.groups.whole, machine.groups.parts
    items, claims = machine.image.items, machine.claims
    asked = sum(not item.synchronous for item in items if item.direction is Direction.OUTPUT)
    expiring = sum(command.expires < inf for command in claims.by_slot.values())
    interlocks = len(claims.inhibitions)
    guards = [(interlocks, "interlock"), (expiring, "expiring command"), (asked, "asynchronous actuator")]
    return {
        "BEFORE TICK": [*map(_called, period.before_tick)],
        "TICK": ["the timer" if machine.image.timer >= 0 else "no timer: the wall clock"],
        "SEND LATE": ["the outputs of the period before"] if period.late else [],
        "RECEIVE": [*map(_called, period.receiving)],
        "SAMPLE": [_moved(block, "sensor") for block in whole.inputs],
        "GUARD": [count_of(number, noun) for number, noun in guards if number],
        "COMMANDS": [*map(_called, period.commanding)],
        "SEQUENCES": ["the application, actions, what these start"],
        "LAWS": [*map(_called, period.before_laws), *map(_acting, whole.laws)],
        "SETTLE": [*map(_called, period.settling)],
        "SEND": [*map(_called, period.before_send), *(_moved(block, "actuator") for block in whole.outputs)],
        "GROUPS": [f"{part.path}, every {count_of(part.every, 'period')}" for part in parts],
        "OWED": ["parts with rates of their own"] if parts else [],
        "SHOW": [*map(_called, period.showing), "events", *map(_called, period.observers)],
    }


def _called(call: Callable[..., object]) -> str:
    """Return the first sentence of the docstring of a function, or of the class to whose object a method belongs."""
    owner = getattr(call, "__self__", call)
    about = owner if isinstance(owner, FunctionType | type) else type(owner)
    return (inspect.getdoc(about) or about.__qualname__).partition(". ")[0].partition("\n")[0].rstrip(".")


def _moved(block: Block, kind: str) -> str:
    return f"{count_of(block.count, kind)} on {type(bare(block.driver)).__name__}"


def _acting(law: MethodType) -> str:
    owner: Any = law.__self__
    return f"{owner._path or 'the machine'} ({type(owner).__name__})"


def _named(acting: Sequence[str]) -> str:
    more = [f"{len(acting) - MAX_NAMED_PARTS:,} others"] if len(acting) > MAX_NAMED_PARTS + 1 else []
    return "\n".join([*(acting[:MAX_NAMED_PARTS] if more else acting), *more]) or "-"

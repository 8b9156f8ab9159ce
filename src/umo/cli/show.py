"""`umo check`."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from umo.errors import Fault
from umo.objects import actions_of, tunables_of
from umo.objects.interlock import interlocks_of
from umo.process.station import Station
from umo.wiring import check, resolve

from .console import err, out
from .station_options import machine_of


def check_station(station: Station, wiring: str | None, arguments: Sequence[str] = ()) -> int:
    """Print every fault and return 2, or one line on what is wired and return 0."""
    file = station.wiring(wiring)
    machine = machine_of(station, arguments)
    station.module("application")  # a wiring may be right and the application not import
    interlocks_of(machine)
    offered = [(len(actions_of(machine)), "action"), (len(tunables_of(machine)), "tunable number")]
    faults = check(machine, file)
    if reported(faults):
        return 2
    wired = resolve(machine, file)
    period = "no timer" if wired.period is None else f"period {wired.period * 1e3:g} ms"
    found = [
        f"{_count(len(wired.wires), 'object')} on {_count(len(wired.drivers), 'driver')}",
        period,
        *(_count(number, what) for number, what in offered if number),
    ]
    out.print(f"ok: {file or 'everything simulated'}: {', '.join(found)}", soft_wrap=True)
    return 0


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def reported(faults: list[Fault]) -> int:
    """Print every fault; how many there are."""
    for fault in faults:
        err.print(str(fault), soft_wrap=True)
    return len(faults)


def label(*words: tuple[str, str]) -> Text:
    """Words, each with its style, two blanks apart."""
    return Text("  ").join(Text(word, style) for word, style in words)

"""Facts of a run in words, for `umo ps`, `umo watch`, notebooks and the page."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import MappingProxyType

from umo.presentation.digits import digits_of, number_text
from umo.presentation.durations import duration, lasting
from umo.text import printable, time_of_day

IN_FAULT = "in fault"
"""Name of the fact that tells the equipment in fault."""
MAX_FAULTS = 3
"""Number of equipments in fault that are told at most."""
FREE = "free"
"""The lease that nobody has."""


def title(station: object, wiring: object) -> str:
    """Station and wiring."""
    return printable(f"{station} ({wiring})" if wiring else str(station))


def facts_of(
    state: object,
    mode: object | None = None,
    holder: str = "",
    progress: tuple[str, int, int] = ("", 0, 0),
    *,
    time: float | None = None,
    missed: int | None = None,
    period: float | None = None,
    faults: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Facts by name, in the order in which they are shown; empty: there is nothing to say. `holder` of the lease,
    `time` in s on the cycle's clock, `missed` periods, `period` in s, `faults`: the reasons of equipment in fault by
    its path."""
    text, done, total = progress
    return {
        "state": str(state),
        "mode": "" if mode is None else str(mode),
        "lease": "" if mode is None else printable(holder) or FREE,
        "progress": ", ".join(filter(None, [printable(text), f"{done} of {total}" if total else ""])),
        "time": "" if time is None else clock_text(time),
        "period": "" if period is None else duration(period),
        "missed": "" if missed is None else f"{missed:,}",
        IN_FAULT: _of_faults(faults),
    }


def _of_faults(faults: Mapping[str, str]) -> str:
    """The first few equipments in fault with their reasons, and the number of the others."""
    found = [printable(f"{path}: {reason}") for path, reason in faults.items()]
    more = [f"and {len(found) - MAX_FAULTS} more"] if len(found) > MAX_FAULTS else []
    return "; ".join(found[:MAX_FAULTS] + more)


def clock_text(seconds: float, period: float = 0.0) -> str:
    """A time on the cycle's clock: with ms, and the digits that tell periods of so many s apart."""
    return f"{number_text(seconds, max(3, digits_of(period) if period else 0))} s"


def since(started: float) -> str:
    """`09:14:03 (3 min)`, from the s since 1970."""
    return f"{time_of_day(started, '%H:%M:%S')} ({lasting(time.time() - started)})"

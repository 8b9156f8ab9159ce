"""Facts of a run as text, for `umo show stations`, `umo show values`, notebooks and the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from umo.digits import digits_of, number_text
from umo.duration import duration, lasting
from umo.objects.presentation.described import Described
from umo.text import others, printable, time_of_day

IN_FAULT = "in fault"
"""Name of the fact with the equipment in fault."""
ALARMS = "alarms"
"""Name of the fact with the alarms."""
MAX_FAULTS = 3
"""Largest number of faults of equipment that are listed."""
MAX_DRIVEN = 3
"""Number of actuators that are listed with their values; the others are counted."""
FREE = "free"
"""The text for a lease that nobody has."""


def title(station: object, wiring: object) -> str:
    """Return station and wiring as text."""
    return printable(f"{station} ({wiring})" if wiring else str(station))


def facts_of(
    state: object,
    mode: object | None = None,
    holder: str = "",
    progress: tuple[str, int, int] = ("", 0, 0),
    *,
    driven: str = "",
    time: float | None = None,
    missed: int | None = None,
    period: float | None = None,
    faults: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the facts by name, in the order in which they are shown; empty if there are none. `holder`: who has the
    lease. `driven`: the result of `driven_text`. `time` is in s on the cycle's clock, `missed` is a number of periods,
    `period` is in s. `faults`: the reasons of equipment in fault by its path."""
    text, done, total = progress
    return {
        "state": str(state),
        "mode": "" if mode is None else str(mode),
        "lease": "" if mode is None else printable(holder) or FREE,
        "driven": driven,
        "progress": ", ".join(filter(None, [printable(text), f"{done} of {total}" if total else ""])),
        "time": "" if time is None else clock_text(time),
        "period": "" if period is None else duration(period),
        "missed": "" if missed is None else f"{missed:,}",
        IN_FAULT: "; ".join(fault_texts(faults)),
    }


def fault_texts(faults: Mapping[str, str]) -> list[str]:
    """Return the first few faults of equipment with their reasons, and the number of the others."""
    found = [printable(f"{path}: {reason}") for path, reason in faults.items()]
    more = [f"and {len(found) - MAX_FAULTS} more"] if len(found) > MAX_FAULTS else []
    return found[:MAX_FAULTS] + more


def driven_text(actuators: Iterable[tuple[Described, float, bool]], holder: str) -> str:
    """Return the actuators that are away from their defaults in manual mode, and why: `spindle 240 rpm (its law), clamp
    ON (held, or its law)`. `actuators`: each object with its value, and whether a client has taken it."""
    found = [each for each in actuators if each[0].default is not None and each[1] != each[0].default]
    shown = found[:MAX_DRIVEN]
    texts = [f"{about.path} {about.text(value)} ({_cause(about, taken, holder)})" for about, value, taken in shown]
    more = len(found) - len(shown)
    return printable(", ".join(texts) + (f" and {others(more)}" if more else ""))


def _cause(about: Described, taken: bool, holder: str) -> str:
    """Return who or what keeps an actuator away from its default."""
    if taken:
        return f"client {holder}"
    if about.is_held:
        return "held, or its law"  # an object's description does not tell whether a law writes it
    return "its law or an action" if holder else "its law"


def clock_text(seconds: float, period: float = 0.0) -> str:
    """Format a time on the cycle's clock, with ms, or with the digits that distinguish periods of this length in s."""
    return f"{number_text(seconds, max(3, digits_of(period) if period else 0))} s"


def since(started: float, lasted: float | None) -> str:
    """Format a start time, such as `09:14:03 (3 min)`. `started` is in s since 1970. `lasted` is the elapsed time in s
    on a monotonic clock, because the computer's clock may have been set since the start; None if it is not known."""
    passed = "" if lasted is None else f" ({lasting(lasted)})"
    return f"{time_of_day(started, '%H:%M:%S')}{passed}"

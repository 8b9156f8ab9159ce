"""Functions that parse and format durations. A duration is a number of seconds, or a string such as "20 ms", "0.2
seconds", "1e-3 s"."""

from __future__ import annotations

import math
import re

from umo.digits import number_text
from umo.errors import DeclarationError

TIME_TOLERANCE = 1e-9
"""Tolerance in s when times are compared: the machine's time is a sum of periods, each with a rounding error."""
MAX_RUN = 1e10
"""Longest possible duration of a run in s: 300 years."""
_TEXT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_]+)\s*")
_PER_SECOND = {
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e9),
    **dict.fromkeys(("us", "µs", "μs", "microsecond", "microseconds"), 1e6),
    **dict.fromkeys(("ms", "millisecond", "milliseconds"), 1e3),
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
}
_SECONDS = {
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3_600.0),
    **dict.fromkeys(("d", "day", "days"), 86_400.0),
}


def seconds(duration: str | float) -> float:
    """Return a duration in s. Raises DeclarationError unless it is finite and not negative."""
    try:
        if isinstance(duration, bool):
            raise TypeError
        value = _of_text(duration) if isinstance(duration, str) else float(duration)
    except (TypeError, ValueError, OverflowError):
        raise DeclarationError(f'{duration!r} is not a duration; write for example "20 ms"') from None
    if not math.isfinite(value) or value < 0:
        raise DeclarationError(f"{duration!r} is not a duration: it must be finite and not negative")
    return value


def seconds_of_setting(duration: str | float) -> float:
    """Return the duration of a setting in s. A whole number from 1 on needs a unit, because `period = 50` could mean ms
    or s; 50.0 is in s. Raises DeclarationError, which names both."""
    found = seconds(duration)
    if found >= 1 and isinstance(duration, int):
        raise DeclarationError(f'{duration!r} has no unit: write "{duration} ms" or "{duration} s"')
    return found


def _of_text(text: str) -> float:
    match = _TEXT.fullmatch(text)
    if match is None or (unit := match[2]) not in (*_PER_SECOND, *_SECONDS):
        raise ValueError
    if unit in _SECONDS:
        return float(match[1]) * _SECONDS[unit]
    return float(match[1]) / _PER_SECOND[unit]  # 9 us: not 8.999999999999999e-06


def duration(seconds: float) -> str:
    """Format a duration with six significant digits: `250 µs`, `2.5 ms`, `90 s`."""
    size = abs(seconds)
    if size == 0 or size >= 1:
        return f"{number_text(seconds)} s"
    return f"{number_text(seconds * 1e3)} ms" if size >= 1e-3 else f"{number_text(seconds * 1e6)} µs"


def lasting(seconds: float) -> str:
    """Format the time that a run has lasted: `12 s`, `3 min`, `2 h 05 min`, `3 d 4 h`; `?` for an impossible time."""
    if not -MAX_RUN < seconds < MAX_RUN:
        return "?"
    minutes, hours, days = seconds / 60, seconds / 3600, seconds / 86400
    if minutes < 2:
        return f"{seconds:z.0f} s"
    if hours < 1:
        return f"{minutes:z.0f} min"
    if days < 2:
        return f"{int(hours)} h {int(minutes) % 60:02d} min"
    return f"{int(days)} d {int(hours) % 24} h"

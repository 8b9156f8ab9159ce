"""The one grammar of durations: a number of seconds, or a text such as "20 ms", "0.2 seconds", "1e-3 s"."""

from __future__ import annotations

import math
import re

from umo.errors import DeclarationError

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
    """A duration in s; finite and not negative. DeclarationError for anything else."""
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
    """The same of a setting: a whole number of 1 or more has a unit, as `period = 50` is in ms for one and in s for
    another; 50.0 is in s. DeclarationError with both."""
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

"""Times that have passed, or pass, as text."""

from __future__ import annotations

from umo.presentation.digits import number_text

MAX_RUN = 1e10
"""s that a run can have lasted: 300 years."""


def duration(seconds: float) -> str:
    """`250 µs`, `2.5 ms`, `90 s`: six significant digits."""
    size = abs(seconds)
    if size == 0 or size >= 1:
        return f"{number_text(seconds)} s"
    return f"{number_text(seconds * 1e3)} ms" if size >= 1e-3 else f"{number_text(seconds * 1e6)} µs"


def lasting(seconds: float) -> str:
    """`12 s`, `3 min`, `2 h 05 min`, `3 d 4 h`; `?` for what no run has lasted."""
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

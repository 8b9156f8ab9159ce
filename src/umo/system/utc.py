"""The difference between UTC and the monotonic clock on this computer, and its greatest error."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from time import monotonic_ns, time_ns
from typing import Any

UNKNOWN = -1
"""The value in place of an error in ns for a clock that is not synchronised, and for a platform that does not report an
error."""
UNSYNCHRONISED = 0x40
"""STA_UNSYNC of `status` (adjtimex(2))."""


class _Timex(ctypes.Structure):
    """The struct timex of adjtimex(2), up to `status`; the rest is reserved space."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def utc() -> tuple[int, int]:
    """Return the number of ns to add to CLOCK_MONOTONIC to get UTC since 1970, and the greatest error of the sum in ns
    according to the kernel; `UNKNOWN` if the kernel does not state the error."""
    before, now, after = monotonic_ns(), time_ns(), monotonic_ns()
    error = _error()
    return now - (before + after) // 2, error if error == UNKNOWN else error + (after - before + 1) // 2


def _error() -> int:
    adjtimex, asked = _adjtimex(), _Timex()
    if adjtimex is None or adjtimex(ctypes.byref(asked)) < 0 or asked.status & UNSYNCHRONISED:
        return UNKNOWN
    return int(asked.maxerror) * 1000


@cache
def _adjtimex() -> Any:
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "adjtimex", None)

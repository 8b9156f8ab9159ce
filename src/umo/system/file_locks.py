"""Locks of files (flock(2)), waited for within a limit: another process that holds one may be stopped."""

from __future__ import annotations

import time
from typing import IO

try:
    import fcntl
except ImportError:  # this platform has none
    fcntl = None  # type: ignore[assignment]

LOCK_PAUSE = 0.01
"""Time in s between two tries to lock a file."""


def lock_within(file: int | IO[bytes] | IO[str], within: float, *, shared: bool = False) -> bool:
    """Lock an open file; whether that was possible within some s. The kernel gives the lock back when the file is
    closed, or its process ends. OSError where it cannot be locked at all."""
    until = time.monotonic() + within
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    while True:
        try:
            fcntl.flock(file, kind | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if time.monotonic() >= until:
                return False
        time.sleep(LOCK_PAUSE)

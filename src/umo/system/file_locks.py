"""Locks of files (flock(2)) with a limit on the time to wait, because the process that holds a lock may be stopped."""

from __future__ import annotations

from typing import IO

from umo.system import calls

LOCK_PAUSE = 0.01
"""The time in s between two attempts to lock a file."""


def lock_within(file: int | IO[bytes] | IO[str], within: float, *, shared: bool = False) -> bool:
    """Lock an open file. Return True if this was possible within this time in s. The kernel releases the lock when the
    file is closed, or its process ends. Raises OSError if the file cannot be locked at all."""
    until = calls.now() + within
    while not calls.lock_file(file, shared=shared):
        if calls.now() >= until:
            return False
        calls.sleep(LOCK_PAUSE)
    return True

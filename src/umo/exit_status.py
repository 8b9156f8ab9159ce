"""The exit statuses of `umo` and of a run. A run that a signal has ended has 128 plus the number of the signal; 130 is
Ctrl-C."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    DONE = 0
    FAILED = 1
    """The machine, a device or code failed."""
    MISTAKE = 2
    """A mistake of the user: a wiring, a command line, a declaration."""
    UNREACHED = 3
    """An actuator is not at its default."""
    NOT_RECORDED = 4
    """The run is not recorded, or not as a whole; for `umo recording replay`: identical up to the end of the
    recording."""
    TIME_OVER = 124
    """A run has reached its time limit, as with timeout(1)."""

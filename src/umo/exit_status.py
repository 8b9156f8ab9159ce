"""The exit statuses of `umo` and of a run. The status of a run that a signal has ended is 128 plus the number of the
signal; 130 is Ctrl-C."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    DONE = 0
    FAILED = 1
    """The machine, a device or code failed."""
    MISTAKE = 2
    """The user has made an error in a wiring, a command line or a declaration."""
    UNREACHED = 3
    """An actuator is not at its default."""
    NOT_RECORDED = 4
    """The run is not recorded, or only in part. For `umo recording replay`: the replay is identical up to the end of
    the recording."""
    TIME_OVER = 124
    """A run has reached its time limit; timeout(1) has the same status."""

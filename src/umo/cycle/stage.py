"""The stages of a run."""

from __future__ import annotations

from enum import IntEnum


class Stage(IntEnum):
    """The stage of a run; the numbers stand in shared memory, so they keep their meaning."""

    STARTING = 0
    """Its drivers are being opened, its objects initialised."""
    RUNNING = 1
    """The loop runs."""
    STOPPING = 2
    """Its actuators are being brought to their defaults, its drivers closed."""
    ENDED = 3
    """The run has ended, or its processes have."""

    def __str__(self) -> str:
        return self.name.lower()

"""How far a machine has come, from its start to its end."""

from __future__ import annotations

from enum import IntEnum


class Stage(IntEnum):
    """What a machine is doing; the numbers stand in shared memory, so they keep their meaning."""

    STARTING = 0
    """Its drivers are being opened, its objects initialised."""
    RUNNING = 1
    """The loop runs."""
    STOPPING = 2
    """Its actuators are being brought to their defaults, its drivers closed."""
    ENDED = 3
    """All of that is over, or its processes are gone."""

    def __str__(self) -> str:
        return self.name.lower()

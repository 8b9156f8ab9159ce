"""How far a machine has come."""

from __future__ import annotations

from enum import IntEnum


class Stage(IntEnum):
    """The one lifecycle of a machine: of its processes, its frames, and for whoever started it."""

    STARTING = 0
    RUNNING = 1
    STOPPING = 2
    ENDED = 3

    def __str__(self) -> str:
        return self.name.lower()

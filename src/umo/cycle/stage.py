"""The stage of a run, and the progress of its work (`m.cycle.progress`)."""

from __future__ import annotations

from operator import index
from typing import NamedTuple

from umo.errors import RangeError
from umo.text import NamedNumber


class Stage(NamedNumber):
    """The stage of a run. The numbers are stored in shared memory and keep their meaning."""

    STARTING = 0
    """The drivers are being opened, and the objects are being initialised."""
    RUNNING = 1
    """The loop runs."""
    STOPPING = 2
    """The actuators are being brought to their defaults, and the drivers are being closed."""
    ENDED = 3
    """The run, or its processes, have ended."""


class Progress(NamedTuple):
    """The progress of the work: a text, and how much is done."""

    text: str = ""
    done: int = 0
    total: int = 0
    """The total amount of work; 0 if it is not known."""

    def then(self, text: str, done: int | None, total: int | None) -> Progress:
        """Return the next progress; a number that is None does not change. Raises RangeError unless the numbers are
        whole and not negative."""
        return Progress(
            str(text),
            self.done if done is None else _count("done", done),
            self.total if total is None else _count("total", total),
        )

    @property
    def share(self) -> float:
        """Share of the work that is done, from 0 to 1; 0 if the total is not known."""
        return min(self.done / self.total, 1.0) if self.total else 0.0


def _count(name: str, number: int) -> int:
    try:
        count = -1 if isinstance(number, bool) else index(number)
    except TypeError:
        count = -1
    if count < 0:
        raise RangeError(f"progress: {name}={number!r} is not a whole number from 0 on")
    return count

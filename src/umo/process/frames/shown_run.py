"""A run whose frames are shown one at a time, in any order: a recording at a chosen time, or a replay."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Any, Self

import numpy as np

from umo.cycle.stage import Stage
from umo.process.frames.layout import EVENTS, Layout
from umo.process.frames.run_reader import Frames, NumberedEvent, RunNow, RunReader


class ShownRun(RunReader):
    """A shown run, which counts as running until it is closed."""

    def __init__(self, layout: Layout, path: Path) -> None:
        self.layout, self.path = layout, path
        self._now = RunNow()
        self._numbers: Sequence[float] = ()
        self._told: Sequence[NumberedEvent] = ()
        self._shown: Frames = np.zeros(0, layout.dtype)
        """The frame that is shown, as an array of one."""
        self._unread = 0

    def show(self, frame: Frames, now: RunNow, tunables: Sequence[float], events: Sequence[NumberedEvent]) -> None:
        """Show an array of one frame. `events`: the events of the run up to now, in the order of their numbers."""
        self._shown, self._unread = frame.copy(), 1
        self._now, self._numbers, self._told = now, tunables, events[-EVENTS:]

    @property
    def state(self) -> Stage:
        return Stage.ENDED if self.closed else Stage.RUNNING

    def now(self) -> RunNow:
        return self._now

    def tunables(self) -> dict[str, float]:
        return {entry["path"]: value for entry, value in zip(self.layout.tunables, self._numbers, strict=False)}

    def latest(self) -> Any | None:
        return self._shown[-1] if len(self._shown) else None

    def read(self, most: int | None = None) -> Frames:
        """Return the shown frame, if it was not read yet. Frames that were replaced between two calls are not
        returned."""
        count = self._unread if most is None else min(most, self._unread)
        self._unread -= count
        return self._shown[:count]

    def events(self, start: int = 0) -> list[NumberedEvent]:
        return list(self._told[bisect_left(self._told, start, key=lambda each: each.number) :])

    def again(self) -> Self:
        other = copy(self)
        other.closed, other._unread = False, len(other._shown)
        return other

    def close(self) -> None:
        self.closed = True

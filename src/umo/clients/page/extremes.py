"""The smallest and largest values of a run's objects and signals, from a first frame on."""

from __future__ import annotations

from typing import Any

import numpy as np

from umo.objects import Quality
from umo.process.frames.run_reader import Frames

MEASURED = Quality.OUT_OF_RANGE
"""The worst quality of a value that counts as a measurement. A value that is held, unreferenced or was never read does
not count."""


class Extremes:
    """The extremes of the given numbers of objects and signals, objects first. NaN if there was no value."""

    def __init__(self, objects: int, signals: int) -> None:
        self.least = np.full(objects + signals, np.nan)
        self.greatest = self.least.copy()
        self.since: float | None = None
        """Time of the first frame, s on the cycle's clock, or None if there was none."""

    def add(self, frames: Frames) -> None:
        """Add frames, at least one."""
        if self.since is None:
            self.since = float(frames["time"][0])
        values = np.concatenate([frames["values"], frames["signals"]], axis=1)
        values[:, : frames["quality"].shape[1]][frames["quality"] > MEASURED] = np.nan
        values[np.isinf(values)] = np.nan
        self.least = np.fmin(self.least, np.fmin.reduce(values, axis=0))
        self.greatest = np.fmax(self.greatest, np.fmax.reduce(values, axis=0))

    def behind(self, first: Extremes) -> Extremes:
        """Return these extremes appended to others, as if both belonged to one machine."""
        both = Extremes(0, 0)
        both.least = np.concatenate([first.least, self.least])
        both.greatest = np.concatenate([first.greatest, self.greatest])
        both.since = first.since
        return both


class ExtremesNews:
    """Finds the changes of extremes that one page does not have yet. `id`: the number that the page has given to the
    subscription."""

    def __init__(self, id: int, extremes: Extremes) -> None:
        self.id = id
        self.extremes = extremes
        self._least = self._greatest = np.full(len(extremes.least), np.nan)
        self._full = True

    def next(self) -> dict[str, Any] | None:
        """Return a message with the extremes that have changed since the last message, by place, or None if none has
        changed."""
        least, greatest = self.extremes.least, self.extremes.greatest
        same = (least == self._least) & (greatest == self._greatest) | np.isnan(least)
        places = np.flatnonzero(~same).tolist()
        if not places and not self._full:
            return None
        told = {"type": "extremes", "id": self.id, "full": self._full, "since": self.extremes.since}
        self._least, self._greatest, self._full = least, greatest, False
        return told | {"values": {place: [least[place], greatest[place]] for place in places}}

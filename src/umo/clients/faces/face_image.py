"""The last values of all items of a machine, from its frames, and the changes for each face since that face's last
update."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from umo.clients.faces.face import Changes
from umo.errors import OptionError
from umo.objects import Quality
from umo.process.frames import RunReader
from umo.process.frames.machine_items import RUN_ITEMS, Declaration
from umo.recording.scope.history import last_good
from umo.text import did_you_mean
from umo.wiring.patterns import chosen

STATE_COLUMNS = ("equipment", "axes", "alarms")
NO_QUALITY = 255
"""The value that is stored while there is no quality."""
NO_BANDS: Mapping[str, float] = MappingProxyType({})


class FaceImage:
    """The last value, quality and time of every item. One look reads all new frames at once."""

    def __init__(self, reader: RunReader, machine: Declaration) -> None:
        count = len(machine.items)
        self._reader, self._objects = reader, len(reader.layout.objects)
        self.values = np.full(count, np.nan)
        self.quality = np.full(count, Quality.BAD, np.uint8)
        self.times = np.full(count, np.nan)
        self.period, self.utc = -1, float("nan")
        self.time = float("-inf")
        """Time of the last period, s on the cycle's clock."""
        self.utc_error: float | None = None

    def look(self) -> bool:
        """Read new frames. Return True if there were any."""
        frames = self._reader.read()
        if not len(frames):
            return False
        last = frames[-1]
        error = int(last["utc_error"])
        self.period, self.utc_error = int(last["number"]), None if error < 0 else error * 1e-9
        self.time = float(last["time"])
        self.utc = (int(last["began"]) + int(last["utc"])) / 1e9
        objects = self._objects
        np.concatenate((last["values"], last["signals"], self._others(last, frames)), out=self.values)
        none = np.isnan(last["values"]) & (last["quality"] < Quality.STALE)
        self.quality[:objects] = np.where(none, Quality.BAD, last["quality"])
        self.quality[objects:] = np.where(np.isnan(self.values[objects:]), Quality.BAD, Quality.GOOD)
        self._date(frames)
        return True

    def _others(self, last: Any, frames: Any) -> Any:
        """Return the values of tunable numbers, of states, and of the run."""
        now, wakes = self._reader.now(), frames["wake"]
        run = {
            "mode": -1 if now.mode is None else int(now.mode),
            "periods": self.period,
            "missed": now.missed,
            "execution": frames["execution"].max() * 1e-9,
            "wake": wakes.max() * 1e-9 if wakes.max() >= 0 else np.nan,
        }
        states = (last[name] for name in STATE_COLUMNS)
        return np.concatenate((list(self._reader.tunables().values()), *states, [run[name] for name in RUN_ITEMS]))

    def _date(self, frames: Any) -> None:
        """Record when the device returned each value. For a value that is STALE or BAD, this is the time of the last
        frame in which it was neither."""
        self.times[self._objects :] = self.utc
        found = last_good(frames, np.full(self._objects, np.nan))
        read = ~np.isnan(found)
        self.times[: self._objects][read] = self.utc + (found[read] - self.time)

    def grow_stale(self) -> None:
        """Mark all values as stale, because the machine is silent."""
        np.maximum(self.quality, np.uint8(Quality.STALE), out=self.quality)


class ChangeFilter:
    """Finds the changes for one face since its last update.

    A number has changed if it differs from the last sent one by more than its dead band. Changes of a state or a
    quality, and changes from or to no value, always count.
    """

    def __init__(self, image: FaceImage, machine: Declaration, dead_bands: Mapping[str, float] = NO_BANDS) -> None:
        """`dead_bands`: dead bands by path or pattern, in the unit of the item. Raises OptionError or PathError for a
        path or pattern that matches no number."""
        count = len(machine.items)
        self._image = image
        self._values, self._quality = np.full(count, np.nan), np.full(count, NO_QUALITY, np.uint8)
        self._bands = _bands(machine, dead_bands)

    def take(self) -> Changes | None:
        """Return the changes since the last call, or all values in the first call; None if nothing has changed."""
        image = self._image
        with np.errstate(invalid="ignore"):  # infinity less infinity
            changed = np.abs(image.values - self._values) > self._bands
        changed |= np.isnan(image.values) != np.isnan(self._values)
        changed |= image.quality != self._quality
        places = np.flatnonzero(changed)
        if image.period < 0 or not len(places):
            return None
        self._values[places], self._quality[places] = image.values[places], image.quality[places]
        copies = image.values.copy(), image.quality.copy(), image.times.copy()
        return Changes(image.period, image.utc, image.utc_error, places, *copies)


def _bands(machine: Declaration, given: Mapping[str, float]) -> Any:
    bands = np.zeros(len(machine.items))
    names = [item.name for item in machine.items]
    for pattern, band in given.items():
        numbers = [place for place in chosen(names, [pattern], machine.station) if not machine.items[place].states]
        if not numbers:
            known = [item.name for item in machine.items if not item.states]
            raise OptionError(f"dead band: {pattern!r} is not the path of a number{did_you_mean(pattern, known)}")
        bands[numbers] = band
    return bands

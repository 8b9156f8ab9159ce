"""Reads the values of chosen objects and signals from a recording, in a span of time, one block after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from umo.errors import RangeError
from umo.objects.quality import Quality
from umo.objects.scaling import FloatArray
from umo.process.frames.layout import Layout
from umo.process.frames.run_reader import Frames
from umo.recording.block import Block
from umo.recording.recording import Recording
from umo.recording.recording_file import utc_of
from umo.recording.scope.history import samples
from umo.wiring.patterns import chosen

OWN_NAMES = ("time", "utc", "number", "missed")
"""Names of the columns that are not values. If the path of an object or a signal equals one of them, its column is
named such as `time.value`."""
TellTime = Callable[[float], None]
"""Function that is called with the time in s on the machine's clock up to which work is done."""


class RecordedColumns(NamedTuple):
    """The columns of frames in a table, with a row for each frame. They are copies, so that the frames are not kept in
    memory."""

    time: FloatArray
    """Times of the frames in s on the machine's clock."""
    utc: Any
    """The UTC of the frames in ns since 1970, as <i8."""
    number: Any
    """Number of ticks since connecting."""
    missed: Any
    execution: FloatArray
    """Execution times in us."""
    values: FloatArray
    """A column for each chosen object and signal. A value is NaN if it was BAD, or if there is none."""
    quality: Any
    """A column for each chosen object."""


class RecordedPart(NamedTuple):
    """Consecutive frames of a block."""

    frames: Frames
    block: Block


class RecordedValues:
    """The chosen objects and signals of a recording. Raises PathError for an unknown path, and RangeError for times in
    the wrong order."""

    def __init__(
        self,
        recording: Recording,
        only: Sequence[str] = (),
        start: float | None = None,
        stop: float | None = None,
    ) -> None:
        """`only`: paths or patterns; default: all. `start`, `stop`: times in s on the machine's clock, `stop`
        excluded."""
        if start is not None and stop is not None and not start < stop:
            raise RangeError(f"the values from {start:g} s to {stop:g} s: the second time must be later")
        self.recording = recording
        self.layout: Layout = recording.layout
        self.start, self.stop = start, stop
        objects = len(self.layout.objects)
        known = self.layout.described.traced
        self.places = chosen([each.path for each in known], only, recording.path.name)
        """The places of the selected values among objects and signals."""
        self.entries = [known[place] for place in self.places]
        self.objects = [place for place in self.places if place < objects]
        """The places of the chosen objects."""
        self.bare = 0
        """Number of skipped periods. They are skipped because the file contains only the data that replay needs for
        them."""
        self.lost, self.damage = 0, list[str]()
        """Number of periods that are missing in the recording, and sentences on its damage (`look_for_damage`)."""

    def look_for_damage(self) -> None:
        """Find the missing periods and the damage. The whole recording is read once more for this, unless that was done
        before."""
        self.lost = self.recording.lost
        self.damage = self.recording.damage

    @property
    def paths(self) -> list[str]:
        return [each.path for each in self.entries]

    @property
    def names(self) -> list[str]:
        """The paths as names of columns. They differ from the names in `OWN_NAMES`."""
        return [f"{path}.value" if path in OWN_NAMES else path for path in self.paths]

    def parts(self) -> Iterator[RecordedPart]:
        """Return the frames that have values, in order."""
        self.bare = 0
        for block in self.recording.blocks(self.start, self.stop):
            frames = block.frames
            first = 0 if self.start is None else int(np.searchsorted(frames["time"], self.start))
            end = len(frames) if self.stop is None else int(np.searchsorted(frames["time"], self.stop))
            if first >= end:
                continue
            if block.is_full:
                yield RecordedPart(frames[first:end], block)
            else:
                self.bare += end - first

    @property
    def quality_names(self) -> list[str]:
        return [f"{path}.quality" for path in self.object_paths]

    @property
    def object_paths(self) -> list[str]:
        """The paths of the chosen objects."""
        return [self.layout.objects[place]["path"] for place in self.objects]

    def good(self, frames: Frames) -> FloatArray:
        """Return the values like `of`, with NaN also for each value that is not GOOD."""
        values = self.of(frames)
        for place in self.objects:
            values[frames["quality"][:, place] != Quality.GOOD, self.places.index(place)] = np.nan
        return values

    def columns(self, frames: Frames) -> RecordedColumns:
        """Return the columns of some frames that every export contains."""
        return RecordedColumns(
            frames["time"].copy(),
            utc_of(self.layout, frames),
            frames["number"].copy(),
            frames["missed"].copy(),
            frames["execution"] * 1e-3,
            self.of(frames),
            np.ascontiguousarray(frames["quality"][:, self.objects]),
        )

    def of(self, frames: Frames) -> FloatArray:
        """Return the values with a row for each frame, and a column for each chosen object and signal. A value is NaN
        if it was BAD, or if there is none."""
        return samples(frames)[:, self.places]

    @property
    def periods(self) -> int:
        """Number of the periods between the two times. They are counted without reading them, so up to one further
        block may be included at each end."""
        times, counts = self.recording.block_starts
        ends = np.append(times[1:], np.inf)
        low, high = -np.inf if self.start is None else self.start, np.inf if self.stop is None else self.stop
        return int(counts[(times < high) & (ends > low)].sum())

    def share(self, time: float) -> float:
        """Return the share of the span that lies before a time, from 0 to 1."""
        first, last = self.recording.span
        first = first if self.start is None else max(first, self.start)
        last = last if self.stop is None else min(last, self.stop)
        return min(max((time - first) / max(last - first, 1e-9), 0.0), 1.0)

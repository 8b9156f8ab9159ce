"""Reading the frames of a running station: copies of complete frames, and a count of lost frames."""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.stage import Stage
from umo.errors import FramesError, PathError
from umo.frames import folder
from umo.frames.layout import (
    CHECKSUM,
    DESCRIBED,
    DESCRIPTION,
    ENTRY,
    HEAD,
    HEADER,
    JOURNAL,
    MAGIC,
    MISSED,
    STATE,
    VERSION,
    Layout,
)
from umo.system import folders
from umo.text import did_you_mean

Frames = npt.NDArray[Any]
"""Copies of frames, oldest first: a structured array with the fields of `Layout.columns`."""
Entries = npt.NDArray[Any]
"""Copies of entries of the journal, in order: slot, kind (`umo.cycle.journal.Kind`), raw, and the raw before it."""


class Reader:
    """Reads one ring, or a file that holds one (a black box), from its oldest frame on.

    `read` returns every new frame, `latest` the last one. If the reader is too slow, frames are overwritten before
    they are read; `lost` counts them. The file is mapped read-only: a reader cannot disturb the writer.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            self._file = folders.open_own(self.path, follow=True)
        except OSError as error:
            raise FramesError(f"no frames at {self.path}: {error.strerror}") from None
        try:
            self._map = self._attach()
        except BaseException:
            os.close(self._file)
            raise
        self._live = memoryview(self._map)[:DESCRIPTION].cast("q")
        self.next = max(0, self.head - self.slots)
        """Number of the frame that is read next."""
        self.lost = 0
        self._index = {entry["path"]: i for i, entry in enumerate(self.layout.objects)}

    def _attach(self) -> mmap.mmap:
        length = os.fstat(self._file).st_size
        if length < DESCRIPTION:
            raise FramesError(f"{self.path} does not contain frames")
        mapped = mmap.mmap(self._file, length, access=mmap.ACCESS_READ)
        magic, version, self.flags, first, size, self.slots, journal, entries, described = HEADER.unpack_from(mapped)
        if magic != MAGIC:
            raise FramesError(f"{self.path} does not contain frames")
        if version != VERSION:
            raise FramesError(f"{self.path} has frames of version {version}, this umo reads version {VERSION}")
        ends = DESCRIPTION + described, first + self.slots * size, journal + entries * ENTRY.itemsize
        if not self.slots or ends[0] > first or ends[1] > journal or ends[2] > length:
            raise FramesError(f"{self.path} is truncated")
        description = mapped[DESCRIPTION : DESCRIPTION + described]
        if struct.unpack_from("<Q", mapped, DESCRIBED)[0] != zlib.crc32(description):
            raise FramesError(f"{self.path} is damaged")
        self.layout = Layout.parse(description)
        self._dtype = self.layout.dtype
        if self._dtype.itemsize != size:
            raise FramesError(f"{self.path}: frames of {size} bytes do not fit their description")
        self._checked = bool(self.flags & CHECKSUM)
        self._rows = np.frombuffer(mapped, np.uint8, self.slots * size, first).reshape(self.slots, size)
        self._journal: Entries = np.frombuffer(mapped, ENTRY, entries, journal)
        return mapped

    # What the ring says of itself ----------------------------------------------------------------------

    @property
    def about(self) -> dict[str, Any]:
        """Station, wiring, pid, when it started, the period in s."""
        return self.layout.about

    @property
    def paths(self) -> list[str]:
        """The objects' paths, in the order of a frame's values."""
        return list(self._index)

    @property
    def signals(self) -> list[str]:
        """The signals' paths, in the order of a frame's `signals`."""
        return [str(entry["path"]) for entry in self.layout.signals]

    @property
    def head(self) -> int:
        """Frames finished so far."""
        return int(self._live[HEAD // 8])

    @property
    def missed(self) -> int:
        """Missed periods so far."""
        return int(self._live[MISSED // 8])

    @property
    def state(self) -> Stage:
        """What the machine is doing; ENDED also if its processes are gone."""
        return Stage(self._live[STATE // 8]) if self.alive else Stage.ENDED

    @property
    def alive(self) -> bool:
        """Whether a process still keeps this ring going."""
        return folder.held(self._file)

    def index(self, path: str) -> int:
        """The index of an object in a frame's `values`; PathError with the nearest path otherwise."""
        if path not in self._index:
            raise PathError(f"no object {path!r}{did_you_mean(path, self._index)} in {self.about.get('station')}")
        return self._index[path]

    # Frames --------------------------------------------------------------------------------------------

    def read(self, most: int | None = None) -> Frames:
        """The frames finished since the last call (at most `most`), oldest first; those lost are counted."""
        head = self.head
        oldest = max(self.next, head - self.slots)
        stop = head if most is None else min(head, oldest + most)
        frames = self._copy(oldest, stop)
        self.lost += stop - self.next - len(frames)
        self.next = stop
        return frames

    def latest(self) -> Any | None:
        """The last finished frame, None where there is none. Leaves `next` and `lost` alone."""
        for count in (1, 2, self.slots):  # the very last may be being written over already
            frames = self.last(count)
            if len(frames):
                return frames[-1]
        return None

    def last(self, count: int) -> Frames:
        """Up to the last `count` frames. Leaves `next` and `lost` alone."""
        head = self.head
        return self._copy(max(0, head - min(count, self.slots)), head)

    def values(self, frame: Any) -> dict[str, float | str]:
        """The value of every object in a frame by path: a number in its unit, or the name of a state."""
        numbers = frame["values"].tolist()
        return {entry["path"]: _shown(entry, value) for entry, value in zip(self.layout.objects, numbers, strict=True)}

    # The journal ---------------------------------------------------------------------------------------

    def journal(self, frame: Any) -> Entries | None:
        """The journal of a frame's period: transfers of single objects, in order; None if it was overwritten."""
        first, count = int(frame["journal"]), int(frame["entries"])
        start, entries = self.entries(first, first + count)
        if start > first or (self._checked and count and zlib.crc32(entries.tobytes()) != frame["entries_checksum"]):
            return None
        return entries

    def entries(self, start: int, stop: int) -> tuple[int, Entries]:
        """The entries of these numbers that are still there, and the number of the first of them."""
        capacity = len(self._journal)
        begin = max(start, stop - capacity)
        entries = self._journal[np.arange(begin, stop) % max(capacity, 1)]
        oldest = int(self._live[JOURNAL // 8]) - capacity  # after the copy: those before it may be torn
        there = min(max(begin, oldest), stop)
        return there, entries[there - begin :]

    # Inside --------------------------------------------------------------------------------------------

    def _copy(self, start: int, stop: int) -> Frames:
        """Whole copies of those of the frames that are still there."""
        numbers = np.arange(start, max(start, stop), dtype=np.uint64)
        if not len(numbers):
            return np.zeros(0, self._dtype)
        begin, end = start % self.slots, (stop - 1) % self.slots + 1
        parts = [self._rows[begin:end]] if begin < end else [self._rows[begin:], self._rows[:end]]
        rows = np.concatenate(parts)  # as bytes: numpy would pack the fields of frames together
        frames = rows.view(self._dtype)[:, 0]
        ended = self._live[STATE // 8] == Stage.ENDED  # looked up before the head, which then stands
        oldest = self.head - self.slots - ended  # frame `oldest` may be being written over at this moment
        whole = (numbers.astype(np.int64) > oldest) & (frames["sequence"] == 2 * numbers + 2)
        if self._checked:
            whole &= np.array([self._sum(row) for row in rows], np.uint64) == frames["checksum"]
        return frames if whole.all() else frames[whole]

    def _sum(self, row: npt.NDArray[np.uint8]) -> int:
        return zlib.crc32(row[16 : self.layout.content].data, zlib.crc32(row[:8].data))

    def close(self) -> None:
        del self._rows, self._journal
        self._live.release()
        self._map.close()
        os.close(self._file)

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _shown(entry: dict[str, Any], value: float) -> float | str:
    if "one" in entry:
        return str(entry["one"] if value else entry["zero"])
    return value

"""Attaching to the frames of a running station: copies of whole frames, and a count of those that were lost."""

from __future__ import annotations

import mmap
import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.errors import FramesError, PathError
from umo.frames import folder
from umo.frames.layout import BEAT, CHECKSUM, DESCRIPTION, HEAD, HEADER, MAGIC, MISSED, STATE, VERSION, Layout
from umo.frames.ring import State
from umo.text import did_you_mean

Frames = npt.NDArray[Any]
"""Copies of frames, oldest first: a structured array with the fields of `Layout.columns`."""


class Reader:
    """Reads one ring, or a file that holds one (a black box), from its oldest frame on.

    `read` gives every new frame, `latest` the last one. A reader that is too slow is lapped: the frames that
    it could not get are counted in `lost`. It maps the file for reading only, so whatever becomes of it, the
    writer does not notice.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            self._file = os.open(self.path, os.O_RDONLY)
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
        status = os.fstat(self._file)
        if hasattr(os, "getuid") and status.st_uid != os.getuid():
            raise FramesError(f"{self.path} is another user's (uid {status.st_uid}); only that user may watch it")
        if status.st_size < DESCRIPTION:
            raise FramesError(f"{self.path} holds no frames")
        mapped = mmap.mmap(self._file, 0, access=mmap.ACCESS_READ)
        magic, version, flags, first, size, self.slots, described = HEADER.unpack_from(mapped)
        if magic != MAGIC:
            raise FramesError(f"{self.path} holds no frames")
        if version != VERSION:
            raise FramesError(f"{self.path} has frames of version {version}, this umo reads version {VERSION}")
        if not self.slots or first + self.slots * size > status.st_size or DESCRIPTION + described > first:
            raise FramesError(f"{self.path} is cut short")
        self.layout = Layout.parse(mapped[DESCRIPTION : DESCRIPTION + described])
        self._dtype = self.layout.dtype
        if self._dtype.itemsize != size:
            raise FramesError(f"{self.path}: frames of {size} bytes do not fit their description")
        self._checked = bool(flags & CHECKSUM)
        self._frames: Frames = np.frombuffer(mapped, self._dtype, self.slots, first)
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
    def head(self) -> int:
        """Frames finished so far."""
        return int(self._live[HEAD // 8])

    @property
    def missed(self) -> int:
        """Missed periods so far."""
        return int(self._live[MISSED // 8])

    @property
    def beat(self) -> int:
        """When the last frame was finished, ns of CLOCK_MONOTONIC; 0 before the first."""
        return int(self._live[BEAT // 8])

    @property
    def state(self) -> State:
        """What the machine is doing; ENDED also if its processes are gone."""
        state = State(self._live[STATE // 8])
        return state if self.alive else State.ENDED

    @property
    def alive(self) -> bool:
        """Whether a process still keeps this ring going."""
        return folder.held(self._file)

    def index(self, path: str) -> int:
        """Where an object stands in a frame's `values`; PathError with the nearest path otherwise."""
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
        """The last finished frame, None before the first. Leaves `next` and `lost` alone."""
        while (head := self.head) > 0:
            frames = self._copy(head - 1, head)
            if len(frames):
                return frames[0]
        return None

    def last(self, count: int) -> Frames:
        """Up to the last `count` frames. Leaves `next` and `lost` alone."""
        head = self.head
        return self._copy(max(0, head - min(count, self.slots)), head)

    def values(self, frame: Any) -> dict[str, float | str]:
        """The value of every object in a frame by path: a number in its unit, or the name of a state."""
        numbers = frame["values"].tolist()
        return {entry["path"]: _shown(entry, value) for entry, value in zip(self.layout.objects, numbers, strict=True)}

    def _copy(self, start: int, stop: int) -> Frames:
        """Whole copies of those of the frames that are still there."""
        if stop <= start:
            return self._frames[:0].copy()
        numbers = np.arange(start, stop, dtype=np.uint64)
        begin, end = start % self.slots, (stop - 1) % self.slots + 1
        if begin < end:
            frames = self._frames[begin:end].copy()
        else:
            frames = np.concatenate([self._frames[begin:], self._frames[:end]])
        oldest = self.head - self.slots  # frame `oldest` may be being written over at this moment
        whole = (numbers.astype(np.int64) > oldest) & (frames["sequence"] == 2 * numbers + 2)
        if self._checked:
            whole &= np.array([self._sum(frame) for frame in frames], np.uint64) == frames["checksum"]
        return frames if whole.all() else frames[whole]

    def _sum(self, frame: Any) -> int:
        return zlib.crc32(frame.tobytes()[16 : self.layout.content])

    def close(self) -> None:
        del self._frames
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

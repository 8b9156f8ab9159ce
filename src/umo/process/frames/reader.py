"""The reader of the frames of a running station. It returns copies of complete frames, and counts lost frames."""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from math import isfinite
from pathlib import Path
from typing import Any
from weakref import finalize

import numpy as np
import numpy.typing as npt

from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.objects import Quality
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.commands.client_commands import Mode
from umo.process.frames.frame_server import is_socket, receive
from umo.process.frames.layout import (
    CHECKSUM,
    DESCRIPTION,
    ENTRY,
    EVENT_BODY,
    EVENT_ROW,
    EVENTS,
    HEADER,
    LEASE_AT,
    LEASE_BYTES,
    MAGIC,
    VERSION,
    Layout,
    Live,
    Places,
    event_checksum,
)
from umo.process.frames.memory import RunDescriptors, mapped
from umo.process.frames.run_reader import Frames, NumberedEvent, RunNow, RunReader
from umo.system import folders
from umo.system.shared_cells import SharedText

Entries = npt.NDArray[Any]
"""Copies of entries of the journal (`umo.cycle.journal`): slot, `Kind`, `ErrorKind`, raw, raw before, time."""


LEASE_TRIES = 100
"""The number of attempts to read the lease while it changes."""
MAX_COUNT = 1 << 62
"""The largest count of frames, entries or events that counts as valid."""


STAGES, MODES, WORST = {int(each): each for each in Stage}, {int(each): each for each in Mode}, max(Quality)
FRAME_HEAD = struct.Struct("<QQqd")
"""Sequence, checksum, number and time of a frame."""


class Reader(RunReader):
    """The reader of one ring, or of a file that contains a ring (a black box), from the oldest frame on.

    `read` returns every new frame, `latest` the last one. If the reader is too slow, frames are overwritten before they
    are read; `lost` counts these frames. `path` is the socket of a running station (`rings`) or a file. For passed
    memory (`ends`, which the reader closes at its end) `path` is only a name. The memory of a run is sealed, and a file
    is read as a whole. Whatever other processes do to memory or file, the worst effect on a reader is a FramesError
    here, or fewer frames later.
    """

    def __init__(self, path: Path | str, ends: RunDescriptors | None = None) -> None:
        self.path = Path(path)
        self.ends = receive(self.path) if ends is None and is_socket(self.path) else ends
        """The descriptors of the shared memory; None for a file."""
        self._release = finalize(self, _close, self.ends)  # also if nobody closes it
        try:
            self._memory = _read(self.path) if self.ends is None else mapped(self.ends.frames)
            self._attach()
        except BaseException as error:
            self._release()
            if isinstance(error, ValueError | struct.error | MemoryError):  # of numpy and struct
                raise FramesError(f"{self.path} is damaged: {error}") from None
            raise
        self.closed = False
        self.next = max(0, self.head - self.slots)
        """Number of the frame that is read next."""

    def _attach(self) -> None:
        memory, length = self._memory, len(self._memory)
        if length < DESCRIPTION:
            raise FramesError(f"{self.path} does not contain frames")
        magic, version, self.flags, first, size, self.slots, journal, entries, described = HEADER.unpack_from(memory)
        if magic != MAGIC:
            raise FramesError(f"{self.path} does not contain frames")
        if version != VERSION:
            raise FramesError(f"{self.path} has frames of version {version}, this umo reads version {VERSION}")
        if not self.slots or DESCRIPTION + described > first or journal > length:
            raise FramesError(f"{self.path} is truncated")
        description = memory[DESCRIPTION : DESCRIPTION + described]
        if struct.unpack_from("<Q", memory, 8 * Live.DESCRIBED)[0] != zlib.crc32(description):
            raise FramesError(f"{self.path} is damaged")
        self.layout = Layout.parse(description)
        self._dtype = self.layout.dtype
        if self._dtype.itemsize != size:
            raise FramesError(f"{self.path}: frames of {size} bytes do not fit their description")
        self._places = places = Places.of(self.layout, first, self.slots, entries)
        if places.journal != journal or places.size > length:
            raise FramesError(f"{self.path} is truncated")
        self._checked = bool(self.flags & CHECKSUM)
        fields = self._dtype.fields
        assert fields is not None
        self._sizes = size, self.layout.content, fields["quality"][1], len(self.layout.objects)
        """The size of a frame and the number of its used bytes; the offset of its qualities and their number."""
        self._live = memoryview(memory)[:DESCRIPTION].cast("q")
        self._lease = SharedText(memory, LEASE_AT, LEASE_BYTES)
        self._rows = np.frombuffer(memory, np.uint8, self.slots * size, first).reshape(self.slots, size)
        self._journal: Entries = np.frombuffer(memory, ENTRY, entries, journal)
        self._events: Entries = np.frombuffer(memory, EVENT_ROW, EVENTS, places.events)

    def again(self) -> Reader:
        """Return another reader of the same ring, from its oldest frame on."""
        try:
            return Reader(self.path, None if self.ends is None else self.ends.again())
        except OSError as error:
            raise FramesError(f"there are no frames at {self.path}: {error.strerror}") from None

    # What the ring says of itself ----------------------------------------------------------------------

    @property
    def head(self) -> int:
        """Number of frames finished so far."""
        return self._count(Live.HEAD)

    @property
    def state(self) -> Stage:
        if not self.alive:
            return Stage.ENDED
        number = self._live[Live.STATE]
        return STAGES.get(number, Stage.RUNNING)

    def now(self) -> RunNow:
        lease, holder = self._lease_now()
        mode = MODES.get(self._live[Live.MODE])
        return RunNow(mode, lease, holder, self._count(Live.MISSED), self.head, self._count(Live.EVENT))

    def _lease_now(self) -> tuple[int, str]:
        for _ in range(LEASE_TRIES):
            if (found := self._lease.get()) is not None:
                return found[0], _text(found[1])
        return -1, ""

    @property
    def is_finished(self) -> bool:
        """True if the writer has finished the ring: no frame follows."""
        return bool(self._live[Live.STATE] == Stage.ENDED)

    @property
    def alive(self) -> bool:
        """True if the process that writes this ring still lives."""
        if self.ends is None:
            return False
        try:
            os.read(self.ends.alive, 1)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False

    @property
    def taken(self) -> int:
        """The number of commands from outside that the machine has taken from its queue."""
        return self._count(Live.TAKEN)

    @property
    def dropped(self) -> int:
        """Number of entries of the queue that were not commands."""
        return self._count(Live.DROPPED)

    def tunables(self) -> dict[str, float]:
        """Return the tunable numbers by path, each at most as many periods old as there are tunable numbers."""
        numbers = np.frombuffer(self._memory, "<f8", len(self.layout.tunables), self._places.tunables).tolist()
        return {entry["path"]: value for entry, value in zip(self.layout.tunables, numbers, strict=True)}

    def live_bytes(self, start: int, stop: int) -> bytes:
        """Return the live numbers as stored in the ring."""
        return self._memory[start:stop]

    def told_bytes(self) -> bytes:
        """Return the events and tunable numbers as stored in the ring."""
        return self._memory[self._places.events : self._places.size]

    # Frames --------------------------------------------------------------------------------------------

    def read(self, most: int | None = None) -> Frames:
        """Return the frames finished since the last call (at most `most`), oldest first. Lost frames are counted."""
        head = self.head
        self.next = min(self.next, head)  # it was damaged
        oldest = max(self.next, head - self.slots)
        stop = head if most is None else min(head, oldest + most)
        frames = self._copy(oldest, stop)
        self.lost += stop - self.next - len(frames)
        self.next = stop
        return frames

    def skip_older_half(self) -> None:
        """Continue with the newer half of the ring, because the older frames may be overwritten while they are read."""
        self.next = max(self.next, self.head - self.slots // 2)

    def latest(self) -> Any | None:
        """Return the last finished frame, or None. `next` and `lost` do not change."""
        for count in (1, 2, self.slots):  # the very last may be being written over already
            frames = self.last(count)
            if len(frames):
                return frames[-1]
        return None

    def last(self, count: int) -> Frames:
        """Return up to `count` of the last frames. `next` and `lost` do not change."""
        head = self.head
        return self._copy(max(0, head - min(count, self.slots)), head)

    def frame_bytes(self, number: int) -> bytes | None:
        """Return the bytes of a frame in the ring, or None if the frame was overwritten or is incomplete."""
        size, content, quality, count = self._sizes
        at = self._places.first + number % self.slots * size
        data = self._memory[at : at + size]
        ended = self.is_finished  # looked up before the head, which then stands
        sequence, checksum, _, moment = FRAME_HEAD.unpack_from(data)
        if sequence != 2 * number + 2 or number <= self.head - self.slots - ended or not isfinite(moment):
            return None
        if count and max(data[quality : quality + count]) > WORST:
            return None
        if self._checked and zlib.crc32(data[16:content], zlib.crc32(data[:8])) != checksum:
            return None
        return data

    def alarm_times(self) -> list[AlarmTimes]:
        rows, count = len(AlarmTimes._fields), len(self.layout.alarms)
        numbers = np.frombuffer(self._memory, "<f8", rows * count, self._places.alarms)
        return list(map(AlarmTimes, *numbers.reshape(rows, count).tolist()))

    # The journal ---------------------------------------------------------------------------------------

    def journal(self, frame: Any) -> Entries | None:
        """Return the journal of a frame's period, which has the transfers of single objects in order; None if it was
        overwritten."""
        first, count = int(frame["journal"]), int(frame["entries"])
        start, entries = self.entries(first, first + count)
        torn = self._checked and count and zlib.crc32(entries.tobytes()) != frame["entries_checksum"]
        return None if torn or (start, len(entries)) != (first, count) else entries

    def entries_of(self, frames: Frames) -> tuple[int, Entries]:
        """Return the entries of consecutive frames that are still complete, and the number of the first of them.
        Entries before an incomplete entry are left out."""
        last = frames[-1]
        there, entries = self.entries(int(frames["journal"][0]), int(last["journal"]) + int(last["entries"]))
        first = there
        for frame in frames if self._checked else ():
            begin, count = int(frame["journal"]), int(frame["entries"])
            own = entries[max(begin - there, 0) : max(begin - there, 0) + count]
            if begin >= there and count and zlib.crc32(own.tobytes()) != frame["entries_checksum"]:
                first = begin + count
        return first, entries[first - there :]

    def entries(self, start: int, stop: int) -> tuple[int, Entries]:
        """Return the entries with these numbers that are still available, and the number of the first of them."""
        if not 0 <= start <= stop <= MAX_COUNT:  # of a damaged frame
            return max(start, stop), self._journal[:0]
        capacity = len(self._journal)
        begin = max(start, stop - capacity)
        entries = self._journal[np.arange(begin, stop) % max(capacity, 1)]
        oldest = self._count(Live.JOURNAL) - capacity  # after the copy: those before it may be torn
        there = min(max(begin, oldest), stop)
        return there, entries[there - begin :]

    # Events --------------------------------------------------------------------------------------------

    def events(self, start: int = 0) -> list[NumberedEvent]:
        stop = self._count(Live.EVENT)
        numbers = np.arange(max(start, stop - EVENTS, 0), stop)
        rows = self._events[numbers % EVENTS]
        whole = self._events["sequence"][numbers % EVENTS] == numbers + 1  # after the copy
        if self._checked:
            whole &= np.array([_is_whole(row) for row in rows], bool)
        whole &= (rows["sequence"] == numbers + 1) & np.isfinite(rows["time"]) & (rows["state"] <= max(CommandState))
        return [
            NumberedEvent(int(number), Event(
                float(row["time"]), _text(row["path"]), _text(row["text"]), _text(row["who"]), int(row["command"]),
                CommandState(int(row["state"])), _text(row["asked"]),
            ))
            for number, row in zip(numbers[whole], rows[whole], strict=True)
        ]  # fmt: skip

    # Inside --------------------------------------------------------------------------------------------

    def _count(self, place: int) -> int:
        """Return a live number that counts, limited to valid values in case it is damaged."""
        return min(max(int(self._live[place]), 0), MAX_COUNT)

    def _copy(self, start: int, stop: int) -> Frames:
        """Return copies of those frames that are still available and complete."""
        numbers = np.arange(start, max(start, stop), dtype=np.uint64)
        if not len(numbers):
            return np.zeros(0, self._dtype)
        begin, end = start % self.slots, (stop - 1) % self.slots + 1
        parts = [self._rows[begin:end]] if begin < end else [self._rows[begin:], self._rows[:end]]
        return self._whole(np.concatenate(parts), numbers)

    def _whole(self, rows: npt.NDArray[np.uint8], numbers: npt.NDArray[np.uint64]) -> Frames:
        """Return the complete frames, copied as bytes (numpy would pack their fields together)."""
        frames = np.ndarray(len(rows), self._dtype, rows)
        ended = self._live[Live.STATE] == Stage.ENDED  # looked up before the head, which then stands
        oldest = self.head - self.slots - ended  # frame `oldest` may be being written over at this moment
        whole = (numbers.astype(np.int64) > oldest) & (frames["sequence"] == 2 * numbers + 2)
        whole &= np.isfinite(frames["time"]) & (frames["quality"] <= WORST).all(axis=1)
        if self._checked:
            content = self.layout.content
            sums = [zlib.crc32(row[16:content].data, zlib.crc32(row[:8].data)) for row in rows]
            whole &= np.array(sums, np.uint64) == frames["checksum"]
        return frames if whole.all() else frames[whole]

    def close(self) -> None:
        if self.closed:
            return
        self.closed = True
        del self._rows, self._journal, self._events
        self._live.release()
        if isinstance(self._memory, mmap.mmap):
            self._memory.close()
        self._release()
        self.ends = None


def _is_whole(row: Any) -> bool:
    """Return True if the copy of an event's row is complete, by its checksum."""
    return bool(row["checksum"] == event_checksum(int(row["sequence"]), row.tobytes()[EVENT_BODY:]))


def _close(ends: RunDescriptors | None) -> None:
    if ends is not None:
        ends.close()


def _read(path: Path) -> bytes:
    try:
        file = folders.open_own(path, follow=True)
    except OSError as error:
        raise FramesError(f"there are no frames at {path}: {error.strerror}") from None
    with os.fdopen(file, "rb") as stream:
        return stream.read()


def _text(data: bytes) -> str:
    return data.decode(errors="replace")

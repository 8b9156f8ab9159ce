"""The recorder of one run. It follows the frames of the run, and writes them once per second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Protocol

import numpy as np

from umo.cycle.events import CommandState
from umo.process.frames import Reader
from umo.process.frames.run_reader import NumberedEvent
from umo.recording.black_boxes import BlackBoxes
from umo.recording.block import Block
from umo.recording.recording_file import CHUNK_TIME
from umo.recording.ring_collector import Collector, joined

WRITE_PAUSE = 1.0
"""Time in s between two writes for a run in virtual time, and for a run in real time that has no complete second of
frames yet."""
MAX_PENDING = 16 << 20
"""Size in bytes of unwritten frames from which on they are always written."""
MAX_WAITING = 256 << 20
"""Largest number of bytes of frames that are held while the disk is slow. Further frames are lost."""
LONGEST_PAUSE, SHORTEST_PAUSE = 0.05, 0.002
"""Longest and shortest time in s between two readings of the queue of commands."""
LONGEST_COLLECTION = 0.25
"""Longest time in s between two readings of the frames."""
UNKNOWN_END = "it ended without a report"
"""The reason for a failed run without a last event."""
SHARE_OF_RING = 0.2
"""Largest share of a ring that may be filled between two readings."""


class Target(Protocol):
    """Accepts blocks. Raises OSError if it cannot store them."""

    def add(self, blocks: Sequence[Block]) -> None:
        """Write the blocks immediately."""


class Recorder:
    """Copies all data in a ring to a target."""

    def __init__(
        self,
        reader: Reader,
        target: Target,
        clock: Callable[[], float] = time.monotonic,
        thread: ThreadPoolExecutor | None = None,
    ) -> None:
        """`thread`: a thread that writes, so that no frames are lost on a slow disk, or None to write at once."""
        self._reader, self._target, self._clock, self._thread = reader, target, clock, thread
        self._writing: Future[None] | None = None
        self._collector, self._boxes = Collector(reader), BlackBoxes(reader.layout)
        self._pending: list[Block] = []
        self._next_write = clock() + WRITE_PAUSE
        self.first: int | None = None
        """Number of the first frame that was recorded, or None if none was."""
        self.periods = 0
        """Number of frames that were recorded."""
        self.lost = 0
        """Number of frames that were overwritten before they were read."""
        self.entries_lost = self.commands_lost = self.events_lost = 0
        self.end: NumberedEvent | None = None
        """The last event of the run, or None if it has not been read yet."""
        self._period, slots = float(reader.about.get("period") or 0.001), reader.slots
        share = SHARE_OF_RING * slots * self._period
        self.pause: float = min(max(share, SHORTEST_PAUSE), LONGEST_PAUSE)
        """Time in s between two looks."""
        self._collection = min(max(share, SHORTEST_PAUSE), LONGEST_COLLECTION)
        self._next_collection = 0.0

    @property
    def has_ended(self) -> bool:
        """True if no further frame follows. Read this before calling `look`."""
        return self._reader.is_finished or not self._reader.alive

    @property
    def failed(self) -> bool:
        """True if the run is over, and has failed or has no last event."""
        return self.has_ended and (self.end is None or self.end.event.state is CommandState.FAILED)

    def look(self) -> None:
        """Read new frames, and write them if that is due. Raises OSError if they cannot be written."""
        now = self._clock()
        if self._thread is not None and now < self._next_collection:
            self._collector.copy()
            return
        self._next_collection = now + self._collection
        self._collect()
        size = sum(block.frames.nbytes for block in self._pending)
        if len(self._pending) > 1 and (self._is_due(now) or size >= MAX_PENDING) and self._is_free(size):
            self._next_write = now + WRITE_PAUSE
            self._write(self._taken())

    def _is_due(self, now: float) -> bool:
        """True if it is time to write. With a thread, that is when a whole second of frames, which becomes a chunk, is
        ready."""
        if self._thread is None:
            return now >= self._next_write
        return self._seconds_of(self._pending) >= 1 or now >= self._next_write + WRITE_PAUSE

    def _seconds_of(self, blocks: Sequence[Block]) -> int:
        """Return the number of whole seconds of the run's time that blocks contain."""
        span = float(blocks[-1].frames["time"][-1] - blocks[0].frames["time"][0])
        return int((span + self._period / 2) // CHUNK_TIME)

    def _taken(self) -> list[Block]:
        """Remove from the pending blocks those to write now, and return them: whole seconds if there are any. At least
        one block always remains, because events after the last frame are added to it."""
        blocks, taken = self._pending, list[Block]()
        seconds = 0 if self._thread is None else self._seconds_of(blocks)
        if seconds < 1:
            self._pending = blocks[-1:]
            return blocks[:-1]
        stop, self._pending = blocks[0].frames["time"][0] + seconds * CHUNK_TIME - self._period / 2, []
        for block in blocks:
            row = int(np.searchsorted(block.frames["time"], stop))
            if 0 < row < len(block.frames):
                first, block = block.split(row)
                taken.append(first)
                row = 0
            (taken if row else self._pending).append(block)
        if not self._pending:
            self._pending = [taken.pop()]
        return taken

    def _is_free(self, size: int) -> bool:
        """True if the last write has ended. If `MAX_WAITING` bytes are held, wait for its end. Raises OSError if the
        write failed."""
        if self._writing is not None and (self._writing.done() or size >= MAX_WAITING):
            self._settle()
        return self._writing is None

    def _settle(self) -> None:
        if self._writing is not None:
            writing, self._writing = self._writing, None
            writing.result()

    def _collect(self) -> None:
        for block in self._collector.look():
            self._note(block)
            self._pending.append(block)

    def finish(self) -> None:
        """Read and write the remaining data. Raises OSError if they cannot be written."""
        self._collect()
        self._settle()
        if self._pending:
            last = self._pending[-1]
            rest = self._noted(self._collector.rest())
            lost = self._collector.lost_events()
            self.events_lost += lost
            last = replace(last, events=[*last.events, *rest], events_lost=last.events_lost + lost)
            self._write([*self._pending[:-1], last], self._reason)
            self._pending = []
            self._settle()

    @property
    def _reason(self) -> str:
        """Return why the run has failed; empty if it has not."""
        if not self.failed:
            return ""
        return UNKNOWN_END if self.end is None else self.end.event.text

    def _note(self, block: Block) -> None:
        if self.first is None:
            self.first = block.first
        self.lost += block.lost
        self.entries_lost += block.entries_lost
        self.commands_lost += block.commands_lost
        self.events_lost += block.events_lost
        self._noted(block.events)

    def _noted(self, events: list[NumberedEvent]) -> list[NumberedEvent]:
        self.end = next((each for each in reversed(events) if each.event.is_end), self.end)
        return events

    def _write(self, blocks: list[Block], end: str = "") -> None:
        """Write blocks, in the thread if there is one. `end`: the reason why the run failed, if these are its last
        blocks; otherwise ""."""
        if not blocks:
            return
        if self._thread is None:
            self._add(blocks, end)
        else:
            self._writing = self._thread.submit(self._add, blocks, end)

    def _add(self, blocks: list[Block], end: str) -> None:
        self._target.add(self._boxes.added(joined(blocks), end))
        self.periods += sum(len(block.frames) for block in blocks)

    def close(self) -> None:
        self._collector.close()

"""Reads the heads of all blocks of a recording once, and stores them compactly."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from sys import getsizeof
from typing import Any, NamedTuple

from umo.errors import FramesError
from umo.process.frames.run_reader import NumberedEvent
from umo.recording.block import BlackBox, boxes_of, events_lost_of, events_of
from umo.recording.chunk_order import MAX_FIRST

MAX_BLOCKS = 3_000_000
"""Largest number of blocks of a recording, one per second for a month."""
MAX_KEPT = 32 << 20
"""Approximate bytes of events, and of black boxes, that are kept in memory. Beyond them events are read again, and only
the last black boxes are kept."""
OVERHEAD = 1 << 10
"""Number of bytes that are added to the size of the strings of each event or black box when `MAX_KEPT` is checked."""


class BlockHead(NamedTuple):
    """The head of a block, without its columns."""

    first: int
    periods: int
    time: float
    about: Mapping[str, Any]
    size: int
    """Number of bytes of the block's description."""

    @classmethod
    def of(cls, about: Mapping[str, Any], size: int) -> BlockHead:
        head = cls(int(about["first"]), int(about["count"]), float(about["time"]), about, size)
        if not 0 <= head.first < MAX_FIRST or not 0 < head.periods < 1 << 32:
            raise ValueError("the recording has no periods")
        return head

    @property
    def events(self) -> list[NumberedEvent]:
        return events_of(self.about)

    @property
    def boxes(self) -> list[BlackBox]:
        return boxes_of(self.about)


@dataclass
class FileScan:
    """The results of scanning one file."""

    blocks: int = 0
    periods: int = 0
    time: float = 0.0
    """Time in s of the first frame of the file's last block."""


@dataclass
class RecordingScan:
    """The heads of all blocks in order."""

    firsts: array[int] = field(default_factory=lambda: array("q"))
    """Number of the first frame of each block."""
    counts: array[int] = field(default_factory=lambda: array("q"))
    """Number of frames of each block."""
    times: array[float] = field(default_factory=lambda: array("d"))
    """Time in s of the first frame of each block."""
    files: dict[Path, FileScan] = field(default_factory=dict)
    is_exact: bool = True
    """True if no entry of a journal, no command and no event was lost during the recording."""
    commands: int = 0
    events: int = 0
    """Number of events."""
    events_lost: int = 0
    """Number of events that were overwritten before they were recorded."""
    end: NumberedEvent | None = None
    """The last event, which reports the end of the run."""
    kept_events: list[NumberedEvent] | None = field(default_factory=list)
    """The events, or None if there are too many to be kept in memory."""
    boxes: int = 0
    """Number of black boxes."""
    kept_boxes: deque[BlackBox] = field(default_factory=deque)
    """The last black boxes."""
    _events_size: int = 0
    _boxes_size: int = 0

    def add(self, head: BlockHead, path: Path) -> None:
        if len(self.firsts) >= MAX_BLOCKS:
            raise FramesError(f"{path}: a recording with more than {MAX_BLOCKS:,} blocks is not read")
        self.firsts.append(head.first)
        self.counts.append(head.periods)
        self.times.append(head.time)
        file = self.files.setdefault(path, FileScan())
        file.blocks, file.periods, file.time = file.blocks + 1, file.periods + head.periods, head.time
        self.is_exact = self.is_exact and not head.about["entries_lost"] and not head.about["commands_lost"]
        self.events_lost += events_lost_of(head.about)
        self.is_exact = self.is_exact and not self.events_lost
        self.commands += len(head.about["commands"])
        events, boxes = head.events, head.boxes
        self.events += len(events)
        self.end = next((each for each in reversed(events) if each.event.is_end), self.end)
        self.boxes += len(boxes)
        self._keep_events(events)
        self._keep_boxes(boxes)

    def _keep_events(self, events: list[NumberedEvent]) -> None:
        self._events_size += sum(_size(each.event.text, each.event.path, each.event.who) for each in events)
        if self._events_size > MAX_KEPT:
            self.kept_events = None
        if self.kept_events is not None:
            self.kept_events += events

    def _keep_boxes(self, boxes: list[BlackBox]) -> None:
        self.kept_boxes += boxes
        self._boxes_size += sum(_size(each.text, each.reason) for each in boxes)
        while self._boxes_size > MAX_KEPT and len(self.kept_boxes) > 1:
            oldest = self.kept_boxes.popleft()
            self._boxes_size -= _size(oldest.text, oldest.reason)

    @property
    def first(self) -> int | None:
        return self.firsts[0] if self.firsts else None

    @property
    def stop(self) -> int | None:
        """Number of the frame that follows the last one."""
        return self.firsts[-1] + self.counts[-1] if self.firsts else None

    @property
    def periods(self) -> int:
        return sum(file.periods for file in self.files.values())

    def gaps(self, expected: int | None) -> Iterator[tuple[int, int]]:
        """Yield each gap as the number of its first missing frame and the number of missing frames. `expected`: the
        number that the first frame should have, or None if no frame is missing before the first one."""
        for first, count in zip(self.firsts, self.counts, strict=True):
            if expected is not None and first > expected:
                yield expected, first - expected
            expected = first + count


def _size(*texts: object) -> int:
    """Return the approximate memory in bytes of an object with these texts. In a malformed object they may be other
    values than texts."""
    return OVERHEAD + sum(getsizeof(each) for each in texts)

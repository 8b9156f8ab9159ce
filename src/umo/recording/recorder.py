"""The recorder of one run: follows its frames, and writes them once a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from umo.cycle.events import CommandState
from umo.frames import Reader
from umo.frames.reader import NumberedEvent
from umo.recording.block import Block
from umo.recording.collecting import Collector, joined

WRITE_PAUSE = 1.0
"""s between two writes."""
MAX_PENDING = 16 << 20
"""Bytes of frames that are collected at most before they are written."""
LONGEST_PAUSE, SHORTEST_PAUSE = 0.05, 0.002
"""s between two looks."""
SHARE_OF_RING = 0.2
"""Share of a ring that is filled between two looks, at most."""


class Target(Protocol):
    """Takes blocks; OSError where it cannot."""

    def add(self, blocks: Sequence[Block]) -> None:
        """Write them at once."""


class Recorder:
    """Copies everything that a ring shows to a target."""

    def __init__(self, reader: Reader, target: Target, clock: Callable[[], float] = time.monotonic) -> None:
        self._reader, self._target, self._clock = reader, target, clock
        self._collector = Collector(reader)
        self._pending: list[Block] = []
        self._next_write = clock() + WRITE_PAUSE
        self.first: int | None = None
        """Number of the first frame that was recorded; None: none was."""
        self.periods = 0
        """Number of frames that were recorded."""
        self.lost = 0
        """Number of frames that were written over before they were read."""
        self.entries_lost = self.commands_lost = 0
        self.end: NumberedEvent | None = None
        """The last event of the run, once it was told."""
        period, slots = float(reader.about.get("period") or 0.001), reader.slots
        self.pause = min(max(SHARE_OF_RING * slots * period, SHORTEST_PAUSE), LONGEST_PAUSE)
        """s between two looks."""

    @property
    def has_ended(self) -> bool:
        """Whether no frame follows. To be asked before a look."""
        return self._reader.is_finished or not self._reader.alive

    @property
    def failed(self) -> bool:
        """Whether the run, which is over, has failed, or could not tell its end."""
        return self.end is None or self.end.event.state is CommandState.FAILED

    def look(self) -> None:
        """Take what is new; write it if it is time. OSError where it cannot be written."""
        for block in self._collector.look():
            self._note(block)
            self._pending.append(block)
        size = sum(block.frames.nbytes for block in self._pending)
        if self._pending and (self._clock() >= self._next_write or size >= MAX_PENDING):
            self._next_write = self._clock() + WRITE_PAUSE
            self._write(self._pending[:-1])  # events that are told after the last frame belong to it
            self._pending = self._pending[-1:]

    def finish(self) -> None:
        """Take and write the rest. OSError where it cannot be written."""
        self.look()
        if self._pending:
            last = self._pending[-1]
            last = replace(last, events=[*last.events, *self._noted(self._collector.rest())])
            self._write([*self._pending[:-1], last])
            self._pending = []

    def _note(self, block: Block) -> None:
        if self.first is None:
            self.first = block.first
        self.periods += len(block.frames)
        self.lost += block.lost
        self.entries_lost += block.entries_lost
        self.commands_lost += block.commands_lost
        self._noted(block.events)

    def _noted(self, events: list[NumberedEvent]) -> list[NumberedEvent]:
        self.end = next((each for each in reversed(events) if each.event.is_end), self.end)
        return events

    def _write(self, blocks: list[Block]) -> None:
        if blocks:
            self._target.add(joined(blocks))

    def close(self) -> None:
        self._collector.close()

"""Collects the contents of a ring into blocks: frames, the entries of their journal, commands of clients, events."""

from __future__ import annotations

import zlib
from contextlib import suppress
from typing import Any

import numpy as np

from umo.errors import FramesError
from umo.process.frames import Reader
from umo.process.frames.client_memory import QUEUE, SLOT, SLOTS, ClientMemory
from umo.process.frames.command_queue import command_in
from umo.process.frames.reader import Entries
from umo.process.frames.run_reader import Frames, NumberedEvent
from umo.recording.block import Block, TakenCommand

MAX_ENTRIES = 1 << 16
"""Largest number of entries of a frame's journal that are read. The limit protects against a damaged frame that states
a larger number of entries."""


class Collector:
    """Follows a ring, from its oldest frame on. It never waits."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._cells: ClientMemory | None = None
        if reader.ends is not None:
            with suppress(FramesError):  # a ring of another computer has none
                self._cells = ClientMemory(reader.ends.cells, reader.layout)
        self._copied: dict[int, bytes] = {}
        """The commands that were copied from the queue, by number."""
        self._seen = 0
        """Number of the last command that was looked at in the queue."""
        self._taken: int | None = None
        """Number of the last command whose period is known; None before the first frame."""
        self._stop: int | None = None
        """Number of the frame that follows the last read one; None before the first frame."""
        self._events: list[NumberedEvent] = []
        """The events that were copied, and belong to no block yet."""
        self._event = 0
        """Number of the next event."""
        self.events_lost = 0
        """Number of earlier events that were overwritten before they were copied, and belong to no block."""
        self._tunables = 0

    def look(self) -> list[Block]:
        """Return the new frames as blocks, each of a few frames."""
        self.copy()
        frames = self._reader.read()
        if not len(frames):
            return []
        self.copy()
        breaks = np.flatnonzero(np.diff(frames["sequence"]) != 2) + 1
        parts = [frames] if not len(breaks) else np.split(frames, breaks)
        return [self._block(part) for part in parts]

    def rest(self) -> list[NumberedEvent]:
        """Return the events after the last block."""
        self._copy_events()
        events, self._events = self._events, []
        return events

    def copy(self) -> None:
        """Copy new commands and events before they are overwritten."""
        self.copy_commands()
        self._copy_events()

    def _copy_events(self) -> None:
        stop = self._reader.now().next_event
        if stop <= self._event:
            return
        events = self._reader.events(self._event)  # some of them may have been told meanwhile
        stop = max(stop, events[-1].number + 1) if events else stop
        self.events_lost += stop - self._event - len(events)
        self._events += events
        self._event = stop

    def lost_events(self, is_begun_late: bool = False) -> int:
        """Return the number of events that are missing since the last block. Events before the start of a recording
        that began late do not count."""
        lost, self.events_lost = self.events_lost, 0
        return 0 if is_begun_late else lost

    def _block(self, frames: Frames) -> Block:
        first = int(frames["sequence"][0]) // 2 - 1
        lost = 0 if self._stop is None else first - self._stop
        is_begun_late = self._stop is None and first > 0
        self._stop = first + len(frames)
        entries, entries_lost = self._entries(frames)
        commands, commands_lost = self._commands(frames, first, lost)
        events, live = self.rest(), self._live()
        events_lost = self.lost_events(is_begun_late)
        return Block(
            frames, entries, commands, lost, entries_lost, commands_lost, events, live, events_lost=events_lost
        )

    def _entries(self, frames: Frames) -> tuple[Entries, int]:
        there, entries = self._reader.entries_of(frames)
        return entries, there - int(frames["journal"][0])

    def _live(self) -> dict[str, Any]:
        """Return the mode, the holder of the lease, and, if they have changed, the tunable numbers."""
        now, tunables = self._reader.now(), self._reader.tunables()
        live: dict[str, Any] = {"mode": None if now.mode is None else int(now.mode), "holder": now.holder}
        digest = zlib.crc32(np.array(list(tunables.values())).tobytes())
        if tunables and digest != self._tunables:
            self._tunables = digest
            live["tunables"] = list(tunables.values())
        return live

    # Commands ------------------------------------------------------------------------------------------

    def copy_commands(self) -> None:
        """Copy the new commands of the queue, taken or not, before clients overwrite them. This takes microseconds."""
        if self._cells is None:
            return
        head = int(self._cells.head[0])
        if not self._seen < head < 1 << 62:
            return
        for number in range(max(self._seen, head - SLOTS) + 1, head + 1):
            at = QUEUE + (number - 1) % SLOTS * SLOT
            text = command_in(bytes(self._cells.memory[at : at + SLOT]), number)
            if text is not None:
                self._copied[number] = text
            elif number > self._reader.taken:  # some processors show the head before the rest: it is looked at again
                self._seen = number - 1
                return
        self._seen = head

    def _commands(self, frames: Frames, first: int, lost: int) -> tuple[list[TakenCommand], int]:
        """Return the commands that were taken in these periods, and the number of those that were overwritten before
        they were copied."""
        taken = frames["taken"]
        before = self._taken
        if before is None:
            before = 0 if first == 0 else int(taken[0])
        self._taken = int(taken[-1])
        commands, missing = [], 0
        for number in range(before + 1, min(self._taken, before + MAX_ENTRIES) + 1):
            place = int(np.searchsorted(taken, number))
            text = self._copied.pop(number, None)
            missing += text is None
            period = -1 if lost and not place else first + place
            commands.append(TakenCommand(number, period, text or b""))
        return commands, missing

    def close(self) -> None:
        if self._cells is not None:
            self._cells.close()


def joined(blocks: list[Block]) -> list[Block]:
    """Join consecutive blocks that have no loss between them, so that there are as few blocks as possible."""
    groups: list[list[Block]] = []
    for block in blocks:
        follows = bool(groups) and block.first == groups[-1][-1].stop
        if follows and not (block.lost or block.entries_lost):
            groups[-1].append(block)
        else:
            groups.append([block])
    return [_one(group) for group in groups]


def _one(blocks: list[Block]) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    first, live = blocks[0], dict[str, Any]()
    frames, at = np.zeros(sum(len(block.frames) for block in blocks), first.frames.dtype), 0
    for block in blocks:
        frames[at : at + len(block.frames)] = block.frames
        at += len(block.frames)
        live |= block.live
    return Block(
        frames,
        np.concatenate([block.entries for block in blocks]),
        [command for block in blocks for command in block.commands],
        first.lost,
        first.entries_lost,
        sum(block.commands_lost for block in blocks),
        [event for block in blocks for event in block.events],
        live,
        events_lost=sum(block.events_lost for block in blocks),
    )

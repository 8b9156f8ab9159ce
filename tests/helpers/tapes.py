"""A tape of a run in this process: an observer that copies frames, entries of the journal, and commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from umo import connect
from umo.cycle.events import Event
from umo.frames import Reader, published
from umo.frames.layout import ENTRY, Layout


@dataclass
class Taken:
    number: int
    period: int
    data: bytes


@dataclass
class MemoryBlock:
    frames: Any
    entries: Any
    commands: list[Taken] = field(default_factory=list)
    lost: int = 0
    entries_lost: int = 0


class MemoryTape:
    """A recorded run in memory (`umo.replay.Tape`)."""

    def __init__(self, layout: Layout, job: Mapping[str, Any]) -> None:
        self.layout, self.job = layout, job
        self.events: list[Event] = []
        self.recorded: list[MemoryBlock] = []

    def blocks(self) -> Iterator[MemoryBlock]:
        return iter(self.recorded)

    @property
    def frames(self) -> Any:
        return np.concatenate([each.frames for each in self.recorded])


@contextmanager
def taped(connection: connect[Any], job: Mapping[str, Any] | None = None, size: int = 500) -> Iterator[MemoryTape]:
    """Tape what a connected machine does; to be entered within `with connection`. The tape is whole when the
    connection is closed."""
    with published(connection, "taped") as ring:
        tape = MemoryTape(ring.layout, job or {})
        reader = Reader(ring.path)
        journal: list[Any] = []
        frames: list[Any] = []

        def flush() -> None:
            if frames:
                entries = np.concatenate([np.empty(0, ENTRY), *journal])
                tape.recorded.append(MemoryBlock(np.concatenate(frames), entries))
                frames.clear()
                journal.clear()

        def copy(frame: Any) -> None:
            new = reader.read()
            frames.append(new)
            for each in new:
                journal.append(reader.entries(int(each["journal"]), int(each["journal"] + each["entries"]))[1])
            if len(frames) >= size:
                flush()

        def end() -> None:
            tape.events = list(connection.machine.events)
            flush()
            reader.close()

        connection.machine.observers.append(copy)
        connection.afterwards.append(end)
        yield tape

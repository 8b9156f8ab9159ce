"""Publishing: the writing end of a ring. Readers can neither block nor slow it."""

from __future__ import annotations

import mmap
import os
import platform
import struct
import zlib
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from time import monotonic_ns
from typing import Any

from umo.cycle.forms import ArrayImage
from umo.cycle.frame import Frame
from umo.cycle.image import Image
from umo.cycle.journal import ENTRY, Journal
from umo.cycle.phases import UNKNOWN, Phases
from umo.errors import FramesError
from umo.frames import folder
from umo.frames.layout import (
    BEAT,
    CHECKSUM,
    DESCRIPTION,
    EVENTS,
    HEAD,
    HEADER,
    MAGIC,
    MISSED,
    NOTE,
    STATE,
    USAGE,
    VERSION,
    Layout,
)
from umo.system.usage import Usage

MOST_BYTES = 4 << 20
MOST_SLOTS = 4096
FEWEST_SLOTS = 16
MADV_POPULATE_WRITE = 23
ORDERED = platform.machine().lower() in ("x86_64", "amd64", "i686")
"""Stores become visible in program order: a sequence counter is enough."""


class State(IntEnum):
    """What the machine behind a ring is doing."""

    STARTING = 0
    RUNNING = 1
    STOPPING = 2
    ENDED = 3


class Ring:
    """An observer that publishes every frame it is shown.

    Making it reserves the memory, so a full disk is a FramesError here and not a crash later. `path` is a new
    file in the user's folder of frames. Call `close` at the end.
    """

    def __init__(
        self, image: Image, phases: Phases, layout: Layout, path: Path, *, checksum: bool = not ORDERED
    ) -> None:
        self.image = image
        self.phases = phases
        self.layout = layout
        self.path = path
        self.checksum = checksum
        self.index = 0
        self.missed = 0
        self._machine: Any = None
        self._task: tuple[Any, bytes] = (None, b"")
        self.usage = Usage()
        image.transfer.journal = self._journal = Journal(EVENTS)
        dtype = layout.dtype
        self.slot_bytes = dtype.itemsize
        self._content = layout.content
        self.slots = _slots(self.slot_bytes)
        description = layout.describe()
        self._first = -(-(DESCRIPTION + len(description)) // mmap.PAGESIZE) * mmap.PAGESIZE
        self.file, self._map = _make(path, self._first + self.slots * self.slot_bytes)
        flags = CHECKSUM if checksum else 0
        HEADER.pack_into(
            self._map, 0, MAGIC, VERSION, flags, self._first, self.slot_bytes, self.slots, len(description)
        )
        self._map[DESCRIPTION : DESCRIPTION + len(description)] = description
        self._bytes = memoryview(self._map)
        self._words = self._bytes.cast(image.raws.format)  # numpy's own letter for int64, "l" or "q"
        self._numbers = self._bytes.cast("d")
        self._live = self._words[: DESCRIPTION // 8]
        self._place(layout)
        os.rename(path.with_suffix(folder.UNFINISHED), path)  # whoever finds it finds it whole

    def _place(self, layout: Layout) -> None:
        fields: Any = layout.dtype.fields
        self._at = {name: fields[name][1] for name in fields}
        self._count = len(layout.objects)
        self._arrays = isinstance(self.image, ArrayImage)
        listed = 0 if self._arrays else self._count  # a list of values goes in with the numbers before it
        self._front = struct.Struct(f"<qdqqqq{len(USAGE)}qqqqq{NOTE}s{len(layout.phases)}q{listed}d")

    def watch(self, machine: Any) -> None:
        """Take `task`, `placed` and `parts_total` of this machine along, if it has them."""
        self._machine = machine

    def state(self, state: State) -> None:
        self._live[STATE // 8] = state

    def __call__(self, frame: Frame) -> None:
        """Write one frame, about 3 us for 13 objects."""
        index = self.index
        at = self._first + (index % self.slots) * self.slot_bytes
        words = self._words
        words[at >> 3] = 2 * index + 1
        self._fill(frame, at)
        if self.checksum:
            words[(at >> 3) + 1] = zlib.crc32(self._bytes[at + 16 : at + self._content])
        words[at >> 3] = 2 * index + 2
        self.index = index = index + 1
        live = self._live
        live[HEAD // 8] = index
        if frame.missed:
            self.missed += frame.missed
            live[MISSED // 8] = self.missed
        live[BEAT // 8] = monotonic_ns()

    def _fill(self, frame: Frame, at: int) -> None:
        image, phases, journal, places = self.image, self.phases, self._journal, self._at
        execution = round(frame.execution * 1e9)
        phases.finish(execution)
        task, done, total = self._note()
        self._front.pack_into(
            self._map, at + 16,
            frame.number, frame.time, frame.missed, frame.began,
            UNKNOWN if frame.missed else phases.wake, execution,
            *self.usage.read(),
            journal.count, journal.lost, done, total, task,
            *phases.ns, *(() if self._arrays else image.values),
        )  # fmt: skip
        phases.clear()
        count = self._count
        raws = at + places["raws"] >> 3
        self._words[raws : raws + count] = image.raws
        quality = at + places["quality"]
        if self._arrays:
            values = at + places["values"] >> 3
            self._numbers[values : values + count] = image.values
            self._bytes[quality : quality + count] = image.quality
        else:
            self._bytes[quality : quality + count] = bytes(image.quality)
        if journal.count:
            self._keep(journal, at + places["journal"])

    def _keep(self, journal: Journal, at: int) -> None:
        used = journal.count * ENTRY.size
        self._bytes[at : at + used] = memoryview(journal.buffer)[:used]
        journal.clear()

    def _note(self) -> tuple[bytes, int, int]:
        machine = self._machine
        if machine is None:
            return b"", 0, 0
        task = getattr(machine, "task", "")
        if task is not self._task[0]:
            self._task = task, _cut(str(task).encode())
        done, total = getattr(machine, "placed", 0), getattr(machine, "parts_total", 0)
        return self._task[1], done if type(done) is int else 0, total if type(total) is int else 0

    def close(self) -> None:
        """The last frame stands; readers see that the ring has ended. The file goes, what they mapped stays."""
        self.state(State.ENDED)
        self.usage.close()
        self.image.transfer.journal = None
        self.path.unlink(missing_ok=True)
        for view in (self._live, self._words, self._numbers, self._bytes):
            view.release()
        self._map.close()
        os.close(self.file)


def _slots(size: int) -> int:
    """A power of two, as many as fit 4 MiB, from 16 to 4,096."""
    fitting = max(MOST_BYTES // size, FEWEST_SLOTS)
    return int(min(1 << fitting.bit_length() - 1, MOST_SLOTS))


def _make(path: Path, size: int) -> tuple[int, mmap.mmap]:
    new = path.with_suffix(folder.UNFINISHED)
    try:
        file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_TRUNC | getattr(os, "O_CLOEXEC", 0), 0o600)
        try:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file, 0, size)
            else:
                os.ftruncate(file, size)
            folder.hold(file)
            return file, _touched(mmap.mmap(file, size))
        except BaseException:
            os.close(file)
            new.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise FramesError(
            f"no room for frames ({size / 1e6:.1f} MB at {path.parent}): {error.strerror or error}"
        ) from None


def _touched(mapped: mmap.mmap) -> mmap.mmap:
    """With every page in place, where the kernel does that at once: the first lap would pay for it otherwise."""
    with suppress(OSError, AttributeError):
        mapped.madvise(MADV_POPULATE_WRITE)
    return mapped


def _cut(text: bytes) -> bytes:
    """No more than fits, and no half character at the end."""
    return text[:NOTE].decode(errors="ignore").encode()

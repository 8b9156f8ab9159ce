"""A bench that publishes its frames, in this process or in another."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import Bench, bench, wired
from umo import connect, published
from umo.cycle.journal import Kind
from umo.process.frames import Ring, memory, ring, ring_copy
from umo.process.frames.layout import HEADER, Layout, Places
from umo.testing import Scripted, VirtualTimer


@contextmanager
def running(box: Scripted | None = None, *, missed: Any = (), **changes: Any) -> Iterator[tuple[Bench, Ring, Any]]:
    """A bench of five objects that publishes."""
    m = bench(**changes)
    connection = connect(m, wired(m, box or Scripted(), clock=VirtualTimer(missed)))
    with connection, published(connection, "bench") as ring:
        yield m, ring, connection


class RingMemory:
    """The memory of the ring that is made next, as its writer has it: no other process can change it."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.map: Any = None
        for module in (ring, ring_copy):
            patch.setattr(module, "fill", self._filled)

    def _filled(self, file: int, head: bytes, size: int, *, private: bool) -> Any:
        made = memory.fill(file, head, size, private=private)
        if private:  # not that of the clients
            self.map = made
        return made

    def places(self, layout: Layout) -> Places:
        _, _, _, first, _, slots, _, entries, _ = HEADER.unpack_from(self.map)
        return Places.of(layout, first, slots, entries)

    def slot(self, number: int) -> slice:
        """The place of a frame, by its number from 0."""
        _, _, _, first, size, slots, *_ = HEADER.unpack_from(self.map)
        at = first + number % slots * size
        return slice(at, at + size)

    def sequence(self, number: int) -> int:
        """The sequence number in the slot of this frame."""
        return int(struct.unpack_from("<Q", self.map, self.slot(number).start)[0])

    def set_live(self, place: int, number: int) -> None:
        """Set a live number by its place (`umo.process.frames.layout.Live`)."""
        struct.pack_into("<q", self.map, 8 * place, number)

    def set_sequence(self, number: int, sequence: int) -> None:
        struct.pack_into("<Q", self.map, self.slot(number).start, sequence)


def write(ring: Ring, frame: Any, number: int, entries: int) -> None:
    """A frame with so many entries, all of which hold its number."""
    for _ in range(entries):
        ring.journal.add(0, Kind.WRITE, number, -number)
    frame.number = number
    ring(frame)


def without_times(entries: Any) -> list[tuple[int, ...]]:
    """Entries of a journal: slot, kind, error, raw, before."""
    found: list[tuple[int, ...]] = entries[["slot", "kind", "error", "raw", "before"]].tolist()
    return found


WRITER = """
import sys
from array import array
sys.path.insert(0, sys.argv[1])
from helpers.publishing import running
from umo.cycle.showing import frame_of
from umo.testing import periods
with running() as (m, ring, connection):
    periods(m, 3)
    print(ring.path, flush=True)
    frame, image = frame_of(connection.machine), connection.image
    number = 0
    while sys.argv[2] == "fast":
        number += 1
        frame.number, frame.time = number, float(number)
        image.values[:] = array("d", [float(number)] * len(image.items))
        image.columns.raws.fill(number)
        ring.journal.add(0, 0, number, -number)
        ring(frame)
    sys.stdin.read()
"""


@contextmanager
def writer(how: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Another process that publishes, at full speed or not at all."""
    command = [sys.executable, "-c", WRITER, str(Path(__file__).parents[1]), how]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, Path(process.stdout.readline().strip())
    finally:
        process.kill()
        process.communicate()

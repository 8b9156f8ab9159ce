"""The writing end of a ring, which publishes frames. Readers can neither block it nor make it slower."""

from __future__ import annotations

import platform
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from mmap import mmap
from pathlib import Path

from umo.cycle import conversion
from umo.cycle.frame import Frame
from umo.cycle.image import Image
from umo.cycle.journal import CAPACITY, Journal
from umo.cycle.machine import ConnectedMachine
from umo.cycle.phase_times import UNKNOWN, PhaseTimes
from umo.cycle.stage import Progress, Stage
from umo.objects import MachineNumber
from umo.operation.alarms.alarming import engine_of
from umo.operation.commands.client_commands import Commanding
from umo.process.frames.client_memory import size_of
from umo.process.frames.layout import (
    CHECKSUM,
    DESCRIPTION,
    ENTRY,
    EVENT_ROW,
    EVENTS,
    LEASE_AT,
    LEASE_BYTES,
    NAME,
    NOTE,
    USAGE,
    USAGE_PACKING,
    Layout,
    Live,
    arrange,
    cut,
    pack_event,
)
from umo.process.frames.memory import RunDescriptors, fill
from umo.system.shared_cells import SharedText
from umo.system.usage import Usage
from umo.system.utc import utc

MAX_BYTES = 4 << 20
MAX_SLOTS = 4096
MIN_SLOTS = 16
ENTRY_BYTES = ENTRY.itemsize
MAX_INTEGER = (1 << 63) - 1
COUNTER_PERIODS = 32
"""The number of periods after which the counters of the system are always read. Reading them takes as long as writing
all other data of a frame."""
UTC_PAUSE = 1_000_000_000
"""Time in ns after which UTC is compared with the monotonic clock again."""
COLLECTIONS = [name for name, *_ in USAGE].index("collections")
LATE_SHARE = 0.5
"""The share of the period above which the counters are read if waking up and execution take it."""
ORDERED = platform.machine().lower() in ("x86_64", "amd64", "i686")
"""True if stores become visible in program order, so that a sequence counter is sufficient."""
BODY = 16
"""Offset of the body in a frame."""


Write = Callable[[int, int, float, int, int, int, int, bytes, list[int], list[float]], None]
"""The function that writes one body, like `_Packed.write`."""


def writer(image: Image, layout: Layout, file: mmap) -> Write:
    """Return the quickest function for writing. The function may hold the file's memory as long as the function
    exists."""
    shown = image.columns.shown
    if conversion.extension is not None:
        write: Write = conversion.extension.Body(file, shown, layout.content - BODY).write
        return write
    return _Packed(shown, layout, file).write


class _Packed:
    """The writer in Python, for use if the extension was not built. Tests prove that both writers write the same
    bytes."""

    def __init__(self, shown: memoryview, layout: Layout, file: mmap) -> None:
        self._shown, self._file = shown, file
        self._struct = struct.Struct(f"<qdqqqq{USAGE_PACKING.size}s{len(layout.phases)}q{len(layout.signals)}d")

    def write(
        self,
        at: int,
        number: int,
        time: float,
        missed: int,
        began: int,
        wake: int,
        execution: int,
        seldom: bytes,
        phases: list[int],
        signals: list[float],
    ) -> None:
        """Write a body at the offset `at` of the file, with the values of the image. The arguments have exactly these
        types. All times except `time` are in ns. `seldom`: the packed fields that rarely change."""
        self._struct.pack_into(self._file, at, number, time, missed, began, wake, execution, seldom, *phases, *signals)
        end = at + self._struct.size
        self._file[end : end + len(self._shown)] = self._shown


class Ring:
    """An observer that publishes every frame, in memory that no other process can write or truncate.

    The constructor reserves the memory. Raises FramesError if there is not enough memory. `ends` are the writer's
    descriptors of empty memory. Call `close` at the end.
    """

    def __init__(
        self,
        machine: ConnectedMachine,
        phases: PhaseTimes,
        layout: Layout,
        ends: RunDescriptors,
        *,
        checksum: bool = not ORDERED,
        tunables: Sequence[MachineNumber] = (),
    ) -> None:
        self.image = image = machine.image
        self._machine = machine
        self._attached = 0
        """The number of the machine's capabilities when a capability that takes commands was last searched for."""
        self._clients: Commanding | None = None
        self._events = machine.events
        self._told = 0
        """The number of events that were published."""
        self._tunables = tunables
        self._tunable_at = {tunable.path: number for number, tunable in enumerate(tunables)}
        self.phases = phases
        self.layout = layout
        self.path = Path()
        """The socket at which the run is found, if this process serves it."""
        self.checksum = checksum
        self.index = 0
        self.missed = 0
        self._shown_lease = (0, "")
        self._entries = 0
        self.slot_bytes = layout.dtype.itemsize
        self.slots = max(min(MAX_BYTES // self.slot_bytes, MAX_SLOTS), MIN_SLOTS)
        capacity = CAPACITY + len(image.items)
        self.journal_entries = max(2 * capacity, self.slots * len(image.items))
        """The capacity of the journal: enough for the entries of every frame that is kept, even if all objects fail for
        a long time."""
        head, places = arrange(layout, self.slots, self.journal_entries, CHECKSUM if checksum else 0)
        self._first, self._journal_at, self._content = places.first, places.journal, layout.content
        self._events_at, self._tunables_at = places.events, places.tunables
        self._alarms, self._alarms_at, self._alarms_shown = engine_of(machine), places.alarms, -1
        self._seldom_packed, self._seldom_is_plain, self._progress, self._taken = b"", False, Progress(), 0
        self._late = round(machine.clock.period * LATE_SHARE * 1e9)
        self._map = fill(ends.frames, head, places.size, private=True)
        fill(ends.cells, b"", size_of(layout), private=False).close()
        # from here on nothing fails: whoever makes a ring has all of it to close, or nothing
        self._bytes = memoryview(self._map)
        self._words = self._bytes.cast(image.raws.format)  # numpy's own letter for int64, "l" or "q"
        self._numbers = self._bytes.cast("d")
        self._live = self._words[: DESCRIPTION // 8]
        self._lease = SharedText(self._map, LEASE_AT, LEASE_BYTES)
        for number in range(len(tunables)):
            self._refresh(number)
        self.usage = Usage()
        self._counts = *self.usage.read(), 0
        self._collections, self._count_at = self._counts[COLLECTIONS], 0
        self._utc, self._utc_until = utc(), time.monotonic_ns() + UTC_PAUSE
        self._write = writer(image, layout, self._map)
        image.transfer.journal = self.journal = Journal(capacity)

    def state(self, state: Stage) -> None:
        self._live[Live.STATE] = state

    def __call__(self, frame: Frame) -> None:
        """Write one frame."""
        if len(self._machine.attached) != self._attached:
            self._attached, self._clients = len(self._machine.attached), self._machine.find(Commanding)
        index = self.index
        at = self._first + (index % self.slots) * self.slot_bytes
        words = self._words
        words[at >> 3] = 2 * index + 1
        self._fill(frame, at)
        if self.checksum:
            words[(at >> 3) + 1] = zlib.crc32(
                self._bytes[at + BODY : at + self._content], zlib.crc32((2 * index + 2).to_bytes(8, "little"))
            )
        words[at >> 3] = 2 * index + 2
        self.index = index = index + 1
        live = self._live
        live[Live.HEAD] = index
        if frame.missed:
            self.missed += frame.missed
            live[Live.MISSED] = self.missed
        if (alarms := self._alarms) is not None and alarms.revision != self._alarms_shown:
            self._alarms_shown = alarms.revision
            self._map[self._alarms_at : self._tunables_at] = alarms.times.tobytes()
        if self._tunables:  # one in each period
            self._refresh(index % len(self._tunables))
        if self._clients is not None:
            self.show(self._clients)
        if self._told != self._events.told:  # last: whoever sees an answer finds the lease and the mode as told
            self._tell()

    def _refresh(self, number: int) -> None:
        self._numbers[(self._tunables_at >> 3) + number] = self._tunables[number].read()

    def _tell(self) -> None:
        """Publish the new events that are still kept. A tuned number is shown before its event."""
        new = self._events.recent(self._events.told - self._told)
        self._told = self._events.told
        for number, event in enumerate(new, self._told - len(new)):
            if event.path in self._tunable_at:
                self._refresh(self._tunable_at[event.path])
            at = self._events_at + number % EVENTS * EVENT_ROW.itemsize
            self._words[at >> 3] = 0
            pack_event(self._map, at, event, number + 1)
            self._words[at >> 3] = number + 1
            self._live[Live.EVENT] = number + 1

    def show(self, clients: Commanding) -> None:
        """Show the mode, the lease, and the number of commands taken and dropped."""
        live, lease = self._live, clients.lease
        live[Live.MODE], live[Live.TAKEN], live[Live.DROPPED] = clients.mode, clients.inbox.taken, clients.inbox.dropped
        if self._shown_lease != (lease.number, lease.holder):
            self._shown_lease = lease.number, lease.holder
            self._lease.put(lease.number, cut(lease.holder, NAME))

    def _fill(self, frame: Frame, at: int) -> None:
        phases = self.phases
        execution = int(frame.execution * 1e9)
        phases.finish(execution)
        wake = UNKNOWN if frame.missed else phases.wake
        seldom = self._seldom_part(frame, execution + wake)
        self._write(
            at + BODY, frame.number, frame.time, frame.missed, frame.began, wake, execution,
            seldom, phases.ns, frame.signal_values,
        )  # fmt: skip
        phases.clear()
        self.journal.clear()

    def _seldom_part(self, frame: Frame, took: int) -> bytes:
        """Return counters, UTC, commands taken, journal and progress, packed again only if they may have changed. The
        counters are read after a period that took long, after missed periods, after a period in which the collector
        ran, and in one of every `COUNTER_PERIODS` periods."""
        journal, progress, clients = self.journal, frame.progress, self._clients
        empty = not (journal.count or journal.sampled or journal.updated)
        taken = 0 if clients is None else clients.inbox.taken
        counted = (
            self.index >= self._count_at
            or took > self._late
            or frame.missed > 0
            or self.usage.collections != self._collections
        )
        old = frame.began >= self._utc_until
        if (
            self._seldom_is_plain
            and empty
            and not counted
            and not old
            and taken == self._taken
            and progress is self._progress
        ):
            return self._seldom_packed
        if counted:
            self._counts = *self.usage.read(), self.index
            self._collections = self._counts[COLLECTIONS]
            self._count_at = self.index - self.index % COUNTER_PERIODS + COUNTER_PERIODS
        if old:
            self._utc, self._utc_until = utc(), frame.began + UTC_PAUSE
        first, checksum = self._entries, self._keep(journal) if journal.count else 0
        text = cut(progress.text, NOTE)
        self._seldom_packed = USAGE_PACKING.pack(
            *self._counts, *self._utc, taken,
            first, journal.count, journal.lost, journal.sampled, journal.updated, checksum,
            min(progress.done, MAX_INTEGER), min(progress.total, MAX_INTEGER), text,
        )  # fmt: skip
        self._seldom_is_plain, self._progress, self._taken = empty, progress, taken
        return self._seldom_packed

    def _keep(self, journal: Journal) -> int:
        """Store the entries of this period, and return their checksum (0 if checksums are not used). First tell readers
        which entries are being overwritten."""
        count, at = journal.count, self._entries % self.journal_entries
        self._live[Live.JOURNAL] = self._entries = self._entries + count
        entries = memoryview(journal.buffer)[: count * ENTRY_BYTES]
        here = min(count, self.journal_entries - at) * ENTRY_BYTES  # the rest goes to the beginning
        start = self._journal_at + at * ENTRY_BYTES
        self._bytes[start : start + here] = entries[:here]
        self._bytes[self._journal_at : self._journal_at + len(entries) - here] = entries[here:]
        return zlib.crc32(entries) if self.checksum else 0

    def close(self) -> None:
        """End the ring; readers see the end, and the last frames and events."""
        self._events.tell_all()
        if self._told != self._events.told:
            self._tell()
        self.state(Stage.ENDED)
        self.usage.close()
        self.image.transfer.journal = None
        del self._write  # it may hold the file's memory
        for view in (self._live, self._words, self._numbers, self._bytes):
            view.release()
        self._map.close()

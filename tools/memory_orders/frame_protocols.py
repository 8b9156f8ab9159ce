"""What a run publishes: frames, their journal, events, the lease."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from tools.memory_orders.explore import Model
from tools.memory_orders.threads import Access, Call, Shape, Thread, demand, with_reader
from umo.cycle.events import Event
from umo.cycle.stage import Stage
from umo.process.frames.layout import (
    DESCRIPTION,
    ENTRY,
    EVENT_BODY,
    EVENT_ROW,
    LEASE_AT,
    LEASE_BYTES,
    NAME,
    Layout,
    Live,
)
from umo.process.frames.reader import Reader
from umo.process.frames.ring import BODY, Ring
from umo.recording.ring_collector import Collector
from umo.system.shared_cells import SharedText

# Frames ---------------------------------------------------------------------------------------------------
# src/umo/process/frames/ring.py Ring.__call__, src/umo/process/frames/reader.py Reader.read, latest, frame_bytes.
# Written: the odd number, the body in any order (`writer`, also in C), the checksum, the even number, then the head.
# Writer: the control process, which may be killed. Readers: any number.


LAYOUT = Layout((), (), {"station": "x", "period": 0.001})
SLOT_BYTES, CONTENT = LAYOUT.dtype.itemsize, LAYOUT.content
SECOND_HALF = BODY + 80
"""Offset of the second half of a body in its frame."""


def _body(number: int) -> bytes:
    frame = np.zeros(1, LAYOUT.dtype)
    frame["number"], frame["progress"] = number + 1, f"frame {number}"
    return frame.tobytes()[BODY:CONTENT]


def _ring(memory: Access, checksum: bool, slots: int, index: int) -> Any:
    ring: Any = Ring.__new__(Ring)
    ring._machine = SimpleNamespace(attached=())
    ring._attached, ring._clients, ring._alarms, ring._tunables, ring._tunable_at = 0, None, None, (), {}
    ring._events, ring._told, ring.missed, ring._shown_lease = SimpleNamespace(told=0), 0, 0, (0, "")
    ring.checksum, ring.index, ring.slots, ring.slot_bytes = checksum, index, slots, SLOT_BYTES
    ring._first, ring._content = DESCRIPTION, CONTENT
    ring._words = memory.view(item="q")
    ring._live = memory.view(0, DESCRIPTION, "q")
    ring._bytes = ring._map = memory.view()
    ring._lease = SharedText(memory.view(), LEASE_AT, LEASE_BYTES)
    ring._fill = lambda frame, at: memory.store(at + BODY, _body(ring.index))
    return ring


class _Rows:
    """Rows of the memory as an array of numpy's: they are copied where they are chosen."""

    def __init__(self, memory: Access, at: int, kind: Any, count: int, offset: int = 0, width: int = 0) -> None:
        self._memory, self._at, self._kind, self._count = memory, at, np.dtype(kind), count
        self._offset, self._width = offset, width or self._kind.itemsize

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            kind, offset = self._kind.fields[key][:2]
            return _Rows(self._memory, self._at, kind, self._count, offset, self._width)
        places = np.arange(self._count)[key]
        size = self._kind.itemsize
        starts = [self._at + int(place) * self._width + self._offset for place in places]
        if isinstance(key, slice) and starts:  # one copy
            data = self._memory.load(starts[0], starts[-1] + size)
        else:
            data = b"".join(self._memory.load(start, start + size) for start in starts)
        return np.frombuffer(data, self._kind)


def _reader(memory: Access, checked: bool, slots: int = 1) -> Any:
    reader: Any = Reader.__new__(Reader)
    reader.layout, reader._dtype, reader._checked, reader.slots = LAYOUT, LAYOUT.dtype, checked, slots
    reader._sizes, reader.next, reader.lost = (SLOT_BYTES, CONTENT, CONTENT, 0), 0, 0
    reader._places = SimpleNamespace(first=DESCRIPTION)
    reader._live = memory.view(0, DESCRIPTION, "q")
    reader._memory = memory.view()
    reader._lease = SharedText(memory.view(), LEASE_AT, LEASE_BYTES)
    reader._rows = _Rows(memory, DESCRIPTION, (np.uint8, SLOT_BYTES), slots)
    return reader


def frames(
    checksum: bool, how: str = "read", looks: int = 2, slots: int = 2, count: int = 3, kill: bool = False
) -> Model:
    names = {0: "", 8 * Live.HEAD: "head", 8 * Live.STATE: "state", 8 * Live.MISSED: ""}
    for slot in range(slots):
        at = DESCRIPTION + slot * SLOT_BYTES
        parts = {0: "number", 8: "checksum" if checksum else "", BODY: "body a", SECOND_HALF: "body b", CONTENT: ""}
        names |= {at + offset: name and f"frame {slot} {name}" for offset, name in parts.items()}

    def write(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            ring = _ring(memory, checksum, slots, number)
            ring(SimpleNamespace(missed=0))
            if number == count - 1:
                ring.state(Stage.ENDED)
            return ring.index

        return call

    def whole(data: bytes) -> int:
        number = int.from_bytes(data[:8], "little") // 2 - 1
        demand(data[BODY:CONTENT] == _body(number), f"frame {number} is torn")
        return number

    def read(memory: Access, state: Any) -> Any:
        reader = _reader(memory, checksum, slots)
        before, reader.next = state, state
        found = [whole(frame.tobytes()) for frame in reader.read()]
        demand(found == sorted(set(found)) and all(before <= each < reader.next for each in found), "order of frames")
        return reader.next

    def latest(memory: Access, last: Any) -> Any:
        frame = _reader(memory, checksum, slots).latest()
        number = last if frame is None else whole(frame.tobytes())
        return max(last, number)

    def one(memory: Access, number: Any) -> Any:
        reader = _reader(memory, checksum, slots)
        if number >= reader.head:
            return number
        data = reader.frame_bytes(number)
        demand(data is None or whole(data) == number, "another frame")
        return number + 1

    call, begin = {"read": (read, 0), "latest": (latest, -1), "one": (one, 0)}[how]

    def final(memory: Access, results: Sequence[Any]) -> None:
        frame = _reader(memory, checksum, slots).latest()
        if results[0] is not None:
            demand(frame is not None and whole(frame.tobytes()) == count - 1, "the last frame is not read")
        elif frame is not None:
            whole(frame.tobytes())

    shape = Shape(DESCRIPTION + slots * SLOT_BYTES, names)
    writer = Thread("writer", [write(number) for number in range(count)], killable=kill)
    return Model(shape, with_reader(writer, call, looks, begin), final)


# The journal ----------------------------------------------------------------------------------------------
# Ring._keep; Reader.entries, journal; src/umo/recording/ring_collector.py Collector._entries. Written: the count of
# entries, the entries in any order; then the frame, which is proved by itself and has their checksum.

JOURNAL_AT = DESCRIPTION + 32
SPLIT = ENTRY.itemsize // 2 // 8 * 8


def _entry(number: int) -> bytes:
    entry = np.zeros(1, ENTRY)
    entry["slot"], entry["time"] = number, 100.0 + number
    return entry.tobytes()


def journal(checksum: bool, recorded: bool) -> Model:
    """`recorded`: read as a recording does it."""
    names = {0: "", 8 * Live.JOURNAL: "journal", 8 * Live.DESCRIBED: "", DESCRIPTION: "frame"}
    for place in range(2):
        at = JOURNAL_AT + place * ENTRY.itemsize
        names |= {at: f"entry {place} a", at + SPLIT: f"entry {place} b"}

    def keep(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            ring = _ring(memory, checksum, 1, number)
            ring._entries, ring.journal_entries, ring._journal_at = number, 2, JOURNAL_AT
            proof = ring._keep(SimpleNamespace(count=1, buffer=bytearray(_entry(number))))
            memory.store(DESCRIPTION, b"".join(each.to_bytes(8, "little") for each in (number, 1, proof, 0)))
            return number

        return call

    def look(memory: Access, _: Any) -> Any:
        first, count, proof, _ = np.frombuffer(memory.load(DESCRIPTION, JOURNAL_AT), "<u8").tolist()
        if not count:
            return None
        frame = np.array([(first, count, proof)], [("journal", "<i8"), ("entries", "<i8"), ("entries_checksum", "<u8")])
        reader = _reader(memory, checksum)
        reader._journal = _Rows(memory, JOURNAL_AT, ENTRY, 2)
        if recorded:
            collector: Any = Collector.__new__(Collector)
            collector._reader = reader
            found: Any = collector._entries(frame)[0]
        else:
            found = reader.journal(frame[0])
        data = b"" if found is None else found.tobytes()
        demand(data in (b"", _entry(first)), f"the journal of frame {first} is torn")
        return None

    shape = Shape(JOURNAL_AT + 2 * ENTRY.itemsize, names)
    return Model(shape, [Thread("writer", [keep(number) for number in range(3)]), Thread("reader", [look] * 2)])


# Events ---------------------------------------------------------------------------------------------------
# Ring._tell; Reader.events. Written: 0 for the number of the row, its checksum and content in any order, the number,
# the count. Answers to commands are events.


def _event(number: int) -> Any:
    return Event(float(number), f"path {number}", f"text {number}", who=f"who {number}", command=number + 1)


EVENT_HALF = EVENT_BODY + 24


def events(checksum: bool, looks: int = 2, count: int = 3, kill: bool = False) -> Model:
    rows = 1
    names = {0: "", 8 * Live.EVENT: "events", 8 * Live.MODE: ""}
    for row in range(rows):
        at = DESCRIPTION + row * EVENT_ROW.itemsize
        parts = {0: "number", 8: "checksum", EVENT_BODY: "content a", EVENT_HALF: "content b"}
        names |= {at + offset: f"event {row} {name}" for offset, name in parts.items()}

    def tell(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            ring = _ring(memory, checksum, 1, 0)
            ring._events_at, ring._told = DESCRIPTION, number
            ring._events = SimpleNamespace(told=number + 1, recent=lambda _: [_event(number)])
            ring._tell()
            return number

        return call

    def look(memory: Access, last: Any) -> Any:
        reader = _reader(memory, checksum)
        reader._events = _Rows(memory, DESCRIPTION, EVENT_ROW, rows)
        found = reader.events(last)
        for number, event in found:
            demand(event == _event(number), f"event {number} is torn: {event}")
        return found[-1].number + 1 if found else last

    def final(memory: Access, results: Sequence[Any]) -> None:
        if results[0] is not None:
            demand(look(memory, 0) == count, "the last event is not read")

    shape = Shape(DESCRIPTION + rows * EVENT_ROW.itemsize, names)
    writer = Thread("writer", [tell(number) for number in range(count)], killable=kill)
    return Model(shape, with_reader(writer, look, looks, 0), final)


# The lease ------------------------------------------------------------------------------------------------
# Ring.show; Reader.now.

LEASES = [
    (1, "ann, the page of a browser".ljust(NAME, ".")),
    (1, ""),
    (2, "bob, a program of his own".ljust(NAME, ".")),
]


def lease(looks: int = 2, kill: bool = False) -> Model:
    parts = {0: "lease", 8: "size", 16: "checksum", 24: "name a", 24 + NAME // 2: "name b", LEASE_BYTES: ""}
    names = {0: ""} | {LEASE_AT + offset: name for offset, name in parts.items()}

    def show(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            ring = _ring(memory, False, 1, 0)
            ring._shown_lease = (0, "") if number == 0 else LEASES[number - 1]
            ring._live = {}  # mode and counts are numbers that stand alone
            held = SimpleNamespace(number=LEASES[number][0], holder=LEASES[number][1])
            ring.show(SimpleNamespace(mode=0, inbox=SimpleNamespace(taken=0, dropped=0), lease=held))
            return number

        return call

    def look(memory: Access, last: Any) -> Any:
        found = _reader(memory, False)._lease_now()
        demand(found in ((-1, ""), *LEASES), f"lease {found} is torn")
        demand(found[0] == -1 or found[0] >= last, f"lease {found[0]} after {last}")
        return max(found[0], last)

    def final(memory: Access, results: Sequence[Any]) -> None:
        if results[0] is not None:
            demand(_reader(memory, False)._lease_now() == LEASES[-1], "the last lease is not read")

    writer = Thread("writer", [show(number) for number in range(3)], killable=kill)
    return Model(Shape(DESCRIPTION, names), with_reader(writer, look, looks, 0), final)

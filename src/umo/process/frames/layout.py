"""The binary layout of a ring of frames, which the ring's own header describes.

A ring is a little-endian piece of memory or file (a black box). It contains a header of fixed numbers (`HEADER`), the
live numbers, a description in JSON, then `slots` frames of `slot_bytes` each, then the journal of `entries` entries,
the events and the tunable numbers (8 bytes each). A reader in another language needs the fixed numbers below and the
JSON, which has the name, type (in numpy's notation: "<i8" is a signed integer of 8 bytes), offset, count and unit of
every field of a frame, an entry and an event.

Frame number i (from 0) lies in slot i % slots. Its `sequence` is 2 i + 1 while it is being written and 2 i + 2 when it
is complete. Entry number k (from 0) lies at k % entries of the journal; a frame gives the number of its first entry and
their count. Copies of these entries are valid if, after copying, `Live.JOURNAL` is at most the number of the first
entry + `entries`. Event number n (from 0) lies at n % `EVENTS`. Its `sequence` is n + 1 when it is complete.
"""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from umo.cycle.events import EVENT_TEXT_BYTES, Event
from umo.cycle.frame import Signal
from umo.cycle.journal import ENTRIES, ErrorKind, Kind
from umo.errors import FramesError
from umo.objects import Quality
from umo.objects.presentation.described import Described
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.system.shared_cells import HEAD as TEXT_HEAD
from umo.system.shared_cells import SharedText

MAGIC = b"umoframe"
VERSION = 12
HEADER = struct.Struct("<8sIIQQQQQQ")
"""The fields of the header: magic, version, flags, offset of the first slot, bytes of a slot, number of slots, offset
of the journal, number of its entries, bytes of the description."""
SHRUNK = "shrunk_from"
"""The key in the description of a shrunk recording for the number of periods that the recording had before."""
CHECKSUM = 1
"""The flag which says that each frame has a CRC-32, because the order of stores is not certain on this processor. The
CRC-32 covers `sequence` (the even number) and all bytes after `checksum` up to the end of the last field. The entries
of the frame have another CRC-32. A reader also verifies the checksums of events."""


class Live:
    """The indices of the live numbers, counted in numbers of 8 bytes."""

    HEAD, STATE, MISSED = 8, 9, 10
    """Number of finished frames; state (`umo.cycle.stage`); total number of missed periods."""
    JOURNAL = 11
    """Number of the next entry. It is increased before the entries are written."""
    DESCRIBED = 12
    """The CRC-32 of the description. The description does not change."""
    EVENT, MODE = 13, 14
    """The number of the next event; the mode (`umo.operation.commands.client_commands`; -1 if the machine takes no
    commands)."""
    TAKEN, DROPPED = 15, 16
    """The number of commands taken from clients; the number of commands that were dropped."""
    LEASE = 17
    """Number of the lease, which is also the number of the text at `LEASE_AT`."""


DESCRIPTION = 256
"""Offset of the JSON."""
NOTE = 64
NAME = 64
LEASE_AT, LEASE_BYTES = 8 * Live.LEASE, TEXT_HEAD.size + NAME
"""The offset and the size of a text (`umo.system.shared_cells.SharedText`) with these fields: the number of the lease,
the size of the holder's name, the CRC-32 of both and of the name (8 bytes each), and the name in UTF-8, up to `NAME`
bytes, empty if nobody has the lease."""
EVENTS = 512
"""The number of events that are kept: the most recent ones."""

ENTRY = ENTRIES
"""An entry of the journal (`umo.cycle.journal`)."""

EVENT_ROW = np.dtype(
    [
        ("sequence", "<u8"),
        ("checksum", "<u8"),
        ("time", "<f8"),
        ("command", "<u8"),
        ("state", "<u8"),
        ("who", f"S{NAME}"),
        ("path", "S96"),
        ("asked", "S128"),
        ("text", f"S{EVENT_TEXT_BYTES}"),
    ]
)
"""An event (`umo.cycle.events`): texts are UTF-8 and cut to the size of their fields. The checksum is the CRC-32 of
`sequence` and of the fields after the checksum."""

_TEXT_SIZES = [EVENT_ROW[name].itemsize for name in ("who", "path", "asked", "text")]
_EVENT = struct.Struct("<dQQ" + "".join(f"{size}s" for size in _TEXT_SIZES))
EVENT_BODY = 16
"""Offset in a row of the part after the checksum."""


def pack_event(memory: Any, at: int, event: Event, sequence: int) -> None:
    """Write an event to its row at `at`, except the `sequence`, which completes the row."""
    texts = map(cut, (event.who, event.path, event.asked, event.text), _TEXT_SIZES)
    body = _EVENT.pack(event.time, event.command, event.state, *texts)
    memory[at + 8 : at + EVENT_BODY + len(body)] = event_checksum(sequence, body).to_bytes(8, "little") + body


def event_checksum(sequence: int, body: bytes) -> int:
    return zlib.crc32(body, zlib.crc32(sequence.to_bytes(8, "little")))


def cut(text: str, size: int) -> bytes:
    """Cut a string to this number of bytes, and return it without an incomplete character at the end."""
    found = text.encode(errors="replace")
    return found if len(found) <= size else found[:size].decode(errors="ignore").encode()


Column = tuple[str, str, int, str]
"""Name, numpy type, count and unit of a field."""

USAGE: list[Column] = [
    ("minor_faults", "<i8", 1, ""),
    ("major_faults", "<i8", 1, ""),
    ("voluntary_switches", "<i8", 1, ""),
    ("involuntary_switches", "<i8", 1, ""),
    ("in_kernel", "<i8", 1, "ns"),
    ("running", "<i8", 1, "ns"),
    ("run_queue_wait", "<i8", 1, "ns"),
    ("collections", "<i8", 1, ""),
    ("collecting", "<i8", 1, "ns"),
]
"""The counters of the operating system and the interpreter for the loop's thread, as last read. Differences between two
frames show what happened between their readings."""

FIXED: list[Column] = [
    ("sequence", "<u8", 1, ""),
    ("checksum", "<u8", 1, ""),
    ("number", "<i8", 1, "ticks since connecting"),
    ("time", "<f8", 1, "s on the cycle's clock"),
    ("missed", "<i8", 1, "ticks"),
    ("began", "<i8", 1, "ns of CLOCK_MONOTONIC at the timer's return"),
    ("wake", "<i8", 1, "ns from the tick to waking up; -1 unknown"),
    ("execution", "<i8", 1, "ns from the timer's return to the end of update"),
    *USAGE,
    ("counted", "<i8", 1, "number of the frame, from 0, for which these were read"),
    ("utc", "<i8", 1, "ns to be added to `began` for UTC since 1970; read once a second"),
    ("utc_error", "<i8", 1, "ns, the greatest; -1 not known: the clock is not synchronised"),
    ("taken", "<i8", 1, "commands of clients taken since connecting"),
    ("journal", "<i8", 1, "number of its first entry in the journal"),
    ("entries", "<i8", 1, "in the journal"),
    ("entries_lost", "<i8", 1, "that found no room in the journal"),
    ("sampled", "<i8", 1, "entries before the sample of the whole machine; -1 there was none"),
    ("updated", "<i8", 1, "entries before the update of the whole machine; -1 there was none"),
    ("entries_checksum", "<u8", 1, ""),
    ("done", "<i8", 1, "of `total`: how much of its work the machine has done"),
    ("total", "<i8", 1, "0: not known"),
    ("progress", f"S{NOTE}", 1, "UTF-8: what the machine is doing"),
]
RESTRICTIONS = "0 and 254 free, 255 taken by a client, else the number of the reason of its inhibition, from 1"
STATES = "numbers of the states that the description names"
USAGE_PACKING = struct.Struct(f"<{len(USAGE)}q12q{NOTE}s")
"""Packing of the fields from `USAGE` on, which rarely change."""


class DescribedValues(NamedTuple):
    """The meaning of the values of a frame, in their order."""

    objects: tuple[Described, ...]
    signals: tuple[Described, ...]
    tunables: tuple[Described, ...]

    @property
    def traced(self) -> list[Described]:
        """The values in each frame: objects, then signals. They are the columns of a history."""
        return [*self.objects, *self.signals]


@dataclass(frozen=True)
class Layout:
    """The fields of a frame and their offsets."""

    objects: tuple[dict[str, Any], ...]
    phases: tuple[str, ...]
    about: dict[str, Any]
    """The origin of the frames: station, wiring, pid, start, period in s; `job`: the facts of the run
    (`umo.process.job_facts`)."""
    signals: tuple[dict[str, Any], ...] = ()
    """Path and unit of each signal; for named values, the names of their states."""
    interlocks: tuple[str, ...] = ()
    """The reasons of the interlocks."""
    actions: tuple[dict[str, Any], ...] = ()
    """Path, arguments and meaning of each action (`umo.objects.action`)."""
    tunables: tuple[dict[str, Any], ...] = ()
    """Path, unit and range of each tunable number."""
    equipment: tuple[dict[str, Any], ...] = ()
    axes: tuple[dict[str, Any], ...] = ()
    alarms: tuple[dict[str, Any], ...] = ()
    """The path and the names of the states by number of each equipment, axis and alarm; for alarms also text, priority
    and options, for axes also position, limits and actions."""
    units: tuple[dict[str, Any], ...] = ()
    """Path, states and commands of each state machine (`umo.operation`); its state is the signal `PATH.state`."""
    books: tuple[dict[str, Any], ...] = ()
    """The path, fields and recipes of each recipe book (`umo.operation.recipe_book`). The recipe that was begun last is
    the signal `PATH.begun`, and the chosen recipe is the signal `PATH.choice`, if the book shows them."""

    @cached_property
    def described(self) -> DescribedValues:
        return DescribedValues(*(tuple(map(Described, each)) for each in (self.objects, self.signals, self.tunables)))

    @property
    def columns(self) -> list[Column]:
        count = len(self.objects)
        return [
            *FIXED,
            ("phases", "<i8", len(self.phases), "ns"),
            ("signals", "<f8", len(self.signals), "each signal's own; NaN: it has no value"),
            ("values", "<f8", count, "each object's own; a binary object's electrical 1 is 1.0"),
            ("raws", "<i8", count, ""),
            ("quality", "<u1", count, ", ".join(f"{int(quality)} {quality}" for quality in Quality)),
            ("restrictions", "<u1", count, RESTRICTIONS),
            ("equipment", "<u1", len(self.equipment), STATES),
            ("axes", "<u1", len(self.axes), STATES),
            ("alarms", "<u1", len(self.alarms), STATES),
        ]

    @property
    def dtype(self) -> np.dtype[Any]:
        names, formats, offsets, at = [], [], [], 0
        for name, kind, count, _ in self.columns:
            names.append(name)
            formats.append(kind if name in _SCALARS else (kind, (count,)))
            offsets.append(at)
            at += np.dtype(kind).itemsize * count
        size = -(-at // 64) * 64  # whole cache lines
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    @property
    def content(self) -> int:
        """The number of used bytes of a frame. The bytes after these, up to the size of the frame, are empty."""
        return sum(np.dtype(kind).itemsize * count for _, kind, count, _ in self.columns)

    def describe(self) -> bytes:
        """Return the JSON of the header."""
        dtype = self.dtype
        columns = [
            {"name": name, "type": kind, "offset": dtype.fields[name][1], "count": count, "unit": unit}  # type: ignore[index]
            for name, kind, count, unit in self.columns
        ]
        text = {name: getattr(self, name) for name in _DESCRIBED}
        text |= {"fields": columns, "journal": _describe_journal()}
        return json.dumps(text | {"events": {"count": EVENTS, **_describe_row(EVENT_ROW)}}).encode()

    @classmethod
    def parse(cls, description: bytes) -> Layout:
        try:
            text = json.loads(description)
            lists = {name: tuple(text[name]) for name in _DESCRIBED if name != "about"}
            layout = cls(about=dict(text["about"]), **lists)
            fits = [field["name"] for field in text["fields"]] == [column[0] for column in layout.columns]
            fits = fits and all(isinstance(each["path"], str) for name in _WITH_PATHS for each in lists[name])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise FramesError(f"the description of the frames cannot be read: {error}") from None
        if not fits:
            raise FramesError("the description of the frames does not fit this version")
        return layout


def without_job(layout: Layout) -> Layout:
    """Return the layout without the facts of the run (`job`), because its paths and its wiring are not valid on another
    computer."""
    return replace(layout, about={name: fact for name, fact in layout.about.items() if name != "job"})


class Places(NamedTuple):
    first: int
    journal: int
    events: int
    alarms: int
    """The place of the rows of `<f8` that alarms have (`AlarmTimes`)."""
    tunables: int
    size: int

    @classmethod
    def of(cls, layout: Layout, first: int, slots: int, entries: int) -> Places:
        """Return the places in a ring with these numbers of frames, from `first` on, and of entries in the journal."""
        journal = first + slots * layout.dtype.itemsize
        events = journal + entries * ENTRY.itemsize
        alarms = events + EVENTS * EVENT_ROW.itemsize
        tunables = alarms + len(AlarmTimes._fields) * 8 * len(layout.alarms)
        return cls(first, journal, events, alarms, tunables, tunables + 8 * len(layout.tunables))


def arrange(layout: Layout, slots: int, entries: int, flags: int = 0) -> tuple[bytes, Places]:
    """Return header, live numbers (all 0) and description of a ring with these numbers of frames and entries, and the
    places of the ring."""
    description, slot = layout.describe(), layout.dtype.itemsize
    first = -(-(DESCRIPTION + len(description)) // mmap.PAGESIZE) * mmap.PAGESIZE
    places = Places.of(layout, first, slots, entries)
    head = bytearray(DESCRIPTION)
    HEADER.pack_into(head, 0, MAGIC, VERSION, flags, first, slot, slots, places.journal, entries, len(description))
    struct.pack_into("<Q", head, 8 * Live.DESCRIBED, zlib.crc32(description))
    struct.pack_into("<q", head, 8 * Live.MODE, -1)
    SharedText(head, LEASE_AT, LEASE_BYTES).put(0, b"")
    return bytes(head) + description, places


_SCALARS = {column[0] for column in FIXED}
_DESCRIBED = tuple(field.name for field in fields(Layout))
_WITH_PATHS = ("objects", "signals", "actions", "tunables", "equipment", "axes", "alarms", "units", "books")


def _describe_journal() -> dict[str, Any]:
    """Return the description of the fields of an entry, in the form of those of a frame, with the meanings of their
    numbers."""
    names = {"kinds": Kind, "errors": ErrorKind}
    return _describe_row(ENTRY) | {key: {int(each): each.name for each in kinds} for key, kinds in names.items()}


def _describe_row(row: np.dtype[Any]) -> dict[str, Any]:
    assert row.fields is not None
    columns = [{"name": name, "type": kind.str, "offset": at} for name, (kind, at, *_) in row.fields.items()]
    return {"entry_bytes": row.itemsize, "fields": columns}


def describe_signals(
    signals: Sequence[Signal], kept: Mapping[str, Any] = MappingProxyType({})
) -> tuple[dict[str, Any], ...]:
    """Return path and unit of each signal, in the order of the frame; for a named value also the names of its states,
    for a kept value also its type."""
    return tuple(
        {"path": each.path, "unit": each.unit}
        | ({"states": {str(n): s for n, s in each.states.items()}} if each.states else {})
        | ({"kept": kept[each.path]} if each.path in kept else {})
        for each in signals
    )

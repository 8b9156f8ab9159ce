"""The binary layout of a ring of frames, which the ring's own header describes.

A ring is one file, little-endian: a header of fixed numbers (`HEADER`), the live numbers, a description in JSON,
then `slots` frames of `slot_bytes` each, then the journal of `entries` entries. A reader in another language needs
the fixed numbers below and the JSON, which gives the name, type (numpy's notation: "<i8" is a signed integer of 8
bytes), offset, count and unit of every field of a frame and of an entry.

Frame number i (from 0) lies in slot i % slots. Its `sequence` is 2 i + 1 while it is being written and 2 i + 2 when
it is whole. Entry number k (from 0) lies at k % entries of the journal; a frame gives the number of its first entry
and their count. They are still there if, after they were copied, the live number JOURNAL is at most that first
number + `entries`.
"""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from umo.cycle.journal import Kind
from umo.cycle.signals import Signal
from umo.errors import FramesError
from umo.objects import Atomic, Binary, Digital, Quality

MAGIC = b"umoframe"
VERSION = 3
HEADER = struct.Struct("<8sIIQQQQQQ")
"""Magic, version, flags, offset of the first slot, bytes of a slot, slots, offset of the journal, its entries, bytes of
the description."""
CHECKSUM = 1
"""Flag: each frame carries a CRC-32, as the order of stores is not certain on this processor: of `sequence` (the even
one) and all that follows `checksum` up to the end of the last field; and one of its entries."""
HEAD, STATE, MISSED, JOURNAL, DESCRIBED = 64, 72, 80, 88, 96
"""Offsets of the live numbers, 8 bytes each: frames finished, state (`umo.cycle.stage`), missed periods in all, number
of the next entry (moved on before the entries are written); and of the CRC-32 of the description, which stays."""
DESCRIPTION = 128
"""Offset of the JSON."""
NOTE = 64

ENTRY = np.dtype([("slot", "<u4"), ("kind", "<u4"), ("raw", "<i8"), ("before", "<i8")])
"""An entry of the journal (`umo.cycle.journal`)."""

Column = tuple[str, str, int, str]
"""Name, numpy type, count, unit."""

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
"""What the operating system and the interpreter have counted for the loop's thread: differences between two frames
are what happened from one to the next."""

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


@dataclass(frozen=True)
class Layout:
    """What a frame holds, and where."""

    objects: tuple[dict[str, Any], ...]
    phases: tuple[str, ...]
    about: dict[str, Any]
    """Whose frames these are: station, wiring, pid, when it started, the period in s."""
    signals: tuple[dict[str, Any], ...] = ()
    """Path and unit of each."""

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
        """Bytes of a frame in use; what follows up to its size is empty."""
        return sum(np.dtype(kind).itemsize * count for _, kind, count, _ in self.columns)

    def describe(self) -> bytes:
        """The header's JSON."""
        dtype = self.dtype
        fields = [
            {"name": name, "type": kind, "offset": dtype.fields[name][1], "count": count, "unit": unit}  # type: ignore[index]
            for name, kind, count, unit in self.columns
        ]
        shown = {"objects": self.objects, "signals": self.signals}
        text = {"about": self.about, **shown, "phases": self.phases, "fields": fields}
        return json.dumps(text | {"journal": _describe_journal()}).encode()

    @classmethod
    def parse(cls, description: bytes) -> Layout:
        try:
            text = json.loads(description)
            layout = cls(tuple(text["objects"]), tuple(text["phases"]), dict(text["about"]), tuple(text["signals"]))
            fits = [field["name"] for field in text["fields"]] == [column[0] for column in layout.columns]
        except (ValueError, KeyError, TypeError) as error:
            raise FramesError(f"the description of the frames cannot be read: {error}") from None
        if not fits:
            raise FramesError("the description of the frames does not fit this version")
        return layout


class Places(NamedTuple):
    """Where the parts of a ring's file begin, and how it begins itself."""

    head: bytes
    """Header, live numbers (all 0) and description."""
    first: int
    journal: int
    size: int


def arrange(layout: Layout, slots: int, entries: int, flags: int = 0) -> Places:
    """The file of a ring with so many frames, and so many entries in its journal."""
    description, slot = layout.describe(), layout.dtype.itemsize
    first = -(-(DESCRIPTION + len(description)) // mmap.PAGESIZE) * mmap.PAGESIZE
    journal = first + slots * slot
    head = bytearray(DESCRIPTION)
    HEADER.pack_into(head, 0, MAGIC, VERSION, flags, first, slot, slots, journal, entries, len(description))
    struct.pack_into("<Q", head, DESCRIBED, zlib.crc32(description))
    return Places(bytes(head) + description, first, journal, journal + entries * ENTRY.itemsize)


_SCALARS = {column[0] for column in FIXED}


def _describe_journal() -> dict[str, Any]:
    """An entry's fields as those of a frame; what its numbers mean."""
    assert ENTRY.fields is not None
    fields = [{"name": name, "type": kind.str, "offset": at} for name, (kind, at, *_) in ENTRY.fields.items()]
    return {"entry_bytes": ENTRY.itemsize, "fields": fields, "kinds": {int(kind): kind.name for kind in Kind}}


def describe_objects(items: Sequence[Atomic]) -> tuple[dict[str, Any], ...]:
    """Path, kind and meaning of each object, in the order of the frame's slots."""
    return tuple(_describe(item) for item in items)


def describe_signals(signals: Sequence[Signal]) -> tuple[dict[str, Any], ...]:
    """Path and unit of each signal, in the order of the frame's."""
    return tuple({"path": signal.path, "unit": signal.unit} for signal in signals)


def _describe(item: Atomic) -> dict[str, Any]:
    what: dict[str, Any] = {"path": item.path, "kind": type(item).__name__, "synchronous": item.synchronous}
    if isinstance(item, Digital):
        return what | {"unit": item.units, "minimum": item.minimum, "maximum": item.maximum}
    assert isinstance(item, Binary)
    return what | {"one": str(item.one), "zero": str(item.zero)}

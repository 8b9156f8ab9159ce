"""Blocks of consecutive frames, with all data that belong to them, as two messages of a recording.

`umo/exact` contains the data that replay needs, `umo/columns` all other data. Both messages together restore exactly
the same frames, except their checksums. Each message begins with a description in JSON, preceded by the description's
length in 4 bytes. The columns follow (`umo.recording.column_coding`). Entries of the journal and commands follow the
columns of `umo/exact`.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from umo.cycle.events import CommandState, Event
from umo.errors import FramesError
from umo.objects.scaling import to_values
from umo.process.frames.layout import ENTRY, Layout
from umo.process.frames.reader import Entries
from umo.process.frames.run_reader import Frames, NumberedEvent
from umo.recording.column_coding import decode, encoded

MADE_ANEW = ("sequence", "checksum", "entries_checksum")
"""Fields that are not stored. The sequence follows from the number of the frame; checksums become 0."""
EXACT = (
    "number", "time", "missed", "utc", "utc_error", "taken", "journal", "entries", "entries_lost", "sampled", "updated",
    "raws",
)  # fmt: skip
"""The fields of a frame that a replay needs."""
FIELDS = tuple(ENTRY.names or ())
MAX_FRAMES = 64 << 20
"""Largest number of bytes of a block's frames, and also of its entries."""
MAX_TEXT, MAX_VALUES = 16 << 20, 500_000
"""Largest numbers of bytes and of values of a description."""


@dataclass(frozen=True)
class TakenCommand:
    """A command of a client that the machine has taken."""

    number: int
    """Number of the command, from 1."""
    period: int
    """Number, from 0, of the frame of the period in which the command was taken; -1 if that frame is lost."""
    data: bytes
    """The received command (JSON); empty if the data were not a command, or were overwritten before it was copied."""


class BlackBox(NamedTuple):
    """The last frames before a missed period or a failed end, and the causes that these frames show."""

    first: int
    """Number of the black box's first frame, from 0."""
    periods: int
    """Number of the frames in the black box."""
    start: float
    time: float
    """Times of the first and of the last frame, in s on the machine's clock."""
    reason: str
    """The reason: `a period was missed`, or why the run failed."""
    missed: int
    """Number of missed periods so far in the whole run, as far as the run is recorded."""
    text: str
    """Causes of the last missed periods in the black box, one per line; empty if none was missed."""


@dataclass(frozen=True)
class Block:
    """Consecutive frames, with the events, commands and other data of the same time."""

    frames: Frames
    """Structured array of `Layout.dtype`."""
    entries: Entries
    """The entries of these frames in the journal. The first `entries_lost` entries are missing."""
    commands: list[TakenCommand] = field(default_factory=list)
    lost: int = 0
    """Number of frames that are missing before the block."""
    entries_lost: int = 0
    """Number of entries of these frames that were overwritten before they were copied."""
    commands_lost: int = 0
    """Number of commands of these frames that were overwritten before they were copied."""
    events: list[NumberedEvent] = field(default_factory=list)
    """The events up to these frames."""
    live: Mapping[str, Any] = field(default_factory=dict)
    """Data of the ring other than frames: `mode`, `holder` of the lease, and `tunables`, each if it has changed."""
    boxes: Sequence[BlackBox] = ()
    """The black boxes whose last frame is one of these."""
    events_lost: int = 0
    """Number of events up to these frames that were overwritten before they were copied."""
    is_full: bool = True
    """True if the block contains the columns that replay does not need. Otherwise the numbers in these columns are 0 or
    NaN."""

    @property
    def first(self) -> int:
        """Number of the block's first frame, from 0."""
        return int(self.frames["sequence"][0]) // 2 - 1

    @property
    def stop(self) -> int:
        """Number of the frame that follows the block."""
        return self.first + len(self.frames)

    def split(self, row: int) -> tuple[Block, Block]:
        """Split into two blocks: the frames before a row, given by its index in this block, and the other frames, each
        with their data. Data that belong to no frame go to the second block; missing data count in the first block."""
        before, rest = self.frames[:row], self.frames[row:]
        moment, stop = float(before["time"][-1]), self.first + row
        entries = int(before["journal"][-1] + before["entries"][-1]) - self._first_entry
        entries = min(max(entries, 0), len(self.entries))
        events = sum(1 for _ in takewhile(lambda each: each[1].time <= moment, self.events))
        commands = sum(1 for _ in takewhile(lambda each: each.period < stop, self.commands))
        boxes = sum(1 for _ in takewhile(lambda box: box.time <= moment, self.boxes))
        first = replace(
            self, frames=before, entries=self.entries[:entries], commands=self.commands[:commands],
            events=self.events[:events], boxes=self.boxes[:boxes],
        )  # fmt: skip
        second = replace(
            self, frames=rest, entries=self.entries[entries:], commands=self.commands[commands:],
            events=self.events[events:], boxes=self.boxes[boxes:], lost=0, entries_lost=0, commands_lost=0,
            events_lost=0,
        )  # fmt: skip
        return first, second

    @property
    def _first_entry(self) -> int:
        """Number of the block's first entry in the journal of the run."""
        end = self.frames[-1]
        return int(end["journal"] + end["entries"]) - len(self.entries)

    def journal(self, row: int) -> Entries | None:
        """Return the journal's entries of the period of a frame, given by its index in this block. Return None if some
        entries were lost."""
        frame = self.frames[row]
        start, count = int(frame["journal"]) - self._first_entry, int(frame["entries"])
        return None if start < 0 < count else self.entries[max(start, 0) : max(start, 0) + count]


def rest_of(layout: Layout) -> list[str]:
    """Return the fields of the message `umo/columns`."""
    return [name for name, *_ in layout.columns if name not in EXACT + MADE_ANEW]


def exact_message(block: Block) -> bytes:
    commands = [(each.number, each.period, len(each.data)) for each in block.commands]
    events = [(number, event.time, event.path, event.text, event.who, event.command, int(event.state), event.asked)
              for number, event in block.events]  # fmt: skip
    about = {
        "first": block.first, "count": len(block.frames), "lost": block.lost, "entries": len(block.entries),
        "entries_lost": block.entries_lost, "commands": commands, "commands_lost": block.commands_lost,
        "events": events, "live": dict(block.live), "time": float(block.frames["time"][0]),
        "number": int(block.frames["number"][0]),
    }  # fmt: skip
    if block.events_lost:
        about["events_lost"] = block.events_lost
    if block.boxes:
        about["boxes"] = block.boxes
    texts = b"".join(each.data for each in block.commands)
    return _headed(about) + encoded(block.frames, EXACT) + encoded(block.entries, FIELDS) + texts


def columns_message(block: Block, layout: Layout) -> bytes:
    """Return the message `umo/columns`. Values that follow exactly from raw integers, by resolution and zero offset,
    are left out."""
    frames = block.frames
    columns = {name: frames[name] for name in rest_of(layout)}
    left_out = _following(layout, frames)
    if left_out:
        columns["values"] = columns["values"].copy()
        columns["values"][:, left_out if len(left_out) < len(layout.objects) else slice(None)] = 0.0
    about = {"first": block.first, "count": len(frames), "following": left_out}
    return _headed(about) + encoded(columns, columns)


def _following(layout: Layout, frames: Frames) -> list[int]:
    """Return the places of the objects whose values follow from their raw integers in all of these frames."""
    if not layout.objects:
        return []
    differ = _values(layout, frames).view("<u8")
    differ ^= frames["values"].view("<u8")
    return [int(place) for place in np.flatnonzero(~differ.any(axis=0))]


def _values(layout: Layout, frames: Frames) -> Any:
    """Return the values that follow from the raw integers by resolution and zero offset. For a binary object the value
    is the raw integer. For an object without a resolution the result has no meaning."""
    objects = layout.described.objects
    resolutions = np.array([1.0 if each.resolution is None else float(each.resolution) for each in objects])
    return to_values(frames["raws"], resolutions, np.array([each.zero_offset for each in objects]))


def block_of(layout: Layout, exact: bytes | memoryview, columns: bytes | memoryview | None) -> Block:
    """Return the block from these two messages. Without the second message the block is not full. Raises FramesError if
    a message is damaged."""
    try:
        return _block_of(layout, exact, columns)
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, struct.error) as error:
        raise FramesError(f"a block of the recording is damaged: {error}") from None


def _block_of(layout: Layout, exact: bytes | memoryview, columns: bytes | memoryview | None) -> Block:
    about, data = headed(exact)
    count, first = int(about["count"]), int(about["first"])
    entry_count = int(about["entries"])
    if not 0 < count * layout.dtype.itemsize <= MAX_FRAMES or not 0 <= entry_count * ENTRY.itemsize <= MAX_FRAMES:
        raise ValueError(f"it has {count} periods and {entry_count} entries")
    frames = np.zeros(count, layout.dtype)
    frames["sequence"] = 2 * np.arange(first, first + count, dtype=np.uint64) + 2
    data = decode(data, frames, EXACT)
    entries = np.zeros(entry_count, ENTRY)
    texts = decode(data, entries, FIELDS)
    if columns is None:
        frames["values"], frames["signals"] = np.nan, np.nan
    else:
        same, rest = headed(columns)
        if (same["first"], same["count"]) != (first, count):
            raise ValueError("the two messages of the block belong to different frames")
        decode(rest, frames, rest_of(layout))
        if following := same["following"]:
            frames["values"][:, following] = _values(layout, frames)[:, following]
    return Block(
        frames, entries, _commands(about["commands"], texts), int(about["lost"]), int(about["entries_lost"]),
        int(about["commands_lost"]), events_of(about), about["live"], boxes_of(about),
        events_lost_of(about), columns is not None,
    )  # fmt: skip


def events_lost_of(about: Mapping[str, Any]) -> int:
    """Return the number of missing events, as given by the description in a message `umo/exact`."""
    return int(about.get("events_lost", 0))


def events_of(about: Mapping[str, Any]) -> list[NumberedEvent]:
    """Return the events in the description of a message `umo/exact`."""
    return [
        NumberedEvent(number, Event(time, path, text, who, command, CommandState(state), asked))
        for number, time, path, text, who, command, state, asked in about["events"]
    ]


def boxes_of(about: Mapping[str, Any]) -> list[BlackBox]:
    """Return the black boxes in the description of a message `umo/exact`."""
    return [BlackBox(*each) for each in about.get("boxes", ())]


def _commands(rows: Sequence[Sequence[int]], texts: memoryview) -> list[TakenCommand]:
    commands = []
    for number, period, size in rows:
        commands.append(TakenCommand(number, period, bytes(texts[:size])))
        texts = texts[size:]
    return commands


def _headed(about: Mapping[str, Any]) -> bytes:
    text = json.dumps(about, separators=(",", ":")).encode()
    return struct.pack("<I", len(text)) + text


def headed(data: bytes | memoryview) -> tuple[dict[str, Any], memoryview]:
    """Return the description at the beginning of a message, and the remaining bytes. Raises ValueError if there is no
    description."""
    view = memoryview(data)
    if len(view) < 4:
        raise ValueError("it has no description")
    (size,) = struct.unpack_from("<I", view)
    if size > MAX_TEXT:
        raise ValueError(f"its description has {size} bytes")
    try:
        return dict(json.loads(checked_text(bytes(view[4 : 4 + size])))), view[4 + size :]
    except (TypeError, RecursionError) as error:
        raise ValueError(f"its description cannot be read: {error}") from None


def checked_text(text: bytes) -> bytes:
    """Return a text in JSON, after a check that its values need only limited memory. Raises ValueError if it has too
    many values."""
    if sum(map(text.count, (b",", b"[", b"{"))) > MAX_VALUES:
        raise ValueError(f"its description has more than {MAX_VALUES} values")
    return text

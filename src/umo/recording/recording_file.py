"""Writes one file of a recording. A chunk contains at most one second on the machine's clock, and at most 1 MB."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from umo.process.frames.layout import Layout
from umo.process.frames.run_reader import Frames
from umo.recording.block import Block, columns_message, exact_message
from umo.recording.chunk_order import COLUMNS, EXACT
from umo.recording.extent import EXTENT, FOLLOWED, Extent
from umo.recording.mcap_records import McapChannel, Schema, message
from umo.recording.mcap_writer import McapWriter, Messages, PackedChunk
from umo.recording.recording import COLUMNS_TOPIC, EXACT_TOPIC, METADATA, describe

Times = npt.NDArray[np.int64]
CHUNK_TIME, CHUNK_BYTES = 1.0, 1 << 20
"""Largest span of a chunk in s on the machine's clock, and largest number of its bytes. One damaged place can destroy
at most one chunk."""
ENCODING = "umo"
"""Encoding of the messages (`umo.recording.block`)."""


class OtherChannels(Protocol):
    """Channels for tools of other projects."""

    @property
    def schemas(self) -> Sequence[Schema]:
        """The schemas of these channels."""

    @property
    def channels(self) -> Sequence[McapChannel]:
        """The channels."""

    @property
    def metadata(self) -> Sequence[tuple[str, dict[str, str]]]:
        """Metadata records, each with its name."""

    def messages(self, block: Block, times: Times) -> list[Messages]:
        """Return the messages of a block. `times`: the UTC of the block's frames in ns since 1970."""


def utc_of(layout: Layout, frames: Frames) -> Times:
    """Return the UTC of frames in ns since 1970. For a run in virtual time it is the UTC of the start plus the virtual
    time since then."""
    if layout.about.get("realtime", True):
        return np.asarray(frames["began"] + frames["utc"], np.int64)
    started = int(layout.about.get("started", 0.0) * 1e9)
    return started + np.rint(frames["time"] * 1e9).astype(np.int64)


class RecordingFile:
    """A new file. Raises OSError if the file cannot be created or written. Added blocks are visible to umo's readers
    immediately, and to other readers when the file is closed."""

    def __init__(self, path: Path, layout: Layout, others: OtherChannels | None = None, *, part: int = 1) -> None:
        self._layout, self._others = layout, others
        channels = [McapChannel(EXACT, EXACT_TOPIC, ENCODING), McapChannel(COLUMNS, COLUMNS_TOPIC, ENCODING)]
        schemas: list[Schema] = []
        metadata = [(METADATA, describe(layout, part))]
        if others is not None:
            channels += others.channels
            schemas += others.schemas
            metadata += others.metadata
        self._writer = McapWriter(path, metadata, schemas, channels)
        self._sequence = 0
        self._extent: Extent | None = None
        self._longest = CHUNK_TIME - float(layout.about.get("period") or 0.001) / 2
        """Largest time in s from the first period of a chunk to its last one. It is reduced if a chunk would have too
        many bytes."""
        self.path = path

    @property
    def size(self) -> int:
        """Number of bytes of the file."""
        return self._writer.size

    @property
    def span(self) -> float:
        """The time in s from the first message of the file to its last one."""
        first, last = self._writer.span
        return (last - first) * 1e-9

    def add(self, blocks: Sequence[Block]) -> None:
        """Add blocks, in one write."""
        self._writer.add([chunk for group in self._groups(blocks) for chunk in self._packed(group)])
        for block in blocks:
            self._extent = Extent.of(block).after(self._extent)

    def _groups(self, blocks: Sequence[Block]) -> Iterator[list[Block]]:
        """Yield groups of blocks, each of which becomes a chunk. Blocks that are too long are split."""
        group: list[Block] = []
        for block in blocks:
            rest: Block | None = block
            while rest is not None:
                part, rest = _within(rest, self._longest)
                if group and part.frames["time"][-1] - group[0].frames["time"][0] > self._longest:
                    yield group
                    group = []
                group.append(part)
        if group:
            yield group

    def _packed(self, group: list[Block]) -> list[PackedChunk]:
        """Return a group of blocks as one chunk, or as several chunks if one would be too large."""
        others = copy(self._others)  # it knows what was told last
        chunk = self._writer.pack(self._messages(group, others))
        if chunk.compressed > CHUNK_BYTES and (len(group) > 1 or len(group[0].frames) > 1):
            self._longest = max(float(group[-1].frames["time"][-1] - group[0].frames["time"][0]) / 2, 0.0)
            halves = (
                (group[:1], group[1:]) if len(group) > 1 else map(_alone, group[0].split(len(group[0].frames) // 2))
            )
            return [packed for half in halves for packed in self._packed(half)]
        self._others = others
        return [chunk]

    def _messages(self, group: Sequence[Block], others: OtherChannels | None) -> list[Messages]:
        parts: list[Messages] = []
        exact, columns = _Collected(EXACT), _Collected(COLUMNS)
        for block in group:
            times = utc_of(self._layout, block.frames)
            self._sequence += 1
            exact.add(self._sequence, int(times[0]), exact_message(block))
            if block.is_full:
                columns.add(self._sequence, int(times[0]), columns_message(block, self._layout))
            if others is not None and block.is_full:
                parts += others.messages(block, times)
        return [exact.messages(), *([columns.messages()] if columns.times else []), *merged(parts)]

    def close(self, *, followed: bool = False) -> None:
        """Write the summary for other readers, the number of periods, and whether another file follows. Raises OSError
        if there is no room for these."""
        told = {FOLLOWED: "yes"} if followed else {}
        self._writer.close([] if self._extent is None else [(EXTENT, self._extent.texts | told)])


def _within(block: Block, longest: float) -> tuple[Block, Block | None]:
    """Divide a block. The first part spans at most `longest` s from its first period to its last one, but has at least
    one period. The second part is the rest, or None if there is none."""
    times = block.frames["time"]
    row = int(np.searchsorted(times, times[0] + longest, side="right"))
    row = max(row, 1)
    return block.split(row) if row < len(times) else (block, None)


def _alone(block: Block) -> list[Block]:
    return [block]


class _Collected:
    """Collects messages of one channel."""

    def __init__(self, channel: int) -> None:
        self._channel = channel
        self._data = bytearray()
        self._rows: list[tuple[int, int]] = []
        self.times: list[int] = []

    def add(self, sequence: int, time: int, data: bytes) -> None:
        self._rows.append((time, len(self._data)))
        self.times.append(time)
        self._data += message(self._channel, sequence, time, data)

    def messages(self) -> Messages:
        return Messages(self._channel, self._data, self._rows, len(self._rows), min(self.times), max(self.times))


def merged(parts: Sequence[Messages]) -> list[Messages]:
    """Merge messages into one `Messages` for each channel."""
    by_channel: dict[int, list[Messages]] = {}
    for part in parts:
        by_channel.setdefault(part.channel, []).append(part)
    return [each[0] if len(each) == 1 else _joined(each) for each in by_channel.values()]


def _joined(parts: Sequence[Messages]) -> Messages:
    data, rows = bytearray(), bytearray()
    for part in parts:
        table = np.frombuffer(part.rows, "<u8") if isinstance(part.rows, bytes) else np.array(part.rows, "<u8")
        rows += (table.reshape(-1, 2) + np.array([0, len(data)], "<u8")).astype("<u8").tobytes()
        data += part.data
    return Messages(
        parts[0].channel, data, bytes(rows), sum(part.count for part in parts),
        min(part.first for part in parts), max(part.last for part in parts),
    )  # fmt: skip

"""Writing one file of a recording: one chunk for the frames of about a second."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from umo.frames.layout import Layout
from umo.frames.reader import Frames
from umo.recording.block import Block, columns_message, exact_message
from umo.recording.mcap_records import McapChannel, Schema, message
from umo.recording.mcap_writer import McapWriter, Messages
from umo.recording.recording import COLUMNS_TOPIC, EXACT_TOPIC, METADATA, describe

Times = npt.NDArray[np.int64]
EXACT, COLUMNS = 1, 2
"""Numbers of these channels; those of others follow."""
FIRST_OTHER = 3
ENCODING = "umo"
"""Encoding of their messages (`umo.recording.block`)."""


class OtherChannels(Protocol):
    """Channels for other people's tools."""

    @property
    def schemas(self) -> Sequence[Schema]:
        """Their schemas."""

    @property
    def channels(self) -> Sequence[McapChannel]:
        """The channels."""

    @property
    def metadata(self) -> Sequence[tuple[str, dict[str, str]]]:
        """Metadata records, each with its name."""

    def messages(self, block: Block, times: Times) -> list[Messages]:
        """The messages of a block; `times`: UTC of its frames, ns since 1970."""


def utc_of(layout: Layout, frames: Frames) -> Times:
    """UTC of frames, ns since 1970; of a run in virtual time that of its start, and its own time since then."""
    if layout.about.get("realtime", True):
        return np.asarray(frames["began"] + frames["utc"], np.int64)
    started = int(layout.about.get("started", 0.0) * 1e9)
    return started + np.rint(frames["time"] * 1e9).astype(np.int64)


class RecordingFile:
    """A new file; OSError where it cannot be made or written. It is whole after each call."""

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
        self.path = path

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self._writer.size

    @property
    def span(self) -> float:
        """The time in s from its first message to its last one."""
        first, last = self._writer.span
        return (last - first) * 1e-9

    def add(self, blocks: Sequence[Block]) -> None:
        """Add blocks as one chunk."""
        parts: list[Messages] = []
        exact, columns = _Collected(EXACT), _Collected(COLUMNS)
        for block in blocks:
            times = utc_of(self._layout, block.frames)
            self._sequence += 1
            exact.add(self._sequence, int(times[0]), exact_message(block))
            if block.is_full:
                columns.add(self._sequence, int(times[0]), columns_message(block, self._layout))
            if self._others is not None and block.is_full:
                parts += self._others.messages(block, times)
        self._writer.add([exact.messages(), *([columns.messages()] if columns.times else []), *merged(parts)])

    def close(self) -> None:
        self._writer.close()


class _Collected:
    """Messages of one channel."""

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
    """One `Messages` for each channel."""
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

"""Writes an MCAP file by adding chunks. Each chunk is synced to the disk immediately; summary and footer follow when
the file is closed. If the process is killed before that, the file lacks these two, but umo still reads all its
chunks."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard

from umo.recording import mcap_records
from umo.recording.mcap_reader import messages_in
from umo.recording.mcap_records import ChunkIndex, McapChannel, Opcode, Schema

LIBRARY = "umo"
LEVEL = 3
"""Level of compression of zstd."""
MODE = 0o600
"""Access mode of the file. The file contains the text of the wiring, and the commands of clients with their keys."""
LARGE = 4 << 20
"""Size in bytes of a chunk above which it is compressed with level 1, to save time."""


@dataclass(frozen=True)
class Messages:
    """Messages of one channel as stored in a chunk."""

    channel: int
    data: bytes | bytearray | memoryview
    """The records of the messages, one after the other."""
    rows: Sequence[tuple[int, int]] | bytes
    """Log time in ns and offset in `data` of each record, as 16 bytes for each record."""
    count: int
    first: int
    last: int
    """The smallest and the largest log time."""


class PackedChunk(NamedTuple):
    """A chunk in the form of the file, without its message indexes."""

    record: bytes
    compressed: int
    """Number of bytes of the compressed content."""
    size: int
    first: int
    last: int
    rows: dict[int, bytes]
    """The rows of the message index of each channel."""


class McapWriter:
    """Creates a file, which must not exist yet. Raises OSError if the file cannot be created. If a method raises
    OSError, the earlier chunks remain."""

    def __init__(
        self,
        path: Path,
        metadata: Sequence[tuple[str, dict[str, str]]],
        schemas: Sequence[Schema],
        channels: Sequence[McapChannel],
        *,
        level: int = LEVEL,
    ) -> None:
        self.path = path
        self._schemas = b"".join(map(mcap_records.schema, schemas))
        self._channels = b"".join(map(mcap_records.channel, channels))
        self._sizes = len(schemas), len(channels)
        self._compressors = zstandard.ZstdCompressor(level=level), zstandard.ZstdCompressor(level=1)
        self._indexes: list[bytes] = []
        self._metadata: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        self._checksum = 0
        self.end = 0
        """Offset at which the data end."""
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, MODE)
        try:
            start = bytearray(mcap_records.header(LIBRARY))
            for name, texts in metadata:
                start += self._indexed_metadata(len(start), name, texts)
            self._append(bytes(start) + self._schemas + self._channels)
        except BaseException:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise

    @property
    def size(self) -> int:
        """Number of bytes of the file, without summary and footer."""
        return self.end

    @property
    def span(self) -> tuple[int, int]:
        """The smallest and the largest log time in ns."""
        return self._span or (0, 0)

    def pack(self, parts: Sequence[Messages]) -> PackedChunk:
        """Return one chunk with these messages, for `add`."""
        content = b"".join([part.data for part in parts])
        compressed = self._compressors[len(content) > LARGE].compress(content)
        first, last = min(part.first for part in parts), max(part.last for part in parts)
        record = mcap_records.chunk(first, last, len(content), zlib.crc32(content), compressed)
        rows, at = {}, 0
        for part in parts:
            rows[part.channel] = _moved(part.rows, at)
            at += len(part.data)
        return PackedChunk(record, len(compressed), len(content), first, last, rows)

    def add(self, chunks: Sequence[PackedChunk]) -> None:
        """Add chunks, in one write."""
        data, indexes = bytearray(), []
        counts, span = dict(self._counts), self._span
        for each in chunks:
            index, added = _laid(each, self.end + len(data))
            data += added
            indexes.append(mcap_records.chunk_index(index))
            for channel, rows in each.rows.items():
                counts[channel] = counts.get(channel, 0) + len(rows) // 16
            span = (each.first, each.last) if span is None else (min(span[0], each.first), max(span[1], each.last))
        self._append(bytes(data))
        self._indexes += indexes
        self._counts, self._span = counts, span

    def _append(self, data: bytes, end: bytes = b"") -> None:
        """Append data, and `end` after them. If the disk has room for only a part, this part is removed again."""
        view, at = memoryview(data + end), self.end
        try:
            while view:
                written = os.pwrite(self._file, view, at)
                view, at = view[written:], at + written
            os.fdatasync(self._file)
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._file, self.end)
            raise
        self._checksum = zlib.crc32(data, self._checksum)
        self.end += len(data)

    def close(self, metadata: Sequence[tuple[str, dict[str, str]]] = ()) -> None:
        """Write the metadata, the summary and the footer. Raises OSError if there is no room for them. The file then
        keeps its chunks and remains incomplete. A second call does nothing."""
        if self._file < 0:
            return
        try:
            made = bytearray()
            for name, texts in metadata:
                made += self._indexed_metadata(self.end + len(made), name, texts)
            self._append(bytes(made), self._closing(self.end + len(made), zlib.crc32(made, self._checksum)))
        finally:
            self._release()

    def _release(self) -> None:
        """Close the descriptor, and forget its number, because another file may get the same number afterwards."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def discard(self) -> None:
        """Close the file without completing it."""
        self._release()
        self.path.unlink(missing_ok=True)

    def _indexed_metadata(self, at: int, name: str, texts: dict[str, str]) -> bytes:
        made = mcap_records.metadata(name, texts)
        self._metadata.append(mcap_records.metadata_index(at, len(made), name))
        return made

    def _closing(self, at: int, checksum: int) -> bytes:
        schemas, channels = self._sizes
        first, last = self.span
        statistics = mcap_records.statistics(
            self._counts, schemas=schemas, channels=channels, metadata=len(self._metadata), chunks=len(self._indexes),
            first=first, last=last,
        )  # fmt: skip
        groups = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, statistics),
            (Opcode.CHUNK_INDEX, b"".join(self._indexes)),
            (Opcode.METADATA_INDEX, b"".join(self._metadata)),
        ]
        return mcap_records.closing(at, checksum, groups)


def repacked(record: bytes, content: bytes) -> PackedChunk:
    """Return a chunk with this content, taken from another file with the same channels. The index of the chunk is made
    anew."""
    head = mcap_records.read_chunk(memoryview(record)[mcap_records.HEAD.size :], len(record) - mcap_records.HEAD.size)
    rows: dict[int, bytearray] = {}
    times, at, before = [], 0, mcap_records.MESSAGE.size + mcap_records.HEAD.size
    for each in messages_in(content):
        rows.setdefault(each.channel, bytearray()).extend(mcap_records.INDEXED.pack(each.time, at))
        times.append(each.time)
        at += before + len(each.data)
    first, last = min(times, default=0), max(times, default=0)
    made = {channel: bytes(each) for channel, each in rows.items()}
    data = memoryview(record)[mcap_records.HEAD.size + head.begin :]  # the times in its head have no checksum
    if head.compression:
        record = mcap_records.chunk(first, last, head.size, head.checksum, bytes(data))
    return PackedChunk(record, head.length, head.size, first, last, made)


def _laid(chunk: PackedChunk, at: int) -> tuple[ChunkIndex, bytes]:
    """Return the index of a chunk that will be written at this offset, and the chunk's bytes with its message
    indexes."""
    data, places = bytearray(chunk.record), {}
    for channel, rows in chunk.rows.items():
        places[channel] = at + len(data)
        data += mcap_records.message_index(channel, rows)
    length = len(chunk.record)
    return ChunkIndex(
        chunk.first, chunk.last, at, length, places, len(data) - length, chunk.compressed, chunk.size
    ), bytes(data)  # fmt: skip


def _moved(rows: Sequence[tuple[int, int]] | bytes, by: int) -> bytes:
    table = np.frombuffer(rows, "<u8").reshape(-1, 2) if isinstance(rows, bytes) else np.array(rows, "<u8")
    return bytes((table + np.array([0, by], "<u8")).astype("<u8").tobytes())

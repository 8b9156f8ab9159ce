"""An MCAP file that is whole after each write: chunk, end of data, summary and footer land together, over the end that
stood there before. Whoever is killed between two writes leaves a file that every reader opens."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zstandard

from umo.recording import mcap_records
from umo.recording.mcap_records import ChunkIndex, McapChannel, Opcode, Schema

LIBRARY = "umo"
LEVEL = 3
"""Level of compression of zstd."""
MODE = 0o600
"""Of the file: it has the text of the wiring and the commands of clients with their keys."""
LARGE = 4 << 20
"""Bytes of a chunk above which time counts more than size: its level is 1."""


@dataclass(frozen=True)
class Messages:
    """Messages of one channel as they stand in a chunk."""

    channel: int
    data: bytes | bytearray | memoryview
    """The records, one after the other."""
    rows: Sequence[tuple[int, int]] | bytes
    """Log time in ns and offset in `data` of each; as bytes, 16 each."""
    count: int
    first: int
    last: int
    """The least and the greatest log time."""


class McapWriter:
    """Makes a file, which must not be there yet; OSError where that cannot be. Each method leaves it whole, or as it
    was before if it raises OSError."""

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
        self._sizes = len(schemas), len(channels), len(metadata)
        self._compressors = zstandard.ZstdCompressor(level=level), zstandard.ZstdCompressor(level=1)
        self._indexes: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        start = bytearray(mcap_records.header(LIBRARY))
        self._metadata = b""
        for name, texts in metadata:
            each = mcap_records.metadata(name, texts)
            self._metadata += mcap_records.metadata_index(len(start), len(each), name)
            start += each
        start += self._schemas + self._channels
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, MODE)
        self.end = 0
        """Offset at which the data end."""
        self.size = 0
        """Bytes of the file."""
        try:
            self._write(bytes(start), [], self._counts, None)
        except BaseException:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise

    @property
    def span(self) -> tuple[int, int]:
        """The least and the greatest log time in ns."""
        return self._span or (0, 0)

    def add(self, parts: Sequence[Messages]) -> None:
        """Add one chunk with these messages."""
        content = b"".join([part.data for part in parts])
        compressed = self._compressors[len(content) > LARGE].compress(content)
        first, last = min(part.first for part in parts), max(part.last for part in parts)
        head = mcap_records.chunk(first, last, len(content), zlib.crc32(content), compressed)
        indexes, places, at = bytearray(), {}, 0
        for part in parts:
            places[part.channel] = self.end + len(head) + len(indexes)
            indexes += mcap_records.message_index(part.channel, _moved(part.rows, at))
            at += len(part.data)
        index = ChunkIndex(first, last, self.end, len(head), places, len(indexes), len(compressed), len(content))
        counts = dict(self._counts)
        for part in parts:
            counts[part.channel] = counts.get(part.channel, 0) + part.count
        span = (first, last) if self._span is None else (min(first, self._span[0]), max(last, self._span[1]))
        self._write(head + bytes(indexes), [mcap_records.chunk_index(index)], counts, span)

    def add_raw(self, chunks: Sequence[bytes]) -> None:
        """Add chunks as they stand in another file with the same channels, each with its message indexes."""
        data, indexes, counts = bytearray(), [], dict(self._counts)
        first, last = self._span or (1 << 63, 0)
        for each in chunks:
            index, numbers = _indexed(each, self.end + len(data))
            indexes.append(mcap_records.chunk_index(index))
            for channel, count in numbers.items():
                counts[channel] = counts.get(channel, 0) + count
            first, last = min(first, index.first), max(last, index.last)
            data += each
        if chunks:
            self._write(bytes(data), indexes, counts, (first, last))

    def _write(self, data: bytes, indexes: list[bytes], counts: dict[int, int], span: tuple[int, int] | None) -> None:
        """Write data and the new end of the file. What fits only in part is taken back: the old end is written again,
        for which there was room."""
        end = self._closing(self.end + len(data), indexes, counts, span)
        try:
            self._put(data + end)
        except OSError:
            if self.size:
                self._take_back()
            raise
        self.end += len(data)
        self.size = self.end + len(end)
        self._indexes += indexes
        self._counts, self._span = counts, span

    def _take_back(self) -> None:
        self._put(self._closing(self.end, [], self._counts, self._span))
        os.ftruncate(self._file, self.size)

    def _closing(self, at: int, indexes: list[bytes], counts: dict[int, int], span: tuple[int, int] | None) -> bytes:
        schemas, channels, metadata = self._sizes
        first, last = span or (0, 0)
        chunks = [*self._indexes, *indexes]
        statistics = mcap_records.statistics(
            counts, schemas=schemas, channels=channels, metadata=metadata, chunks=len(chunks), first=first, last=last
        )
        return mcap_records.closing(
            at,
            [
                (Opcode.SCHEMA, self._schemas),
                (Opcode.CHANNEL, self._channels),
                (Opcode.STATISTICS, statistics),
                (Opcode.CHUNK_INDEX, b"".join(chunks)),
                (Opcode.METADATA_INDEX, self._metadata),
            ],
        )

    def _put(self, data: bytes) -> None:
        """Write at the end of the data, in one call wherever the system takes it whole, and bring it to the disk."""
        view, at = memoryview(data), self.end
        while view:
            written = os.pwrite(self._file, view, at)
            view, at = view[written:], at + written
        os.fdatasync(self._file)

    def close(self) -> None:
        os.close(self._file)


def _indexed(chunk: bytes, at: int) -> tuple[ChunkIndex, dict[int, int]]:
    """The index of a chunk that comes to lie at this offset, and the number of messages of each channel."""
    head, *indexes = mcap_records.records(memoryview(chunk))
    raw, length = mcap_records.read_chunk(head.body), mcap_records.HEAD.size + len(head.body)
    places, counts = {}, {}
    for each in indexes:
        channel, size = mcap_records.MESSAGE_INDEX.unpack_from(each.body)
        places[channel], counts[channel] = at + each.at, size // 16
    rest = len(chunk) - length
    return ChunkIndex(raw.first, raw.last, at, length, places, rest, len(raw.data), raw.size), counts


def _moved(rows: Sequence[tuple[int, int]] | bytes, by: int) -> bytes:
    table = np.frombuffer(rows, "<u8").reshape(-1, 2) if isinstance(rows, bytes) else np.array(rows, "<u8")
    return bytes((table + np.array([0, by], "<u8")).astype("<u8").tobytes())

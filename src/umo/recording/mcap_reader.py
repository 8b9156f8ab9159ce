"""The chunks and metadata of an MCAP file of a recording, also of one that was cut or torn in its last write."""

from __future__ import annotations

import mmap
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import zstandard

from umo.errors import FramesError
from umo.recording import mcap_records
from umo.recording.mcap_records import McapChannel, Opcode, RawChunk, Schema

MAX_CHUNK = 1 << 30
"""Bytes of a chunk that are taken for sound."""


class McapMessage(NamedTuple):
    """A message of a chunk."""

    channel: int
    sequence: int
    time: int
    """ns since 1970."""
    data: memoryview


class McapReader:
    """Reads a file as far as it is sound; FramesError if it is no recording at all."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._map: mmap.mmap | bytes = b""
        try:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise FramesError(f"{path}: {error.strerror}") from None
        try:
            if not stat.S_ISREG(os.fstat(file).st_mode):
                raise FramesError(f"{path} is not a recording: it is no file")
            if os.fstat(file).st_size:
                self._map = mmap.mmap(file, 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise FramesError(f"{path} cannot be read: {error}") from None
        finally:
            os.close(file)
        self.data = memoryview(self._map)
        if bytes(self.data[: len(mcap_records.MAGIC)]) != mcap_records.MAGIC:
            self.close()
            raise FramesError(f"{path} is not a recording: it is no MCAP file")
        end = mcap_records.data_end(self.data)
        self.is_whole = end is not None
        """Whether it ends as it should. One that is not was cut or torn; what it still holds is read."""
        self.metadata: dict[str, dict[str, str]] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, McapChannel] = {}
        self.chunks: list[int] = []
        """Offsets of the chunks, in the order in which they were written."""
        self.end = len(mcap_records.MAGIC)
        """Offset at which its sound data end."""
        with suppress(ValueError, struct.error, IndexError):
            self._walk(self.data[:end])

    def _walk(self, data: memoryview) -> None:
        """`data`: of a whole file as far as its summary goes: what is behind may be written over at this moment."""
        for each in mcap_records.records(data, self.end):
            if each.opcode == Opcode.DATA_END:
                return
            if each.opcode == Opcode.CHUNK:
                if not self.is_whole:
                    self.chunk(each.at)  # ValueError: what follows is of an older end
                self.chunks.append(each.at)
            elif each.opcode == Opcode.METADATA:
                name, texts = mcap_records.read_metadata(each.body)
                self.metadata[name] = texts
            elif each.opcode == Opcode.CHANNEL:
                channel = mcap_records.read_channel(each.body)
                self.channels[channel.number] = channel
            elif each.opcode == Opcode.SCHEMA:
                schema = mcap_records.read_schema(each.body)
                self.schemas[schema.number] = schema
            elif each.opcode not in (Opcode.HEADER, Opcode.MESSAGE_INDEX):
                return
            self.end = each.at + mcap_records.HEAD.size + len(each.body)

    def head(self, at: int) -> RawChunk:
        """The head of the chunk at an offset. ValueError if it is damaged."""
        each = next(mcap_records.records(self.data, at), None)
        if each is None:
            raise ValueError("a chunk is cut short")
        return mcap_records.read_chunk(each.body)

    def chunk(self, at: int) -> bytes:
        """The content of the chunk at an offset. ValueError if it is damaged."""
        raw = self.head(at)
        if raw.size > MAX_CHUNK:
            raise ValueError("a chunk is damaged")
        try:
            content = _content(raw)
        except (zstandard.ZstdError, MemoryError) as error:
            raise ValueError(f"a chunk is damaged: {error}") from None
        if raw.checksum and zlib.crc32(content) != raw.checksum:
            raise ValueError("a chunk is damaged: its checksum does not fit")
        return content

    def raw(self, at: int) -> bytes:
        """The chunk at an offset as it stands in the file, with its message indexes."""
        found = mcap_records.records(self.data, at)
        chunk = next(found)
        end = at + mcap_records.HEAD.size + len(chunk.body)
        for each in found:
            if each.opcode != Opcode.MESSAGE_INDEX:
                break
            end = each.at + mcap_records.HEAD.size + len(each.body)
        return bytes(self.data[at:end])

    def messages(self, at: int) -> Iterator[McapMessage]:
        """The messages of a chunk. ValueError if it is damaged."""
        head = mcap_records.MESSAGE.size
        for each in mcap_records.records(memoryview(self.chunk(at))):
            if each.opcode == Opcode.MESSAGE:
                channel, sequence, time, _ = mcap_records.MESSAGE.unpack_from(each.body)
                yield McapMessage(channel, sequence, time, each.body[head:])

    def topic(self, name: str) -> int:
        """The number of the channel of a topic; 0: there is none."""
        return next((each.number for each in self.channels.values() if each.topic == name), 0)

    def close(self) -> None:
        self.data.release()
        if isinstance(self._map, mmap.mmap):
            with suppress(BufferError):  # messages are still held
                self._map.close()


def _content(raw: RawChunk) -> bytes:
    if raw.compression == "zstd":
        return bytes(zstandard.ZstdDecompressor().decompress(raw.data, max_output_size=max(raw.size, 1)))
    if raw.compression:
        raise ValueError(f"chunks compressed by {raw.compression} are not read")
    return bytes(raw.data)

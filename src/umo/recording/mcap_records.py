"""Records of MCAP, the container of recordings (mcap.dev/spec). Each record consists of an opcode, a length and a body,
little-endian."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Head of a record: opcode and length of the body."""
MESSAGE = struct.Struct("<HIQQ")
"""Head of a message: channel, sequence, log time and publish time in ns since 1970. The data follow."""
FOOTER = struct.Struct("<QQI")
"""Footer: offsets of the summary and of its offsets, CRC-32 of the summary."""
FOOTER_BYTES, DATA_END_BYTES = HEAD.size + FOOTER.size + len(MAGIC), HEAD.size + 4
MESSAGE_INDEX = struct.Struct("<HI")
"""Head of a message index: channel, and number of bytes of the rows that follow."""
MAX_TEXTS = 200_000
"""Largest number of strings that are read from a mapping."""
INDEXED = struct.Struct("<QQ")
"""A row of a message index: log time in ns, offset in the content of the chunk."""
_CHUNK = struct.Struct("<QQQI")
_STATISTICS = struct.Struct("<QHIIIIQQ")
_INDEX_ROW = struct.Struct("<HQ")


class Opcode(IntEnum):
    """The kinds of records."""

    HEADER = 1
    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    MESSAGE_INDEX = 7
    CHUNK_INDEX = 8
    STATISTICS = 11
    METADATA = 12
    METADATA_INDEX = 13
    SUMMARY_OFFSET = 14
    DATA_END = 15


class McapChannel(NamedTuple):
    """A channel, and the schema of its messages; schema 0 means none."""

    number: int
    topic: str
    encoding: str
    schema: int = 0
    metadata: Mapping[str, str] = {}


class Schema(NamedTuple):
    number: int
    name: str
    encoding: str
    data: bytes


class ChunkIndex(NamedTuple):
    """The place of a chunk, and the times of its messages."""

    first: int
    last: int
    at: int
    length: int
    indexes: Mapping[int, int]
    """Offset of the message index of each channel."""
    index_length: int
    compressed: int
    size: int


class RawRecord(NamedTuple):
    """A record as stored in a file: the offset of its opcode, and its body."""

    at: int
    opcode: int
    body: memoryview


def record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def string(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def mapping(texts: Mapping[str, str]) -> bytes:
    body = b"".join(string(key) + string(value) for key, value in texts.items())
    return struct.pack("<I", len(body)) + body


def header(library: str) -> bytes:
    return MAGIC + record(Opcode.HEADER, string("") + string(library))


def schema(each: Schema) -> bytes:
    head = struct.pack("<H", each.number) + string(each.name) + string(each.encoding)
    return record(Opcode.SCHEMA, head + struct.pack("<I", len(each.data)) + each.data)


def channel(each: McapChannel) -> bytes:
    head = struct.pack("<HH", each.number, each.schema) + string(each.topic) + string(each.encoding)
    return record(Opcode.CHANNEL, head + mapping(each.metadata))


def message(channel: int, sequence: int, time: int, data: bytes) -> bytes:
    return record(Opcode.MESSAGE, MESSAGE.pack(channel, sequence & 0xFFFFFFFF, time, time) + data)


def metadata(name: str, texts: Mapping[str, str]) -> bytes:
    return record(Opcode.METADATA, string(name) + mapping(texts))


def metadata_index(at: int, length: int, name: str) -> bytes:
    return record(Opcode.METADATA_INDEX, struct.pack("<QQ", at, length) + string(name))


def chunk(first: int, last: int, size: int, checksum: int, compressed: bytes) -> bytes:
    head = _CHUNK.pack(first, last, size, checksum) + string("zstd") + struct.pack("<Q", len(compressed))
    return HEAD.pack(Opcode.CHUNK, len(head) + len(compressed)) + head + compressed


def chunk_index(each: ChunkIndex) -> bytes:
    rows = b"".join(_INDEX_ROW.pack(*row) for row in each.indexes.items())
    head = struct.pack("<QQQQI", each.first, each.last, each.at, each.length, len(rows))
    tail = struct.pack("<Q", each.index_length) + string("zstd") + struct.pack("<QQ", each.compressed, each.size)
    return record(Opcode.CHUNK_INDEX, head + rows + tail)


def message_index(channel: int, rows: bytes) -> bytes:
    """Return a message index. `rows`: for each message its log time and its offset in the chunk, in 16 bytes."""
    return record(Opcode.MESSAGE_INDEX, MESSAGE_INDEX.pack(channel, len(rows)) + rows)


def statistics(
    counts: Mapping[int, int], *, schemas: int, channels: int, metadata: int, chunks: int, first: int, last: int
) -> bytes:
    rows = b"".join(_INDEX_ROW.pack(*row) for row in counts.items())
    head = _STATISTICS.pack(sum(counts.values()), schemas, channels, 0, metadata, chunks, first, last)
    return record(Opcode.STATISTICS, head + struct.pack("<I", len(rows)) + rows)


def closing(at: int, checksum: int, groups: Sequence[tuple[Opcode, bytes]]) -> bytes:
    """Return the bytes after the data of a file: the record for the end of the data, the summary, the footer and the
    magic. The data end at this offset. `checksum`: CRC-32 of everything before."""
    end = record(Opcode.DATA_END, struct.pack("<I", checksum))
    start = at + len(end)
    offsets, place = [], start
    for opcode, group in groups:
        if group:
            offsets.append(record(Opcode.SUMMARY_OFFSET, struct.pack("<BQQ", opcode, place, len(group))))
        place += len(group)
    summary = b"".join([*(group for _, group in groups), *offsets])
    begun = HEAD.pack(Opcode.FOOTER, FOOTER.size) + struct.pack("<QQ", start, place)
    return end + summary + begun + struct.pack("<I", zlib.crc32(begun, zlib.crc32(summary))) + MAGIC


# Reading -----------------------------------------------------------------------------------------------


def records(data: memoryview, at: int = 0) -> Iterator[RawRecord]:
    """Yield the records from an offset on, up to the first incomplete one."""
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        body = at + HEAD.size
        if not opcode or length > len(data) - body:
            return
        yield RawRecord(at, opcode, data[body : body + length])
        at = body + length


def read_part(body: memoryview, at: int) -> tuple[memoryview, int]:
    """Return the content of the part at an offset, and the offset of its end. A part begins with the length of its
    content. Raises ValueError if the part is not complete."""
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    if end > len(body):
        raise ValueError("a length exceeds its record")
    return body[at + 4 : end], end


def read_string(body: memoryview, at: int) -> tuple[str, int]:
    text, end = read_part(body, at)
    return str(text, "utf-8"), end


def read_mapping(body: memoryview, at: int) -> tuple[dict[str, str], int]:
    rows, end = read_part(body, at)
    place, texts = 0, dict[str, str]()
    while place < len(rows):
        if len(texts) >= MAX_TEXTS:
            raise ValueError(f"a mapping has more than {MAX_TEXTS} texts")
        key, place = read_string(rows, place)
        texts[key], place = read_string(rows, place)
    return texts, end


def read_metadata(body: memoryview) -> tuple[str, dict[str, str]]:
    name, at = read_string(body, 0)
    texts, end = read_mapping(body, at)
    if end != len(body):
        raise ValueError("a length is too short for its fields")
    return name, texts


def read_channel(body: memoryview) -> McapChannel:
    number, schema = struct.unpack_from("<HH", body)
    topic, at = read_string(body, 4)
    encoding, at = read_string(body, at)
    return McapChannel(number, topic, encoding, schema, read_mapping(body, at)[0])


def read_schema(body: memoryview) -> Schema:
    (number,) = struct.unpack_from("<H", body)
    name, at = read_string(body, 2)
    encoding, at = read_string(body, at)
    return Schema(number, name, encoding, bytes(read_part(body, at)[0]))


class ChunkHead(NamedTuple):
    """The head of a chunk, and the place of the compressed content in its body."""

    first: int
    last: int
    size: int
    checksum: int
    compression: str
    begin: int
    length: int


CHUNK_HEAD_BYTES = _CHUNK.size + 4 + 16 + 8
"""Largest number of bytes of the head in a body. The name of the compression has at most 16 of them."""


def read_chunk(body: memoryview, length: int) -> ChunkHead:
    """Return the head of a chunk, read from the beginning of its body. `length` is the length of the body. Raises
    ValueError if the two do not fit."""
    first, last, size, checksum = _CHUNK.unpack_from(body)
    compression, at = read_string(body, _CHUNK.size)
    (content,) = struct.unpack_from("<Q", body, at)
    if at + 8 + content != length:
        raise ValueError("a chunk is cut short")
    return ChunkHead(first, last, size, checksum, compression, at + 8, content)


class ChunkPlace(NamedTuple):
    """The place of a chunk, as in the summary of a file."""

    first: int
    last: int
    at: int
    length: int
    size: int
    """Number of bytes of the chunk's content."""


def read_chunk_index(body: memoryview) -> ChunkPlace:
    first, last, at, length, rows = struct.unpack_from("<QQQQI", body)
    _, end = read_string(body, 36 + rows + 8)
    (size,) = struct.unpack_from("<Q", body, end + 8)
    return ChunkPlace(first, last, at, length, size)


def read_counts(body: memoryview) -> dict[int, int]:
    """Return the number of messages of each channel from the statistics."""
    return dict(_INDEX_ROW.iter_unpack(read_part(body, _STATISTICS.size)[0]))


def read_metadata_index(body: memoryview) -> tuple[int, int, str]:
    """Return the offset, length and name of a metadata record."""
    at, length = struct.unpack_from("<QQ", body)
    return at, length, read_string(body, 16)[0]

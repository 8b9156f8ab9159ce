"""Reads the chunks and metadata of an MCAP file of a recording. The file may be incomplete, because it is being
written, was truncated, or its recorder was killed. A closed file is read through its summary, which has a checksum. A
chunk that is in the summary but not in the file counts as damage. In a file that is not closed, chunks are searched
from its beginning on, even after damaged places. Memory is bounded regardless of the sizes in a file.
"""

from __future__ import annotations

import errno
import os
import resource
import stat
import struct
import zlib
from array import array
from collections.abc import Container, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard

from umo.errors import FramesError
from umo.recording import mcap_records
from umo.recording.damaged_places import DamagedPlaces
from umo.recording.mcap_records import ChunkHead, ChunkPlace, McapChannel, Opcode, Schema

MAX_CONTENT = 64 << 20
"""Largest number of bytes of the content of a chunk."""
MAX_HELD = 32 << 20
"""Largest number of bytes of metadata, schemas and channels together."""
OVERHEAD = 1 << 10
"""Number of bytes that are added to the size of each metadata record, schema and channel when `MAX_HELD` is checked."""
MAX_CHUNKS = 1_000_000
MAX_MESSAGES = 100_000
"""Largest number of messages of the wanted channels in a chunk."""
MAX_WINDOW = 8 << 20
"""Largest number of bytes that a decompressor may keep in memory in addition to its result."""
PIECE = 1 << 20
"""Number of bytes of each read when a long part is read in pieces."""
SECTOR = 4096
"""Number of bytes of a sector of the disk. If one of its bytes cannot be read, the whole sector cannot."""
COMPRESSION = b"\x04\0\0\0zstd"
"""The name of the compression in a chunk. It stands after the first 28 bytes of the chunk's body."""
HELD = (Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL)


class McapMessage(NamedTuple):
    """A message of a chunk."""

    channel: int
    sequence: int
    time: int
    """Time in ns since 1970."""
    data: memoryview


class Unreadable(ValueError):
    """Raised if a sector of the disk cannot be read."""

    def __init__(self, at: int, error: OSError) -> None:
        super().__init__(f"it cannot be read: {error.strerror}")
        self.at = at
        """Offset of the data to be read."""


class McapReader:
    """Reads the valid parts of a file. Raises FramesError if it is not a recording."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = _opened(path)
        try:
            self.size = os.fstat(self._file).st_size
            """Size in bytes of the file when it was opened; data written later are not read."""
            try:
                magic = self._at(0, len(mcap_records.MAGIC))
            except Unreadable as error:
                raise FramesError(f"{path}, at byte 0: {error}") from None
            if magic != mcap_records.MAGIC:
                raise FramesError(f"{path} is not a recording: it is not an MCAP file")
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, McapChannel] = {}
        self.chunks: array[int] = array("q")
        """Offsets of the chunks, in the order in which they lie in the file."""
        self.damaged = DamagedPlaces()
        """The damage found so far."""
        self.counts: dict[int, int] = {}
        """The number of messages of each channel, if the file is closed; otherwise empty."""
        self.end = len(mcap_records.MAGIC)
        """Offset at which the last undamaged record ends."""
        self._held = 0
        try:
            self.is_whole = self._read_summary()
            """True if the file was closed and its summary is undamaged."""
        except Unreadable as error:
            self.damaged.add(error.at, str(error))
        if not self.is_whole:
            self._held = 0
            self._walk()

    is_whole = False

    # A closed file -------------------------------------------------------------------------------------

    def _read_summary(self) -> bool:
        """Read the summary. Return False if there is no valid summary."""
        footer = self.size - mcap_records.FOOTER_BYTES
        if footer < len(mcap_records.MAGIC):
            return False
        end = self._at(footer, mcap_records.FOOTER_BYTES)
        head = mcap_records.HEAD.unpack_from(end)
        if not end.endswith(mcap_records.MAGIC) or head != (Opcode.FOOTER, mcap_records.FOOTER.size):
            return False
        start, _, checksum = mcap_records.FOOTER.unpack_from(end, mcap_records.HEAD.size)
        if not len(mcap_records.MAGIC) <= start <= footer:
            return False
        if self._checksum(start, footer + mcap_records.HEAD.size + 16) != checksum:
            return False
        self._data_end = start - mcap_records.DATA_END_BYTES
        try:
            places = self._summary(start, footer)
        except Unreadable:
            raise
        except (ValueError, struct.error):  # another program's
            return False
        rows = np.frombuffer(places, np.uint64).reshape(-1, len(ChunkPlace._fields))
        for row in np.argsort(rows[:, ChunkPlace._fields.index("at")], kind="stable"):
            self._take(ChunkPlace(*rows[row].tolist()))
        return True

    def _summary(self, start: int, footer: int) -> array[int]:
        """Read the summary between two offsets. Return the places of the chunks as one array of numbers, in which a
        million chunks take 40 MB."""
        places, most = array("Q"), MAX_CHUNKS * len(ChunkPlace._fields)
        for at, opcode, length in self._records(start, footer):
            if opcode in (Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX, Opcode.STATISTICS) and length < PIECE:
                body = memoryview(self._at(at + mcap_records.HEAD.size, length))
                if opcode == Opcode.STATISTICS:
                    self.counts = mcap_records.read_counts(body)
                elif opcode == Opcode.CHUNK_INDEX:
                    places.extend(mcap_records.read_chunk_index(body))
                else:
                    self._take_metadata(*mcap_records.read_metadata_index(body))
            elif opcode in HELD:
                self._hold(at, opcode, length)
            if len(places) > most:
                raise FramesError(f"{self.path} is damaged: it claims more than {MAX_CHUNKS} chunks")
        return places

    def _take_metadata(self, at: int, length: int, name: str) -> None:
        try:
            found = next(self._records(at, self._data_end), None)
            if found != (at, Opcode.METADATA, length - mcap_records.HEAD.size):
                self.damaged.add(at, f"the metadata {name!r} are not there")
                return
            self._hold(*found)
        except (ValueError, struct.error) as error:
            self.damaged.add(at, f"the metadata {name!r} are damaged: {error}")

    def _take(self, place: ChunkPlace) -> None:
        """Add a chunk that the summary names. If the file does not contain it, record the damage."""
        try:
            head = self.head(place.at)
            length = head.begin + head.length + mcap_records.HEAD.size
            if (head.first, head.last, head.size, length) != (place.first, place.last, place.size, place.length):
                raise ValueError("it is not the chunk that the summary names")
        except ValueError as error:
            self.damaged.add(place.at, str(error))
        else:
            self.chunks.append(place.at)

    # A file that is not closed -------------------------------------------------------------------------

    def _walk(self) -> None:
        """Find the records from the beginning of the file on. After a damaged place, search for the next chunk."""
        at = self.end
        while at < self.size:
            if len(self.chunks) >= MAX_CHUNKS:
                self.damaged.add(at, f"no more than {MAX_CHUNKS:,} chunks are read")
                return
            found, why = None, "are not a record"
            try:
                found = next(self._records(at, self.size), None)
                is_known = found is not None and self._is_known(*found)
            except Unreadable:
                is_known, why = False, "cannot be read"
            if found is None or not is_known:
                end = self._next_chunk(at + 1)
                if self.chunks or end < self.size or why == "cannot be read":
                    self.damaged.add(at, f"{end - at} bytes {why}")
                at = end
                continue
            _, opcode, length = found
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            at += mcap_records.HEAD.size + length
            self.end = at

    def _is_known(self, at: int, opcode: int, length: int) -> bool:
        """Keep a record, or the place of a chunk. Return False if a recording has no such record. Raises Unreadable."""
        try:
            if opcode == Opcode.CHUNK:
                self.head(at)
                self.chunks.append(at)
            elif opcode in HELD:
                self._hold(at, opcode, length)
            elif opcode == Opcode.MESSAGE_INDEX and not self._is_message_index(at, length):
                return False
        except Unreadable:
            raise
        except (ValueError, struct.error):
            return False
        return opcode in (*HELD, Opcode.CHUNK, Opcode.HEADER, Opcode.MESSAGE_INDEX, Opcode.DATA_END, Opcode.FOOTER)

    def _is_message_index(self, at: int, length: int) -> bool:
        """True if the length of a message index matches its rows. Otherwise its length is damaged, and a chunk may lie
        within that length."""
        head = self._at(at + mcap_records.HEAD.size, mcap_records.MESSAGE_INDEX.size)
        if len(head) < mcap_records.MESSAGE_INDEX.size:
            return False
        _, rows = mcap_records.MESSAGE_INDEX.unpack(head)
        return bool(rows % mcap_records.INDEXED.size == 0 and mcap_records.MESSAGE_INDEX.size + rows == length)

    def _next_chunk(self, at: int) -> int:
        """Return the offset of the next chunk from an offset on, or the end of the file if there is no further
        chunk."""
        back = mcap_records.HEAD.size + 28
        length = SECTOR
        while at < self.size:
            piece = self._readable(at, length + back + len(COMPRESSION))
            place = piece.find(COMPRESSION, back)
            while place >= 0:
                if piece[place - back] == Opcode.CHUNK:
                    with suppress(ValueError):
                        self.head(at + place - back)
                        return at + place - back
                place = piece.find(COMPRESSION, place + 1)
            at += min(len(piece), length) or SECTOR - at % SECTOR
            length = min(2 * length, PIECE)
        return self.size

    # Reading -------------------------------------------------------------------------------------------

    def _at(self, at: int, length: int) -> bytes:
        """Return the bytes at an offset, as far as the file contains them. Raises Unreadable if the disk cannot read
        them."""
        if self._file < 0:
            raise FramesError(f"{self.path} was closed")
        end, data = min(at + length, self.size), b""
        while at + len(data) < end:
            try:
                more = os.pread(self._file, end - at - len(data), at + len(data))
            except OSError as error:
                if error.errno != errno.EIO:
                    raise
                raise Unreadable(at, error) from None
            if not more:  # it was cut meanwhile
                break
            data += more
        return data

    def _readable(self, at: int, length: int) -> bytes:
        """Return the bytes at an offset. If not all of them can be read, return only those in the same sector, or no
        bytes if that sector cannot be read either."""
        for most in (length, SECTOR - at % SECTOR):
            with suppress(Unreadable):
                return self._at(at, most)
        return b""

    def _records(self, at: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Yield offset, opcode and length of the body of each record up to the offset `end`. Stop at the first
        incomplete record."""
        while at + mcap_records.HEAD.size <= end:
            head = self._at(at, mcap_records.HEAD.size)
            if len(head) < mcap_records.HEAD.size:
                return
            opcode, length = mcap_records.HEAD.unpack(head)
            if not opcode or length > end - at - mcap_records.HEAD.size:
                return
            yield at, opcode, length
            at += mcap_records.HEAD.size + length

    def _hold(self, at: int, opcode: int, length: int) -> None:
        """Keep metadata, a schema or a channel. Raises ValueError if it is malformed, and FramesError if they take more
        than `MAX_HELD` bytes together."""
        self._held += length + OVERHEAD
        if self._held > MAX_HELD:
            raise FramesError(f"{self.path}: its descriptions have more than {MAX_HELD >> 20} MB")
        body = memoryview(self._at(at + mcap_records.HEAD.size, length))
        if opcode == Opcode.METADATA:
            name, texts = mcap_records.read_metadata(body)
            self.metadata[name] = texts
        elif opcode == Opcode.CHANNEL:
            channel = mcap_records.read_channel(body)
            self.channels[channel.number] = channel
        else:
            schema = mcap_records.read_schema(body)
            self.schemas[schema.number] = schema

    def _checksum(self, start: int, end: int) -> int:
        checksum = 0
        for at in range(start, end, PIECE):
            checksum = zlib.crc32(self._at(at, min(PIECE, end - at)), checksum)
        return checksum

    @property
    def is_sound(self) -> bool:
        """True if a closed file has not changed since it was written. The whole file is read to compute the checksum of
        its data. Files of umo 0.2 have no such checksum, and count as unchanged."""
        with suppress(ValueError):
            end = self._at(self._data_end, mcap_records.DATA_END_BYTES)
            if len(end) < mcap_records.DATA_END_BYTES or end[0] != Opcode.DATA_END:
                return False
            (checksum,) = struct.unpack_from("<I", end, mcap_records.HEAD.size)
            return not checksum or self._checksum(0, self._data_end) == checksum
        return False

    def head(self, at: int) -> ChunkHead:
        """Return the head of the chunk at an offset. Raises ValueError if the head is damaged."""
        found = next(self._records(at, self.size), None)
        if found is None or found[1] != Opcode.CHUNK:
            raise ValueError("there is no complete chunk")
        begin = memoryview(self._at(at + mcap_records.HEAD.size, mcap_records.CHUNK_HEAD_BYTES))
        try:
            head = mcap_records.read_chunk(begin, found[2])
        except struct.error:
            raise ValueError("the head of a chunk is damaged") from None
        if max(head.size, head.length) > MAX_CONTENT:
            raise ValueError(f"a chunk has more than {MAX_CONTENT >> 20} MB")
        return head

    def raw(self, at: int) -> bytes:
        """Return the chunk at an offset as stored in the file. Raises ValueError if its head is damaged."""
        head = self.head(at)
        return self._at(at, mcap_records.HEAD.size + head.begin + head.length)

    def chunk(self, at: int) -> bytes:
        """Return the content of the chunk at an offset. Raises ValueError if the chunk is damaged."""
        head = self.head(at)
        data = self._at(at + mcap_records.HEAD.size + head.begin, head.length)
        content = content_of(head, data)
        if len(content) != head.size or zlib.crc32(content) != head.checksum:
            raise ValueError("its checksum does not fit")
        return content

    def is_readable(self, at: int) -> bool:
        """True if the chunk at an offset is valid."""
        try:
            self.chunk(at)
        except ValueError:
            return False
        return True

    def messages(self, at: int, channels: Container[int]) -> list[McapMessage]:
        """Return the messages of some channels in a chunk. Raises ValueError if the chunk is damaged."""
        found = (each for each in messages_in(self.chunk(at)) if each.channel in channels)
        messages = list(islice(found, MAX_MESSAGES + 1))
        if len(messages) > MAX_MESSAGES:
            raise ValueError(f"it has more than {MAX_MESSAGES:,} messages")
        return messages

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _opened(path: Path) -> int:
    """Open a file, and return its descriptor. Raises FramesError if it cannot be opened, or is not a regular file."""
    try:
        try:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.EMFILE:
                raise
            _, most = resource.getrlimit(resource.RLIMIT_NOFILE)  # a recording of months has hundreds of files
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError as error:
        raise FramesError(f"{path}: {error.strerror}") from None
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise FramesError(_not_a_file(path))
    return file


def _not_a_file(path: Path) -> str:
    """Return the message for a path that is not a regular file. For the folder of a run in `runs/`, it names the
    recording of the run."""
    if (own := path / "recording.mcap").is_file():
        return f"{path} is the folder of a run; its recording is {own}"
    if (path / "run.json").is_file():
        return f"{path}: this run has no recording (`umo run --record` makes one)"
    return f"{path} is not a recording: it is not a file"


def messages_in(content: bytes) -> Iterator[McapMessage]:
    """Return the messages in the content of a chunk."""
    head = mcap_records.MESSAGE.size
    for each in mcap_records.records(memoryview(content)):
        if each.opcode == Opcode.MESSAGE and len(each.body) >= head:
            channel, sequence, time, _ = mcap_records.MESSAGE.unpack_from(each.body)
            yield McapMessage(channel, sequence, time, each.body[head:])


def content_of(head: ChunkHead, data: bytes) -> bytes:
    """Return the content of a chunk. The size in the zstd frame is checked before memory is allocated."""
    if not head.compression:
        return data
    if head.compression != "zstd":
        raise ValueError(f"it is compressed by {head.compression!r}, which umo cannot read")
    try:
        stated = zstandard.frame_content_size(data)
        if stated == head.size:
            return bytes(zstandard.ZstdDecompressor().decompress(data)) if stated else b""
        if stated >= 0:
            raise ValueError("the size of its content differs from the size in its head")
        with zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW).stream_reader(data) as stream:
            return bytes(stream.read(head.size + 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ValueError(f"it cannot be decompressed: {error}") from None

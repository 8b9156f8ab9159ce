"""New files from recordings: several parts in one, a part without all that replay does not need, a torn file made
whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from umo.errors import FramesError
from umo.recording.mcap_reader import McapMessage, McapReader
from umo.recording.mcap_records import message
from umo.recording.mcap_writer import McapWriter, Messages
from umo.recording.recording import METADATA, SPARSE_TOPICS

BATCH, BATCH_BYTES = 64, 16 << 20
"""Chunks and bytes that are held and written at once, at most: the end of the file is written with each of these
writes, and has a row for each chunk."""
Keep = Callable[[], bool]


@contextmanager
def _new(path: Path, like: McapReader) -> Iterator[McapWriter]:
    """A new file with metadata, schemas and channels of another one, which takes this name when it is complete."""
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    hidden.unlink(missing_ok=True)
    metadata = [(name, texts | ({"part": "1"} if name == METADATA else {})) for name, texts in like.metadata.items()]
    writer = McapWriter(hidden, metadata, list(like.schemas.values()), list(like.channels.values()))
    try:
        yield writer
        os.replace(hidden, path)
    finally:
        writer.close()
        hidden.unlink(missing_ok=True)


def join(parts: Sequence[Path], path: Path) -> None:
    """All parts as one file, each as far as it is sound. OSError, FramesError."""
    files = [McapReader(parts[0])]
    for part in parts[1:]:
        with suppress(FramesError):  # it was cut in its first write, or that is under way: it has nothing
            files.append(McapReader(part))
    try:
        with _new(path, files[0]) as writer:
            for file in files:
                sound = file.chunks if file.is_whole else file.chunks[:-1]
                for batch in _batches(file, sound):
                    writer.add_raw(batch)
                torn = list(_messages(file, file.chunks[len(sound) :], set(file.channels)))  # it may lack its indexes
                if torn:
                    writer.add(_by_channel(torn))
    finally:
        for file in files:
            file.close()


def _batches(file: McapReader, chunks: Sequence[int]) -> Iterator[list[bytes]]:
    """Chunks as they stand in a file."""
    batch: list[bytes] = []
    for at in chunks:
        batch.append(file.raw(at))
        if sum(map(len, batch)) >= BATCH_BYTES:
            yield batch
            batch = []
    if batch:
        yield batch


def thin(path: Path) -> None:
    """Leave what replay needs, and what is seldom: exact columns, events, alarms, commands. OSError, FramesError."""
    file = McapReader(path)
    kept = {channel.number for channel in file.channels.values() if channel.topic in SPARSE_TOPICS}
    try:
        with _new(path, file) as writer:
            for batch in _copies(file, kept):
                writer.add(_by_channel(batch))
    finally:
        file.close()


def _copies(file: McapReader, kept: set[int]) -> Iterator[list[McapMessage]]:
    """The messages of these channels. They are copied: their chunks, which have much more, are not held."""
    batch: list[McapMessage] = []
    chunks = size = 0
    for at in file.chunks:
        found = [each._replace(data=memoryview(bytes(each.data))) for each in _messages(file, [at], kept)]
        batch += found
        chunks, size = chunks + 1, size + sum(len(each.data) for each in found)
        if batch and (chunks >= BATCH or size >= BATCH_BYTES):
            yield batch
            batch, chunks, size = [], 0, 0
    if batch:
        yield batch


def repair(path: Path) -> tuple[int, int]:
    """Make a file that was cut or torn whole: chunks that it still has, and bytes that were cut off. A file that is
    whole stays as it is."""
    file = McapReader(path)
    try:
        chunks, cut = len(file.chunks), 0 if file.is_whole else len(file.data) - file.end
        if METADATA not in file.metadata:
            raise FramesError(f"{path} has nothing that could be repaired: it was cut before its first second")
    finally:
        file.close()
    if not file.is_whole:
        join([path], path)
    return chunks, cut


def _messages(file: McapReader, chunks: Sequence[int], kept: set[int]) -> Iterator[McapMessage]:
    for at in chunks:
        try:
            yield from [each for each in file.messages(at) if each.channel in kept]
        except ValueError:  # it is damaged
            continue


def _by_channel(found: Sequence[McapMessage]) -> list[Messages]:
    parts = []
    for channel in sorted({each.channel for each in found}):
        data, rows, times = bytearray(), [], []
        for each in found:
            if each.channel == channel:
                rows.append((each.time, len(data)))
                times.append(each.time)
                data += message(channel, each.sequence, each.time, bytes(each.data))
        parts.append(Messages(channel, data, rows, len(rows), min(times), max(times)))
    return parts

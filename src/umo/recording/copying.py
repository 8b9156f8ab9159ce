"""New files from recordings: several parts in one, a part without all that replay does not need, a torn file made
whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from umo.errors import FramesError
from umo.recording.mcap_reader import McapReader, Message
from umo.recording.mcap_records import message
from umo.recording.mcap_writer import McapWriter, Messages
from umo.recording.recording import METADATA, SPARSE_TOPICS

BATCH = 64
"""Chunks that are written at once."""
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
    files = [McapReader(part) for part in parts]
    try:
        with _new(path, files[0]) as writer:
            for file in files:
                sound = file.chunks if file.is_whole else file.chunks[:-1]
                for at in range(0, len(sound), BATCH):
                    writer.add_raw([file.raw(each) for each in sound[at : at + BATCH]])
                torn = list(_messages(file, file.chunks[len(sound) :], set(file.channels)))  # it may lack its indexes
                if torn:
                    writer.add(_by_channel(torn))
    finally:
        for file in files:
            file.close()


def thin(path: Path) -> None:
    """Leave what replay needs, and what is seldom: exact columns, events, alarms, commands. OSError, FramesError."""
    file = McapReader(path)
    kept = {channel.number for channel in file.channels.values() if channel.topic in SPARSE_TOPICS}
    try:
        with _new(path, file) as writer:
            for at in range(0, len(file.chunks), BATCH):
                found = list(_messages(file, file.chunks[at : at + BATCH], kept))
                if found:
                    writer.add(_by_channel(found))
    finally:
        file.close()


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


def _messages(file: McapReader, chunks: Sequence[int], kept: set[int]) -> Iterator[Message]:
    for at in chunks:
        try:
            yield from [each for each in file.messages(at) if each.channel in kept]
        except ValueError:  # it is damaged
            continue


def _by_channel(found: Sequence[Message]) -> list[Messages]:
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

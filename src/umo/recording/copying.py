"""New files from recordings: several parts in one, a part without all that replay does not need, a file that was cut or
never closed made whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from umo.errors import FramesError
from umo.recording.block import headed
from umo.recording.extent import EXTENT, Extent
from umo.recording.mcap_reader import McapMessage, McapReader, messages_in
from umo.recording.mcap_records import message
from umo.recording.mcap_writer import McapWriter, Messages, PackedChunk, repacked
from umo.recording.recording import EXACT, METADATA, SPARSE_TOPICS, as_first

BATCH, BATCH_BYTES = 64, 8 << 20
"""Chunks, or bytes of them, that are written at once."""


@contextmanager
def _new(path: Path, like: McapReader, extent: Callable[[], Mapping[str, str] | None]) -> Iterator[McapWriter]:
    """A new file with metadata, schemas and channels of another one, which takes this name when it is complete.
    `extent`: what it says of its periods, asked when all is written."""
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    hidden.unlink(missing_ok=True)
    metadata = [
        (name, as_first(texts) if name == METADATA else texts)
        for name, texts in like.metadata.items()
        if name != EXTENT
    ]
    writer = McapWriter(hidden, metadata, list(like.schemas.values()), list(like.channels.values()))
    try:
        yield writer
    except BaseException:
        writer.discard()
        raise
    try:
        found = extent()
        writer.close([] if found is None else [(EXTENT, dict(found))])
        os.replace(hidden, path)
    finally:
        hidden.unlink(missing_ok=True)


class _Joined:
    """The chunks of files in the order of their periods, each once, and which periods they have."""

    def __init__(self, files: Sequence[McapReader]) -> None:
        self._files = files
        self._stop = 0
        self.seen: Extent | None = None

    def chunks(self) -> Iterator[PackedChunk]:
        for file in self._files:
            for at in file.chunks:
                with suppress(ValueError, KeyError, TypeError):  # it is damaged: its periods are missing
                    content = file.chunk(at)
                    heads = [headed(each.data)[0] for each in messages_in(content) if each.channel == EXACT]
                    if heads and int(heads[0]["first"]) < self._stop:
                        continue  # it was there
                    for head in heads:
                        first, count = int(head["first"]), int(head["count"])
                        self.seen = Extent(first, first + count, count, float(head["time"])).after(self.seen)
                        self._stop = first + count
                    yield repacked(file.raw(at), content)

    @property
    def extent(self) -> Extent | None:
        """What the files have said of themselves, where they have: so it stays known what is missing. Else what was
        seen."""
        told = [Extent.read(file.metadata[EXTENT]) for file in self._files if EXTENT in file.metadata]
        if len(told) < len(self._files) or None in told:
            return self.seen
        whole: Extent | None = None
        for each in told:
            whole = each and each.after(whole)
        return whole


def join(parts: Sequence[Path], path: Path) -> None:
    """All parts as one file, each as far as it is sound. OSError, FramesError."""
    files = [McapReader(parts[0])]
    for part in parts[1:]:
        with suppress(FramesError):  # it was cut in its first write, or that is under way: it has nothing
            files.append(McapReader(part))
    joined = _Joined(files)
    try:
        with _new(path, files[0], lambda: joined.extent and joined.extent.texts) as writer:
            batch: list[PackedChunk] = []
            for chunk in joined.chunks():
                batch.append(chunk)
                if sum(len(each.record) for each in batch) >= BATCH_BYTES:
                    writer.add(batch)
                    batch = []
            if batch:
                writer.add(batch)
    finally:
        for file in files:
            file.close()


def thin(path: Path) -> None:
    """Leave what replay needs, and what is seldom: exact columns, events, alarms, commands. OSError, FramesError."""
    file = McapReader(path)
    kept = {EXACT, *(each.number for each in file.channels.values() if each.topic in SPARSE_TOPICS)}
    try:
        with _new(path, file, lambda: file.metadata.get(EXTENT)) as writer:
            batch: list[PackedChunk] = []
            for at in file.chunks:
                with suppress(ValueError):  # it is damaged
                    if found := file.messages(at, kept):
                        batch.append(writer.pack(_by_channel(found)))
                if len(batch) >= BATCH:
                    writer.add(batch)
                    batch = []
            if batch:
                writer.add(batch)
    finally:
        file.close()


def repair(path: Path) -> bool:
    """Make a file that was not closed, or is damaged, whole for every reader, with the chunks that are sound; false if
    it was whole, and stays as it is."""
    file = McapReader(path)
    try:
        if METADATA not in file.metadata:
            raise FramesError(f"{path} has nothing that could be repaired: it was cut before its first second")
        if file.is_whole and not file.damaged and file.is_sound and all(map(file.is_readable, file.chunks)):
            return False
    finally:
        file.close()
    join([path], path)
    return True


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

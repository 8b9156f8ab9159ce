"""Makes new files from recordings: it joins several parts into one, reduces a part to the data that replay needs, and
makes a repaired copy of a file that was truncated or never closed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from umo.errors import FramesError
from umo.recording.block import headed
from umo.recording.chunk_order import EXACT, REPEATED, damaged, in_order
from umo.recording.extent import DAMAGE, EXTENT, FOLLOWED, Extent, damage_texts, not_closed
from umo.recording.mcap_reader import McapMessage, McapReader, messages_in
from umo.recording.mcap_records import message
from umo.recording.mcap_writer import McapWriter, Messages, PackedChunk, repacked
from umo.recording.recording import METADATA, SPARSE_TOPICS, as_first
from umo.recording.recording_scan import BlockHead

BATCH, BATCH_BYTES = 64, 8 << 20
"""Number of chunks, and number of their bytes, that are written in one batch."""


Metadata = list[tuple[str, dict[str, str]]]


@contextmanager
def _new(path: Path, like: McapReader, first: Metadata, last: Callable[[], Metadata]) -> Iterator[McapWriter]:
    """Return a context with a new file that has the schemas and channels of the file `like`. The new file gets the name
    `path` when it is complete. `first`: the metadata at its beginning; `last`: function that returns the metadata at
    its end."""
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    hidden.unlink(missing_ok=True)
    writer = McapWriter(hidden, first, list(like.schemas.values()), list(like.channels.values()))
    try:
        yield writer
    except BaseException:
        writer.discard()
        raise
    try:
        writer.close(last())
        os.replace(hidden, path)
    finally:
        hidden.unlink(missing_ok=True)


def _metadata(file: McapReader) -> Metadata:
    """Return the metadata of a file, without the description of its periods."""
    return [each for each in file.metadata.items() if each[0] not in (EXTENT, DAMAGE)]


class _Joined:
    """The chunks of files in the order of their periods, each once. Also records which periods the chunks contain."""

    def __init__(self, files: Sequence[McapReader]) -> None:
        self._files = files
        self._stop = 0
        self.seen: Extent | None = None
        self.time: float | None = None
        """Time of the first frame of the last block, s."""
        self.ended = False
        """True if the end of the run was found."""
        self.more_damage: list[str] = []
        """Sentences about damage other than places of the files."""

    def chunks(self) -> Iterator[PackedChunk]:
        for file in self._files:
            for at in in_order(file):
                try:
                    content = file.chunk(at)
                    if self._see(content):
                        yield repacked(file.raw(at), content)
                    else:
                        file.damaged.add(at, REPEATED)
                except (ValueError, LookupError, TypeError, OverflowError) as error:  # its periods are missing
                    file.damaged.add(at, damaged(error))

    @property
    def damage(self) -> list[str]:
        """Return the damage, in sentences, as far as the files were read."""
        return [*(text for file in self._files for text in self._told(file)), *self.more_damage]

    @staticmethod
    def _told(file: McapReader) -> Iterator[str]:
        yield from file.metadata.get(DAMAGE, {}).values()
        torn = file.size if file.is_whole else file.end  # behind it lies what is being written
        yield from (f"{text} (before it was copied)" for text in file.damaged.sentences(file.path.name, torn))

    def _see(self, content: bytes) -> bool:
        """Record the descriptions of the blocks of a chunk. Return False if an earlier chunk contains the same
        periods."""
        found = (each.data for each in messages_in(content) if each.channel == EXACT)
        heads = [BlockHead.of(headed(each)[0], 0) for each in found]
        if heads and heads[0].first < self._stop:
            return False
        for head in heads:
            stop = head.first + head.periods
            self.seen = Extent(head.first, stop, head.periods, head.time).after(self.seen)
            self._stop, self.time = stop, head.time
            self.ended = self.ended or any(each.event.is_end for each in head.events)
        return True

    @property
    def extent(self) -> Extent | None:
        """Return the extent that the files declare, so that the new file shows which periods are missing. If a file
        declares none, return the extent that was read."""
        told = [Extent.read(file.metadata[EXTENT]) for file in self._files if EXTENT in file.metadata]
        if len(told) < len(self._files) or None in told:
            return self.seen
        whole: Extent | None = None
        for each in told:
            whole = each and each.after(whole)
        return whole

    @property
    def metadata(self) -> Metadata:
        """Metadata of the new file about its periods and the missing ones."""
        extent = self.extent
        told = [] if extent is None else [(EXTENT, extent.texts)]
        return told + ([(DAMAGE, damage_texts(damage))] if (damage := self.damage) else [])


def join(parts: Sequence[Path], path: Path) -> None:
    """Write all parts to one file, each part as far as it is undamaged. Raises OSError or FramesError."""
    files = [McapReader(parts[0])]
    for part in parts[1:]:
        with suppress(FramesError):  # it was cut in its first write, or that is under way: it has nothing
            files.append(McapReader(part))
    joined = _Joined(files)
    first = [(name, as_first(texts) if name == METADATA else texts) for name, texts in _metadata(files[0])]
    try:
        with _new(path, files[0], first, lambda: joined.metadata) as writer:
            _copy(joined.chunks(), writer)
    finally:
        for file in files:
            file.close()


def _copy(chunks: Iterator[PackedChunk], writer: McapWriter) -> None:
    batch: list[PackedChunk] = []
    for chunk in chunks:
        batch.append(chunk)
        if len(batch) >= BATCH or sum(len(each.record) for each in batch) >= BATCH_BYTES:
            writer.add(batch)
            batch = []
    if batch:
        writer.add(batch)


def thin(path: Path) -> None:
    """Reduce a part to the data that replay needs and to data that are rare: exact columns, events, alarms, commands.
    Raises OSError or FramesError."""
    file = McapReader(path)
    kept = {EXACT, *(each.number for each in file.channels.values() if each.topic in SPARSE_TOPICS)}
    told = [(name, texts) for name, texts in file.metadata.items() if name in (EXTENT, DAMAGE)]
    try:
        with _new(path, file, _metadata(file), lambda: told) as writer:
            _copy(_thinned(file, kept, writer), writer)
    finally:
        file.close()


def _thinned(file: McapReader, kept: set[int], writer: McapWriter) -> Iterator[PackedChunk]:
    for at in file.chunks:
        with suppress(ValueError):  # it is damaged, which its extent tells
            if found := file.messages(at, kept):
                yield writer.pack(_by_channel(found))


def repair(path: Path) -> bool:
    """Repair a file that was not closed, or is damaged, so that every reader can read its valid chunks. Return False if
    the file was complete; a complete file is not changed. The repaired file is the same part of its recording, and
    records the damage."""
    file = McapReader(path)
    try:
        if METADATA not in file.metadata:
            raise FramesError(f"{path} has nothing that could be repaired: the file ends before its first second")
        if file.is_whole and not file.damaged and file.is_sound and all(map(file.is_readable, file.chunks)):
            return False
        joined = _Joined([file])
        with _new(path, file, _metadata(file), lambda: _of_repaired(file, joined)) as writer:
            _copy(joined.chunks(), writer)
    finally:
        file.close()
    return True


def _of_repaired(file: McapReader, joined: _Joined) -> Metadata:
    if not file.is_whole and not joined.ended:
        joined.more_damage.append(f"{not_closed(file.path.name, joined.time)} (before it was repaired)")
    followed = {name: text for name, text in file.metadata.get(EXTENT, {}).items() if name == FOLLOWED}
    return [(name, texts | followed if name == EXTENT else texts) for name, texts in joined.metadata]


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

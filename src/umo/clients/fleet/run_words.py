"""The messages of a fleet: a run as a vector of words of 8 bytes, and the changes of these words.

The vector holds a frame as in the ring (`umo.process.frames.layout`, without `sequence`, checksums and journal), then
the metadata: state, mode, missed periods, lease with its holder, the tunable numbers. A delta has the words of the
frame that differ from those of the delta before. The metadata are complete in a delta, or are left out because they
have not changed.

Frames are selected by their numbers in the ring: with a stride of k the deltas 0, 1, 2 ... are made from the frames
k-1, 2k-1, 3k-1 ... Delta n belongs to the same frame, whichever process publishes the run and however often it
restarts, so losses can be counted.

A message, little-endian: `HEADER`; the indices of the words (`<u2`, or `<u4` if there are more than 65,535), then the
words, then the metadata.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.errors import FramesError
from umo.process.frames.layout import NAME, Layout, Live

Words = npt.NDArray[np.uint64]
HEADER = struct.Struct("<8sQIIIB3x")
"""The header: run, number of the delta, number of events that were published before, number of words, bytes of the
metadata, flags."""
FULL, LAST = 1, 2
"""Flags. FULL: the delta contains every word of the frame. LAST: the run has ended, and no delta follows."""
METADATA = struct.Struct(f"<qqqq{NAME}s")
"""The metadata: state, mode, missed periods, number of the lease, its holder. The tunable numbers (`<f8`) follow."""
LEFT_OUT = ("sequence", "checksum", "entries_checksum", "journal", "entries", "entries_lost", "sampled", "updated")
"""Fields of a frame that are not transmitted, because they belong to the ring or to the journal."""
FULL_EVERY = 100
"""One delta in this number of deltas contains all words, so that a new reader can begin there."""
RUN_BYTES = 8


@dataclass(frozen=True)
class RunMetadata:
    """The data of a run that do not belong to a frame."""

    state: int
    mode: int
    missed: int
    lease: int
    holder: bytes
    tunables: bytes

    def packed(self) -> bytes:
        return METADATA.pack(self.state, self.mode, self.missed, self.lease, self.holder) + self.tunables

    @classmethod
    def parse(cls, data: bytes) -> RunMetadata:
        try:
            state, mode, missed, lease, holder = METADATA.unpack_from(data)
        except struct.error as error:
            raise FramesError(f"a delta does not fit its declaration: {error}") from None
        return cls(state, mode, missed, lease, holder.rstrip(b"\0"), data[METADATA.size :])

    @classmethod
    def of(cls, live: Any, lease: tuple[int, str], tunables: bytes) -> RunMetadata:
        """Return the metadata. `live`: the live numbers of a ring; `lease`: the number and the holder of the lease."""
        number, holder = lease
        return cls(
            int(live[Live.STATE]), int(live[Live.MODE]), int(live[Live.MISSED]), number, holder.encode(), tunables
        )


@dataclass(frozen=True)
class Head:
    """The beginning of a message."""

    run: bytes
    number: int
    flags: int
    events: int = field(default=0, kw_only=True)
    """Number of the next event of the run."""

    @property
    def is_full(self) -> bool:
        return bool(self.flags & FULL)

    @property
    def is_last(self) -> bool:
        return bool(self.flags & LAST)


@dataclass(frozen=True)
class Delta(Head):
    """One delta as a message."""

    places: npt.NDArray[Any]
    words: Words
    rest: bytes
    """The metadata in packed form; empty if they have not changed."""

    def packed(self) -> bytes:
        head = HEADER.pack(self.run, self.number, self.events, len(self.words), len(self.rest), self.flags)
        places = b"" if self.is_full else self.places.tobytes()
        return b"".join((head, places, self.words.tobytes(), self.rest))


class WordFrame:
    """Converts frames of one run to words, and back. `layout`: that of the run's ring."""

    def __init__(self, layout: Layout) -> None:
        dtype = layout.dtype
        self.dtype = dtype
        self.count = dtype.itemsize // 8
        self._index = np.dtype("<u2" if self.count <= 1 << 16 else "<u4")
        assert dtype.fields is not None
        self._left_out = [dtype.fields[name][1] // 8 for name in LEFT_OUT]

    def words(self, frame: Any) -> Words:
        """Return the words of a frame of a ring. The frame is not changed."""
        return self.words_of(frame.tobytes())

    def words_of(self, frame: bytes) -> Words:
        """Return the words of a frame in the form in which the ring has it."""
        words = np.frombuffer(frame, np.uint64).copy()
        words[self._left_out] = 0
        return words

    def changed(self, words: Words, before: Words | None) -> tuple[npt.NDArray[Any], Words]:
        """Return the places and values of the words that differ from `before`; without `before`, of all words."""
        if before is None:
            return np.zeros(0, self._index), words
        (places,) = (words != before).nonzero()
        return places.astype(self._index), words[places]

    def parse(self, data: bytes) -> Delta:
        """Parse a message. Raises FramesError if the message does not fit this run."""
        try:
            run, number, events, count, rest, flags = HEADER.unpack_from(data)
            full, at = bool(flags & FULL), HEADER.size
            indices = 0 if full else count
            expected = at + indices * self._index.itemsize + 8 * count + rest
            if len(data) != expected or (full and count != self.count):
                raise ValueError(f"{count} words in {len(data)} bytes, for a frame of {self.count} words")
            places = np.frombuffer(data, self._index, indices, at)
            if indices and int(places.max()) >= self.count:
                raise ValueError(f"there is no word {int(places.max())}: a frame has only {self.count} words")
            at += places.nbytes
            words: Words = np.frombuffer(data, np.uint64, count, at)
        except (struct.error, ValueError) as error:
            raise FramesError(f"a delta does not fit its declaration: {error}") from None
        return Delta(run, number, flags, places, words, data[at + words.nbytes :], events=events)

    def apply(self, delta: Delta, words: Words) -> None:
        """Apply a delta to these words."""
        if delta.is_full:
            words[:] = delta.words
        else:
            words[delta.places] = delta.words

    def frame(self, words: Words) -> Any:
        """Return the frame that words stand for, as a structured scalar of the ring's layout."""
        return np.frombuffer(words.tobytes(), self.dtype)[0]


def peek(data: bytes) -> Head:
    """Return the beginning of a message. Raises FramesError if the message is not a delta."""
    if len(data) < HEADER.size:
        raise FramesError(f"{len(data)} bytes are not a delta")
    run, number, events, _, _, flags = HEADER.unpack_from(data)
    return Head(run, number, flags, events=events)

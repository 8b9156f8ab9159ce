"""The positions in a stream from which a recorder that restarts must read, so that no data of a run are missing."""

from __future__ import annotations

from collections import deque

from umo.clients.fleet.run_words import FULL_EVERY, Head


class StreamPositions:
    """The positions of one run: those of the data that are not written yet, and that of the last full delta, on which
    the following deltas build."""

    def __init__(self) -> None:
        self._full: deque[tuple[int, int]] = deque()
        """Number and place of the deltas with all words, oldest first."""
        self._begin: int | None = None
        """Place of the first message, until a delta with all words is written."""
        self._unwritten: int | None = None

    def take(self, sequence: int, head: Head | None) -> None:
        """Record a message. `head`: the beginning of the message if it is a delta."""
        if self._begin is None:
            self._begin = sequence
        if self._unwritten is None:
            self._unwritten = sequence
        if head is not None and head.number % FULL_EVERY == 0 and (not self._full or head.number > self._full[-1][0]):
            self._full.append((head.number, sequence))

    def wrote(self, last: int, *, everything: bool) -> None:
        """Record that the deltas up to this number are in files. With `everything` all received data are in files."""
        while len(self._full) > 1 and self._full[1][0] <= last + 1:
            self._full.popleft()
        if everything:
            self._unwritten = None

    def needed(self, last: int, *, has_ended: bool) -> int | None:
        """Return the first position that is still needed, or None if no received data are needed any more."""
        if has_ended and self._unwritten is None:
            return None
        base = self._full[0][1] if self._full and self._full[0][0] <= last + 1 else self._begin
        places = [each for each in (base, self._unwritten) if each is not None]
        return min(places, default=None)

"""A copy of a ring on another computer, for readers in this process."""

from __future__ import annotations

from collections.abc import Mapping

from umo.cycle.events import Event
from umo.cycle.stage import Stage
from umo.process.frames.client_memory import ClientMemory, size_of
from umo.process.frames.layout import EVENT_ROW, EVENTS, LEASE_AT, LEASE_BYTES, NAME, Layout, Live, arrange, pack_event
from umo.process.frames.memory import RunDescriptors, fill
from umo.system.shared_cells import SharedText

MAX_BYTES = 4 << 20
MAX_SLOTS = 4096
MIN_SLOTS = 16


class RingCopy:
    """A copy of a ring, without a journal. `ends`: the writer's descriptors of empty memory. Raises FramesError if
    there is not enough memory."""

    def __init__(self, layout: Layout, ends: RunDescriptors) -> None:
        self.layout = layout
        self._ends = ends
        size = layout.dtype.itemsize
        self.slots = max(min(MAX_BYTES // size, MAX_SLOTS), MIN_SLOTS)
        self._size = size
        head, places = arrange(layout, self.slots, 0)
        self._places = places
        self._map = fill(ends.frames, head, places.size, private=True)
        fill(ends.cells, b"", size_of(layout), private=False).close()
        self.cells = ClientMemory(ends.cells, layout)
        self._words = memoryview(self._map).cast("q")
        self._lease = SharedText(self._map, LEASE_AT, LEASE_BYTES)
        self._frames = 0

    def frame(self, frame: bytes) -> None:
        """Add a frame. Its data have the type `Layout.dtype` without `sequence`."""
        number, words = self._frames, self._words
        at = self._places.first + number % self.slots * self._size
        words[at >> 3] = 2 * number + 1
        self._map[at + 8 : at + self._size] = frame[8:]
        words[at >> 3] = 2 * number + 2
        self._frames = number + 1
        words[Live.HEAD] = self._frames

    def live(self, numbers: Mapping[int, int]) -> None:
        """Set live numbers by their places (`umo.process.frames.layout.Live`)."""
        for place, number in numbers.items():
            self._words[place] = number

    def lease(self, number: int, holder: bytes) -> None:
        """Set the number of the lease and its holder. A number below 0 means that the lease is not known; this counts
        as if nobody had it."""
        self._lease.put(max(number, 0), holder[:NAME])

    def tunables(self, numbers: bytes) -> None:
        """Set the tunable numbers, each of type `<f8`."""
        at = self._places.tunables
        if len(numbers) == self._places.size - at:
            self._map[at : self._places.size] = numbers

    def event(self, number: int, event: Event) -> None:
        """Set the event of this number, from 0; events arrive in order."""
        at = self._places.events + number % EVENTS * EVENT_ROW.itemsize
        self._words[at >> 3] = 0
        pack_event(self._map, at, event, number + 1)
        self._words[at >> 3] = number + 1
        self._words[Live.EVENT] = number + 1

    def close(self) -> None:
        """Close the copy when the run has ended; readers see the end, and the last frames."""
        self._words[Live.STATE] = Stage.ENDED
        self._words.release()
        self._map.close()
        self.cells.close()
        self._ends.close()

"""The journal of a period: transfers of single objects, in order, for an exact replay.

The journal does not contain the transfers of the whole machine, because the raw integers of a frame show their values.
It contains only the number of entries that precede such a transfer. An entry keeps the raw integer that its object had
before. So a reader can compute the values of all transfers from the raw integers of a frame, backwards over the
entries. A failure always has an entry.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from math import inf, nan

import numpy as np

from umo.objects.scaling import FloatArray, IntArray

ENTRY = struct.Struct("<IHHqqd")
"""An entry of 32 bytes: slot, kind, error, raw, before, time."""
ENTRIES = np.dtype(
    [("slot", "<u4"), ("kind", "<u2"), ("error", "<u2"), ("raw", "<i8"), ("before", "<i8"), ("time", "<f8")]
)
"""An entry as a numpy type, for arrays of entries."""
FEW = 16
"""The number of entries below which it is quicker to handle the entries one by one."""
CAPACITY = 4096
"""Number of entries of one period that are kept, in addition to one for each object, because all objects may fail in
one period."""
OF_BLOCK = -inf
"""The value in place of a time if the object has failed in the transfer of its block and not in a transfer of its
own."""
NO_TRANSFER = -1
"""The value in place of a count if the transfer of the whole machine did not take place in this period."""


class Kind(IntEnum):
    """The kind of an event between two transfers of the whole machine. The numbers are stored in frames."""

    READ = 0
    WRITE = 1
    FAILED_READ = 2
    FAILED_WRITE = 3
    RESET = 4
    FAILED_RESET = 5
    EXPIRED = 6
    INTERLOCKED = 7
    INITIALIZE = 8
    ARRIVED = 9
    """A worker process has delivered a reading of its driver; `time` is the time of the reading."""
    CONFIRMED = 10
    """A worker process has delivered the value that its device accepted for an actuator; `time` is the time of the
    transfer. With an error, the device has not accepted the ordered value."""
    LOOKED = 11
    """umo has looked for a driver that is away; the slot is that of the driver's first object. `raw` is 1 if the device
    answers, 0 if it does not, -1 if this is not known yet."""
    AGAIN = 12
    """A block is transferred once more in this period; the slot is the first slot of the block. The following entries
    show the values of the transfer."""
    RENEWED = 13
    """A worker process has initialised the objects of its driver again; the slot is that of the first object."""


class ErrorKind(IntEnum):
    """The cause of a driver's failed call. The numbers are stored in frames."""

    NONE = 0
    """The call did not fail."""
    OTHER = 1
    TIMEOUT = 2
    """The device did not answer in time."""
    CHANNELS = 3
    """The driver has named this channel (`ChannelsFailed`)."""

    @classmethod
    def of(cls, error: BaseException) -> ErrorKind:
        """Return the kind of the failure of a whole call."""
        return cls.TIMEOUT if isinstance(error, TimeoutError) else cls.OTHER


class Journal:
    """The first `capacity` entries of a period; further entries are only counted. Readings of the timer are not kept,
    because `missed` has the same information.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.buffer = bytearray(capacity * ENTRY.size)
        self.count = 0
        """Number of entries of this period so far."""
        self.lost = 0
        """Number of entries of this period that were dropped because the journal was full."""
        self.sampled = NO_TRANSFER
        """Number of entries before the sample of the whole machine; NO_TRANSFER before it took place."""
        self.updated = NO_TRANSFER
        """Number of entries before the update of the whole machine; NO_TRANSFER before it took place."""

    def add(
        self, slot: int, kind: Kind, raw: int, before: int, error: ErrorKind = ErrorKind.NONE, time: float = nan
    ) -> None:
        """Add an entry: an object now has the raw integer `raw`, and had `before` until now (the same number if nothing
        was transferred). For a failure `raw` is the value that should have been written, or the last value of a sensor.
        `time`: the time of a value from a worker process in s on the cycle's clock; NaN if the worker process has
        delivered no value yet; or `OF_BLOCK`."""
        if self.count == self.capacity:
            self.lost += 1
            return
        ENTRY.pack_into(self.buffer, self.count * ENTRY.size, slot, kind, error, raw, before, time)
        self.count += 1

    def add_each(
        self,
        slots: Sequence[int],
        kind: Kind,
        raws: IntArray,
        error: ErrorKind = ErrorKind.NONE,
        meant: Sequence[int] | None = None,
        time: float = nan,
    ) -> None:
        """Add an entry for each of these objects, which keep their raw integers in `raws` (an array for the whole
        machine). `meant`: the raw integers that should have been written."""
        if len(slots) < FEW:
            for number, slot in enumerate(slots):
                before = int(raws[slot])
                self.add(slot, kind, before if meant is None else meant[number], before, error, time)
            return
        own = raws[np.asarray(slots, np.int64)]
        self.add_rows(slots, kind, own if meant is None else meant, own, error, time)

    def add_rows(
        self,
        slots: Sequence[int],
        kind: Kind,
        raws: Sequence[int] | IntArray,
        before: IntArray,
        error: ErrorKind = ErrorKind.NONE,
        times: float | FloatArray = nan,
    ) -> None:
        """Add an entry for each of these objects, as `add` does for one object."""
        count = min(len(slots), self.capacity - self.count)
        rows = np.zeros(count, ENTRIES)
        rows["slot"], rows["kind"], rows["error"] = slots[:count], kind, error
        rows["raw"], rows["before"] = raws[:count], before[:count]
        rows["time"] = times if isinstance(times, float) else times[:count]
        start = self.count * ENTRY.size
        self.buffer[start : start + rows.nbytes] = rows.tobytes()
        self.count += count
        self.lost += len(slots) - count

    @property
    def entries(self) -> bytes:
        """The entries of this period."""
        return bytes(memoryview(self.buffer)[: self.count * ENTRY.size])

    def clear(self) -> None:
        """Begin a new period."""
        self.count = self.lost = 0
        self.sampled = self.updated = NO_TRANSFER

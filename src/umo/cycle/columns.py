"""The numbers of a process image: columns in one contiguous piece of memory, and the scales of its objects.

Every column has a row for each object; an object's row is its slot. Columns are arrays, for blocks and Vectors; the
image also has a memoryview of each column for single objects, because Python reads an item of a memoryview in a third
of the time that an item of an array takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from math import inf, nan, nextafter
from typing import Any

import numpy as np

from umo.drivers.contract import UNREAD, Channel, Direction, Driver
from umo.objects import Actuator
from umo.objects.linearization import Linearization
from umo.objects.scaling import IntArray
from umo.wiring.wired import Wire

FREE, ASKED, TAKEN_BY_CLIENT = 0, 254, 255
"""The values of the column `restrictions`. FREE: a write goes directly into the image. ASKED: the command stage checks
a write, because the actuator has an expiry or is asynchronous. TAKEN_BY_CLIENT: a client has taken the actuator. 1 to
253: the number of the reason of an inhibition."""
LAST, NOW, UNSEEN, TOLD = 1, 2, 64, 128
"""The bits of the column `written`. LAST: the actuator was written in the previous period. NOW: it was written since
the values were sent last. UNSEEN: another writer has written the same value as the pending one, and this write was not
examined. TOLD: two writers were reported, so the writers of this actuator are no longer examined."""
WIDE, NARROW = 7, 2
"""Columns with 8 bytes per row, and columns with 1 byte per row."""


class Source(Enum):
    """The source of a command."""

    PROGRAM = "program"
    CLIENT = "client"
    DEFAULT = "default"
    """An interlock, a fault, a reset, an expiry or the end of a client's hold sends the default. This is not a
    write."""


class Columns:
    """The numbers that change while the machine runs.

    Sensors: `raws`, `values`, `quality`, `times` of the last reading. Actuators: `pending` is the value written. The
    pair `sent` and `sent_raws` is the value that the driver received last, or receives next. `raws`, `values`, `times`
    belong to the value that the driver accepted last. `stepped`, for actuators with a slew rate, is the time of the
    last step; it is infinite while the device has not yet accepted a reset. `restrictions` says whether the command
    stage checks a write (set by the claims, `claim_table.py`).

    `equipment`, `axes` and `alarms` have a row for each equipment, axis and alarm with the number of its state.
    """

    def __init__(self, count: int, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        memory = np.zeros(count * (8 * WIDE + NARROW) + equipment + axes + alarms, np.uint8)
        wide = memory[: 8 * WIDE * count].view(np.float64).reshape(WIDE, count)
        self.pending, self.sent, self.stepped, self.times = wide[:4]
        self.sent_raws, self.raws = wide[4].view(np.int64), wide[6].view(np.int64)
        self.values = wide[5]
        ends = 8 * WIDE * count, (8 * WIDE + NARROW) * count
        self.quality, self.restrictions = memory[ends[0] : ends[1]].reshape(NARROW, count)
        self.equipment, self.axes, self.alarms = np.split(memory[ends[1] :], [equipment, equipment + axes])
        self.written = np.zeros(count, np.uint8)
        """The bits of each actuator that are set when control code has written it."""
        self.owners = np.zeros(count, np.uint64)
        """The identity of the code that has written each actuator last."""
        self.times.fill(nan)
        self.shown = memory[wide[:5].nbytes :].data
        """The bytes that a frame shows: of `values`, `raws`, `quality`, `restrictions`, `equipment`, `axes`, `alarms`,
        in this order."""


class Scales:
    """The numbers that convert each object: value = raw * resolution + zero_offset. Only homing changes the zero
    offset."""

    def __init__(self, wires: Sequence[Wire], default_raws: Sequence[int | None]) -> None:
        """`default_raws`: the raw integer of each actuator's default, None for a sensor."""
        count = len(wires)
        self.resolution, self.zero_offset = np.array([wire.scale for wire in wires], float).reshape(count, 2).T.copy()
        bounds = [wire.bounds if wire.item.direction is Direction.INPUT else (-inf, inf) for wire in wires]
        self.low, self.high = np.array(bounds, float).reshape(count, 2).T.copy()
        """The bounds within which a sensor's value is GOOD."""
        self.least, self.greatest = np.array([_raw_bounds(wire) for wire in wires], float).reshape(count, 2).T.copy()
        """The least and the greatest raw integer of an actuator."""
        exact = [wire.item.direction is Direction.INPUT or wire.exact for wire in wires]
        self.exact = np.array(exact, bool) & (np.maximum(np.abs(self.least), np.abs(self.greatest)) < 2.0**51)
        """True if, for every value of an actuator's range, the nearest raw integer lies within `least` and `greatest`,
        and is so small that floats near it have fractions."""
        rates = (wire.item._slew_rate for wire in wires)
        self.rate = np.array([inf if rate is None else rate for rate in rates], float)
        """The largest rate of an actuator in units per s; infinite if it is not limited."""
        values = (wire.item._default_value() if isinstance(wire.item, Actuator) else nan for wire in wires)
        self.defaults = np.array(list(values), float)
        """The default of each actuator."""
        self.default_raws = np.array([raw or 0 for raw in default_raws], np.int64)
        """The raw integer of each default."""
        self.linearizations: list[Linearization | None] = [wire.linearization for wire in wires]


def _raw_bounds(wire: Wire) -> tuple[float, float]:
    """Return the bounds of the raw integer as floats; for a sensor those of any raw integer."""
    if wire.item.direction is Direction.INPUT:
        return -(2.0**63), 2.0**63 - 1024.0
    least, greatest = wire.raw_bounds
    low, high = float(least), float(greatest)
    return low if low >= least else nextafter(low, inf), high if high <= greatest else nextafter(high, -inf)


class Block:
    """Neighbouring slots that one driver moves in one transfer."""

    def __init__(
        self, driver: Driver[Any], channels: tuple[Channel, ...], start: int, raws: IntArray, inputs: bool, part: int
    ) -> None:
        self.driver = driver
        self.channels = channels
        self.part = part
        """The number of the part with its own rate (`Wired.rates`) to which the objects belong. Negative if they belong
        to no such part."""
        self.start = start
        self.stop = start + len(channels)
        self.slots = slice(start, self.stop)
        self.count = len(channels)
        self.raws = raws
        self.buffer = self.raws.view()
        """Array for the driver's transfer, which fills it for inputs and reads it for outputs."""
        self.buffer.flags.writeable = inputs
        self.view = self.buffer.data
        """The buffer's array as a memoryview. A copy between two memoryviews takes a third of the time of a copy
        between two arrays."""
        self.unread = np.full(self.count, UNREAD).data
        """The contents of the buffer of inputs before a transfer."""
        self.transfer: Callable[[Any, IntArray], None]
        """The driver's block transfer, as the transfer stage calls it."""
        self.unwatched: Callable[[Any, IntArray], None]
        """The block transfer without a watch around it."""
        self.was_moved: Callable[[int], object] | None = None
        """The function that is called with the duration in ns of a transfer that was not made by `transfer`."""
        self.convert: Callable[[float], Sequence[tuple[int, float]]]
        """The function that converts the buffer of inputs into raws and values of the image, and sets their times to
        the given time in s. If any values are out of bounds, the function returns their (slot, value) pairs instead of
        storing them, and the caller sets the times."""
        self.give: Callable[[float, float], None]
        """The function that fills the buffer of outputs with the pending values, limited by the slew rates. It is
        called with the time in s and the duration of this period in s. A duration of 0 means the time since the last
        step."""
        self.commit: Callable[[float], None]
        """The function that records that the hardware has accepted the buffer of outputs at the given time in s."""
        self.conditioned: Any = None
        """The conversion of inputs by `umo.cycle.conditioning`; None if no sensor of the block is conditioned."""
        self.unsettled: set[int] = set()
        """The slots whose quality is not the normal one. The set object is never replaced."""

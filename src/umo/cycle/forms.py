"""The two forms of the process image, proved equal by tests.

Python specialises list subscripts, so plain lists are fastest for small machines; numpy wins above
(`bench/scan.py` measures where; docs/decisions records it).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import numpy as np

from umo.cycle.clock import Clock
from umo.cycle.image import Block, Image
from umo.objects import Atomic
from umo.objects.scaling import FloatArray, IntArray, to_values
from umo.wiring.resolved import Wire

ARRAYS_FROM = 50
"""Objects from which on the array form is the faster one."""


def make_image(wires: Sequence[Wire], clock: Clock, timer: Atomic | None = None) -> Image:
    form = ArrayImage if len(wires) >= ARRAYS_FROM else ListImage
    return form(wires, clock, timer)


class ListImage(Image):
    """Values in lists, for small machines."""

    def _make(self, count: int) -> None:
        self.values = [0.0] * count
        self.pending = [0.0] * count
        self.quality = [0] * count
        self.times = [nan] * count

    def _convert(self, block: Block) -> list[tuple[int, float]]:
        values, slot = self.values, block.start
        self.raws_array[slot : block.stop] = block.buffer
        outside = []
        for raw, (resolution, zero_offset, low, high) in zip(block.buffer.tolist(), block.scales, strict=True):
            value = raw * resolution + zero_offset  # scaling.to_value, in line
            if low <= value <= high:
                values[slot] = value
            else:
                outside.append((slot, value))
            slot += 1
        return outside

    def _commit(self, block: Block, now: float) -> None:
        start, stop = block.start, block.stop
        self.values[start:stop] = self.pending[start:stop]
        self.raws_array[start:stop] = block.buffer
        self.times[start:stop] = [now] * (stop - start)

    def _stamp(self, block: Block, now: float) -> None:
        self.times[block.start : block.stop] = [now] * (block.stop - block.start)

    def _all_good(self, slots: slice) -> bool:
        return not any(self.quality[slots])

    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        self.pending_raws_array[slots] = raws
        for slot, value in zip(_indices(slots), values.tolist(), strict=True):
            self.pending[slot] = value

    def get_values(self, slots: slice | IntArray) -> FloatArray:
        return np.array([self.values[slot] for slot in _indices(slots)])


class ArrayImage(Image):
    """Values in arrays; single objects reach them through memoryviews, which are quicker than numpy's items."""

    def _make(self, count: int) -> None:
        self.values_array = np.zeros(count)
        self.pending_array = np.zeros(count)
        self.quality_array = np.zeros(count, np.uint8)
        self.times_array = np.full(count, nan)
        self.values = self.values_array.data
        self.pending = self.pending_array.data
        self.quality = self.quality_array.data
        self.times = self.times_array.data
        self.resolution, self.zero_offset, self.low, self.high = np.array(self.scales).reshape(-1, 4).T.copy()
        self.scratch = np.zeros(count)

    def _convert(self, block: Block) -> list[tuple[int, float]]:
        part = slice(block.start, block.stop)
        self.raws_array[part] = block.buffer
        values = to_values(block.buffer, self.resolution[part], self.zero_offset[part], self.scratch[part])
        inside = values >= self.low[part]
        inside &= values <= self.high[part]
        if inside.all():
            self.values_array[part] = values
            return []
        self.values_array[part] = np.where(inside, values, self.values_array[part])
        return [(block.start + int(i), float(values[i])) for i in np.flatnonzero(~inside)]

    def _commit(self, block: Block, now: float) -> None:
        part = slice(block.start, block.stop)
        self.values_array[part] = self.pending_array[part]
        self.raws_array[part] = block.buffer
        self.times_array[part] = now

    def _stamp(self, block: Block, now: float) -> None:
        self.times_array[block.start : block.stop] = now

    def _all_good(self, slots: slice) -> bool:
        return not self.quality_array[slots].any()

    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        self.pending_array[slots] = values
        self.pending_raws_array[slots] = raws

    def get_values(self, slots: slice | IntArray) -> FloatArray:
        return self.values_array[slots].copy()


def _indices(slots: slice | IntArray) -> Sequence[int]:
    return range(slots.start, slots.stop, slots.step or 1) if isinstance(slots, slice) else slots.tolist()

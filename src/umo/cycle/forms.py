"""The forms of the process image, proved equal by tests.

The compiled one is the quickest. It needs an extension in C (`scan.c`), which is built where umo is installed and a C
compiler is there. Without it, plain lists are fastest for small machines, as Python specialises list subscripts; numpy
wins above (`python -m bench --forms` measures where; docs/decisions/0001-forms-of-the-image.md records it).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import nan

import numpy as np

from umo.cycle.block import Block
from umo.cycle.clock import Clock
from umo.cycle.image import Image
from umo.objects.linearization import Linearizations
from umo.objects.scaling import FloatArray, IntArray, to_values
from umo.wiring.resolved import Wired

try:
    from umo.cycle import _scan as extension
except ImportError:  # it was not built
    extension = None  # type: ignore[assignment]
ARRAYS_FROM = 85
"""Objects from which on the array form is faster than the list form."""


def make_image(wired: Wired, clock: Clock) -> Image:
    return form_for(len(wired.wires))(wired, clock)


def form_for(count: int) -> type[Image]:
    """The quickest one at hand for so many objects."""
    if extension is not None:
        return CompiledImage
    return ArrayImage if count >= ARRAYS_FROM else ListImage


class ListImage(Image):
    """Values in lists, for small machines without the extension."""

    def _make(self, count: int) -> None:
        self.values = [0.0] * count
        self.pending = [0.0] * count
        self.quality = [0] * count
        self.times = [nan] * count

    def _prepare_input(self, block: Block) -> None:
        columns = _columns(self, block)
        if columns.special:
            block.convert = partial(self._convert_special, block, columns)
        else:
            scales = [(slot, *self.scales[slot]) for slot in range(block.start, block.stop)]
            block.convert = partial(self._convert, block, scales)

    def _convert_special(self, block: Block, columns: _Columns, now: float) -> list[tuple[int, float]]:
        """A block with a linearization, or with invalid raws within a range."""
        self.raws[block.slots] = block.view
        values = columns.fill(block.buffer).tolist()
        inside = ((columns.low <= columns.values) & (columns.values <= columns.high)).tolist()
        outside = []
        for slot, value, good in zip(range(block.start, block.stop), values, inside, strict=True):
            if good:
                self.values[slot] = value
            else:
                outside.append((slot, value))
        if not outside:
            self._stamp(block, now)
        return outside

    def _convert(
        self, block: Block, scales: list[tuple[int, float, float, float, float]], now: float
    ) -> list[tuple[int, float]]:
        raws, values = self.raws, self.values
        raws[block.slots] = block.view
        outside = []
        for slot, resolution, zero_offset, low, high in scales:
            value = resolution * raws[slot] + zero_offset  # scaling.to_value in line; float first is quicker
            if low <= value <= high:
                values[slot] = value
            else:
                outside.append((slot, value))
        if not outside:
            self.times[block.slots] = [now] * block.count
        return outside

    def _commit(self, block: Block, now: float) -> None:
        slots = block.slots
        self.values[slots] = self.pending[slots]
        self.raws[slots] = block.view
        self.times[slots] = [now] * block.count

    def _stamp(self, block: Block, now: float) -> None:
        self.times[block.slots] = [now] * block.count

    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        self.pending_raws_array[slots] = raws
        for slot, value in zip(_indices(slots), values.tolist(), strict=True):
            self.pending[slot] = value

    def get_values(self, slots: slice | IntArray) -> FloatArray:
        return np.array([self.values[slot] for slot in _indices(slots)])


class _Columns:
    """The scales of one input block as arrays, and room for its conversion."""

    special = False

    def __init__(self, scales: FloatArray) -> None:
        self.resolution, self.zero_offset, self.low, self.high = scales.T.copy()
        self.values = np.zeros(len(scales))
        self.view = self.values.data
        self.inside, self.below = np.zeros((2, len(scales)), np.bool_)
        self._unshifted = not self.zero_offset.any() and bool((self.resolution > 0).all())  # raw 0 is 0.0, not -0.0

    def fill(self, raws: IntArray) -> FloatArray:
        """The values of these raws, in `values`."""
        if self._unshifted:
            np.multiply(raws, self.resolution, out=self.values)
            return self.values
        return to_values(raws, self.resolution, self.zero_offset, self.values)


class _SpecialColumns(_Columns):
    """Columns with linearizations, or with invalid raws that lie within a range, by raw: their values are NaN."""

    special = True

    def __init__(self, scales: FloatArray, linearizations: Linearizations, hidden: dict[int, list[int]]) -> None:
        super().__init__(scales)
        self._linearizations = linearizations
        self._hidden = [(raw, np.array(places)) for raw, places in hidden.items()]

    def fill(self, raws: IntArray) -> FloatArray:
        self.values[:] = self._linearizations.to_values(super().fill(raws))
        for raw, places in self._hidden:
            self.values[places[raws[places] == raw]] = nan
        return self.values


def _columns(image: Image, block: Block) -> _Columns:
    scales = np.array(image.scales[block.slots]).reshape(-1, 4)
    linearizations = Linearizations(image.linearizations[block.slots])
    hidden: dict[int, list[int]] = {}
    for slot, raws in image.invalid_raws.items():
        _, _, low, high = image.scales[slot]
        for raw in raws if block.start <= slot < block.stop else ():
            if low <= image.value_of(slot, raw) <= high:
                hidden.setdefault(raw, []).append(slot - block.start)
    return _SpecialColumns(scales, linearizations, hidden) if linearizations or hidden else _Columns(scales)


class ArrayImage(Image):
    """Values in arrays, for large machines without the extension. Single objects reach them through memoryviews, which
    are quicker than numpy's items."""

    def _make(self, count: int) -> None:
        self.values_array = np.zeros(count)
        self.pending_array = np.zeros(count)
        self.quality_array = np.zeros(count, np.uint8)
        self.times_array = np.full(count, nan)
        self.values = self.values_array.data
        self.pending = self.pending_array.data
        self.quality = self.quality_array.data
        self.times = self.times_array.data

    def _prepare_input(self, block: Block) -> None:
        block.convert = partial(self._convert, block, _columns(self, block))

    def _convert(self, block: Block, columns: _Columns, now: float) -> list[tuple[int, float]]:
        self.raws[block.slots] = block.view
        values = columns.fill(block.buffer)
        inside = np.greater_equal(values, columns.low, out=columns.inside)
        inside &= np.less_equal(values, columns.high, out=columns.below)
        if np.count_nonzero(inside) == block.count:  # a fifth of the time of all()
            self.values[block.slots] = columns.view
            self.times_array[block.slots].fill(now)
            return []
        self.values_array[block.slots] = np.where(inside, values, self.values_array[block.slots])
        return [(block.start + int(i), float(values[i])) for i in np.flatnonzero(~inside)]

    def _commit(self, block: Block, now: float) -> None:
        slots = block.slots
        self.values[slots] = self.pending[slots]
        self.raws[slots] = block.view
        self.times_array[slots].fill(now)

    def _stamp(self, block: Block, now: float) -> None:
        self.times_array[block.slots].fill(now)

    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        self.pending_array[slots] = values
        self.pending_raws_array[slots] = raws

    def get_values(self, slots: slice | IntArray) -> FloatArray:
        return self.values_array[slots].copy()


class CompiledImage(ArrayImage):
    """Values in arrays, and blocks of plain scales converted in C."""

    def _prepare_input(self, block: Block) -> None:
        columns, slots = _columns(self, block), block.slots
        if columns.special:
            block.convert = partial(self._convert, block, columns)
        else:
            scales = np.array(self.scales[slots], float).data
            views = self.raws[slots], self.values[slots], self.times[slots]
            block.convert = extension.Inputs(block.view, scales, *views, block.start).convert

    def _prepare_output(self, block: Block) -> None:
        slots = block.slots
        views = self.pending[slots], self.raws[slots], self.values[slots], self.times[slots]
        block.commit = extension.Outputs(block.view, *views).commit


def _indices(slots: slice | IntArray) -> Sequence[int]:
    return range(slots.start, slots.stop, slots.step or 1) if isinstance(slots, slice) else slots.tolist()

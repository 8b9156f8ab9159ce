"""The conversion of a block at the edge of the process image.

Raw integers of inputs are converted to values after their transfer. Pending values of outputs are converted to raw
integers before their transfer.

The extension in C makes the conversion if the extension is built, if inputs have no user-defined linearization, and if
outputs have no linearization. Otherwise numpy makes the conversion. Tests prove that both give the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from math import inf, nan
from typing import Any

import numpy as np
from numpy import add, greater_equal, negative, subtract

from umo.cycle.columns import Block, Columns, Scales
from umo.errors import RangeError
from umo.objects.linearization import Linearizations
from umo.objects.scaling import FloatArray, IntArray, to_raws, to_steps, to_values

extension: Any = None
"""The extension in C; None if it was not built and numpy makes the conversion."""
with suppress(ImportError):
    extension = import_module("umo.cycle._columns")
ROUND_TO_EVEN = 1.5 * 2.0**52
"""The constant for rounding: the sum of the constant and a float below 2**51 is rounded half to even, and the
difference between the bits of sum and constant is the integer. This takes a fifth of the time of numpy's rint and
conversion to integers."""


def convert_inputs(block: Block, columns: Columns, scales: Scales, hidden: Mapping[int, Sequence[int]]) -> None:
    """Set `convert` of an input block, also after a change of its scales. `hidden` maps a raw integer to the indices in
    the block at which this integer is an invalid reading although it is within the range."""
    slots = block.slots
    linearizations = Linearizations(scales.linearizations[slots])
    curves = linearizations.in_c
    if extension is None or curves is None:
        block.convert = Inputs(block, columns, scales, linearizations, hidden).convert
    else:
        of_scales = scales.resolution, scales.zero_offset, scales.low, scales.high
        views = _views(block, *of_scales, columns.raws, columns.values, columns.times)
        invalid = tuple((place, raw) for raw, places in hidden.items() for place in places)
        of_curves = tuple((place, *curve) for place, curve in curves)
        block.convert = extension.Inputs(views, block.start, of_curves, invalid).convert


def convert_outputs(block: Block, columns: Columns, scales: Scales) -> None:
    """Set `give` and `commit` of an output block."""
    slots = block.slots
    linearizations = Linearizations(scales.linearizations[slots])
    if extension is None or linearizations:
        outputs = Outputs(block, columns, scales, linearizations)
        block.give, block.commit = outputs.give, outputs.commit
    else:
        of_scales = scales.resolution, scales.zero_offset, scales.least, scales.greatest
        of_image = columns.raws, columns.values, columns.times
        of_outputs = scales.rate, columns.pending, columns.sent, columns.stepped
        views = _views(block, *of_scales, *of_image, *of_outputs)
        native = extension.Outputs(views, columns.written[slots].data)
        block.give, block.commit = native.give, native.commit


def _views(block: Block, *columns: FloatArray | IntArray) -> tuple[memoryview, ...]:
    return block.raws.data, *(column[block.slots].data for column in columns)


class Inputs:
    """One block of inputs, converted by numpy. Its functions take arguments by position, because a call with names
    takes twice the time."""

    def __init__(
        self,
        block: Block,
        columns: Columns,
        scales: Scales,
        linearizations: Linearizations,
        hidden: Mapping[int, Sequence[int]],
    ) -> None:
        slots = block.slots
        self._block, self._linearizations = block, linearizations
        self._raws, self._values = columns.raws[slots].data, columns.values[slots]
        self._values_view, self._times = self._values.data, columns.times[slots]
        resolution, zero_offset = scales.resolution[slots], scales.zero_offset[slots]
        self._resolution = np.concatenate([resolution, -resolution])
        shifted = zero_offset.any() or not (resolution > 0).all()  # raw 0 is 0.0, not -0.0
        self._zero_offset = np.concatenate([zero_offset, -zero_offset]) if shifted else None
        self._bounds = np.concatenate([scales.low[slots], -scales.high[slots]])
        self._hidden = [(raw, np.array(places)) for raw, places in hidden.items()]
        self._both = np.zeros(2 * block.count)
        """The computed values, then the negative of each, so that one comparison checks both bounds."""
        self._rows = self._both.reshape(2, block.count)
        self._found, self._negative = self._rows
        self._found_view = self._found.data
        self._inside = np.zeros(2 * block.count, np.bool_)
        self._all_inside = bytes([True]) * 2 * block.count
        self._plain = not (linearizations or hidden)

    def convert(self, now: float) -> Sequence[tuple[int, float]]:
        """Convert the block as `Block.convert` does."""
        block, both = self._block, self._both
        self._raws[:] = block.view
        self._rows[...] = block.buffer  # as floats: quicker than a product of integers and floats
        to_values(both, self._resolution, self._zero_offset, both)
        if not self._plain:
            self._bend()
        if greater_equal(both, self._bounds, self._inside).tobytes() == self._all_inside:  # quicker than all()
            self._values_view[:] = self._found_view
            self._times.fill(now)
            return ()
        inside = self._inside.reshape(2, block.count).all(axis=0)
        np.copyto(self._values, self._found, where=inside)
        return [(block.start + int(i), float(self._found[i])) for i in np.flatnonzero(~inside)]

    def _bend(self) -> None:
        """Convert electrical quantities to values. The value of an invalid raw integer is NaN."""
        found = self._found
        found[:] = self._linearizations.to_values(found)
        for raw, places in self._hidden:
            found[places[self._block.buffer[places] == raw]] = nan
        negative(found, self._negative)


class Outputs:
    """One block of outputs, converted by numpy."""

    def __init__(self, block: Block, columns: Columns, scales: Scales, linearizations: Linearizations) -> None:
        slots = block.slots
        self._block, self._columns, self._scales = block, columns, scales
        self._linearizations = linearizations
        self._pending, self._sent = columns.pending[slots].data, columns.sent[slots]
        self._sent_view, self._values = self._sent.data, columns.values[slots].data
        self._raws, self._times = columns.raws[slots].data, columns.times[slots]
        self._stepped = columns.stepped[slots]
        self._resolution, zero_offset = scales.resolution[slots], scales.zero_offset[slots]
        self._zero_offset = zero_offset if zero_offset.any() else None
        self._found = np.zeros(block.count)
        self._bits = self._found.view(np.int64)
        self._rounding = np.full(block.count, ROUND_TO_EVEN)  # arrays: a number would have to become one at each call
        self._bits_of_rounding = self._rounding.view(np.int64)
        self._limited = bool(np.isfinite(scales.rate[slots]).any())
        self._plain = not linearizations and bool(scales.exact[slots].all())
        self._written = None if extension is None else columns.written[slots]

    def give(self, now: float, dt: float) -> None:
        """Encode the block as `Block.give` does."""
        if self._written is not None:
            extension.end_period(self._written)
        if self._limited or not self._plain:
            send(self._columns, self._scales, self._block.slots, self._linearizations, now, dt)
            return
        if self._sent_view.tobytes() == self._pending.tobytes():  # quicker than ==
            return  # what was given last is still to be sent
        self._sent_view[:] = self._pending
        found = to_steps(self._sent, self._resolution, self._zero_offset, self._found)
        add(found, self._rounding, found)
        subtract(self._bits, self._bits_of_rounding, self._block.raws)

    def commit(self, now: float) -> None:
        """Confirm the block as `Block.commit` does."""
        self._values[:] = self._sent_view
        self._raws[:] = self._block.view
        self._times.fill(now)
        if self._limited:
            self._stepped[self._stepped == inf] = now


def send(
    columns: Columns,
    scales: Scales,
    slots: slice | IntArray,
    linearizations: Linearizations,
    now: float,
    dt: float,
) -> None:
    """Set `sent` and `sent_raws` together: if a linearization raises an error, both stay unchanged. The linearization
    is not called for the last sent value or a default."""
    sent, stepped = _next(columns, scales, slots, now, dt)
    raws, at_default = columns.sent_raws[slots].copy(), sent == scales.defaults[slots]
    changed = sent.view(np.int64) != np.array(columns.sent[slots]).view(np.int64)
    new = changed & ~at_default
    if new.any():
        quantities = linearizations.to_inputs(sent, new) if linearizations else sent
        if not np.isfinite(quantities[new]).all():
            raise RangeError(f"a linearization has no finite inverse at one of {sent[new].tolist()}")
        bounds = scales.least[slots][new], scales.greatest[slots][new]
        raws[new] = to_raws(quantities[new], scales.resolution[slots][new], scales.zero_offset[slots][new], *bounds)
    raws[changed & at_default] = scales.default_raws[slots][changed & at_default]
    columns.sent[slots], columns.sent_raws[slots], columns.stepped[slots] = sent, raws, stepped


def _next(
    columns: Columns, scales: Scales, slots: slice | IntArray, now: float, dt: float
) -> tuple[FloatArray, FloatArray]:
    """Return the values to be sent, and the new `stepped`. A value to be sent is `pending`, or as near to `pending` as
    the rate allows from the value accepted last. An actuator makes only one step at each time, and no step while a
    reset is still to be accepted (its `stepped` is infinite)."""
    pending, sent, stepped = columns.pending[slots].copy(), columns.sent[slots], columns.stepped[slots]
    limited = np.isfinite(scales.rate[slots])
    if not limited.any():
        return pending, stepped.copy()
    values, due = columns.values[slots], now > stepped
    way = np.where(limited & due, scales.rate[slots], 0.0) * np.where(due, dt or now - stepped, 0.0)
    left = pending - values
    near = np.abs(left) <= way * (1 + 1e-9)
    ramp = np.where(near, pending, values + np.copysign(way, left))
    return np.where(limited, np.where(due, ramp, sent), pending), np.where(due, now, stepped)


def is_built() -> bool:
    return extension is not None

"""Traces: the values of the objects and signals of a running station over the last seconds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from umo.digits import number_text
from umo.objects.presentation.described import Described

TRACE_BLOCKS = 16
"""Number of blocks of a trace. The last block is the newest."""
TRACE_SPAN = 16.0
"""Time in s on the machine's clock that a trace covers."""
MAX_TIME = 1e12
"""Largest time in s of a frame. A frame with a later time is damaged."""
BLOCKS = "▁▂▃▄▅▆▇█"

Floats = npt.NDArray[np.float64]


class Traces:
    """The smallest and the largest value of each row in each interval of time. NaN stands for an interval without a
    value."""

    def __init__(self, rows: int) -> None:
        self.low: Floats = np.full((TRACE_BLOCKS, rows), np.nan)
        self.high: Floats = np.full((TRACE_BLOCKS, rows), np.nan)
        self._stretch: int | None = None

    def add(self, times: Floats, values: Floats) -> None:
        """Add some frames, each with a time and a row of values. Frames without a time are ignored."""
        known = np.isfinite(times) & (np.abs(times) < MAX_TIME)
        times, values = times[known], values[known]
        stretches = (times * (TRACE_BLOCKS / TRACE_SPAN)).astype(np.int64)
        for number in np.unique(stretches)[-TRACE_BLOCKS:]:
            inside = values[stretches == number]
            passed = 1 if self._stretch is None else min(max(int(number) - self._stretch, 0), TRACE_BLOCKS)
            self._stretch = int(number)
            for kept in (self.low, self.high) if passed else ():
                kept[:-passed] = kept[passed:]
                kept[-passed:] = np.nan
            np.fmin(self.low[-1], np.fmin.reduce(inside), out=self.low[-1])
            np.fmax(self.high[-1], np.fmax.reduce(inside), out=self.high[-1])

    def of(self, rows: list[int]) -> tuple[Floats, Floats]:
        """Return the smallest and the largest value of some rows in each interval of time that has a value."""
        low, high = np.fmin.reduce(self.low[:, rows], axis=1), np.fmax.reduce(self.high[:, rows], axis=1)
        known = np.isfinite(low) & np.isfinite(high)
        return low[known], high[known]


def spark(traced: tuple[Floats, Floats], about: Described) -> str:
    """Return a block character for each interval of time. Its height shows the middle of the interval's values.
    `about`: the description of the row."""
    low, high = traced
    if not len(low):
        return ""
    middles = (low + high) / 2
    least, most = (0.0, 1.0) if about.is_binary else (middles.min(), middles.max())
    if most == least:
        return BLOCKS[0] * len(middles)
    return "".join(BLOCKS[round(share * (len(BLOCKS) - 1))] for share in (middles - least) / (most - least))


def traced_span(traced: tuple[Floats, Floats], about: Described) -> str:
    """Return the range of the values, such as `2 to 3.5`, or an empty text for a binary object or a named value."""
    low, high = traced
    if not (about.is_number and len(low)):
        return ""
    return f"{number_text(low.min(), about.digits)} to {number_text(high.max(), about.digits)}"

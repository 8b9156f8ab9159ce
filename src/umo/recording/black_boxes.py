"""Finds the black boxes of a recording. They show why periods were missed, and what a failed run did last.

The guardian of a run keeps them as files. Their frames are also in the recording, so a black box in a recording has
only the numbers of its frames and the causes that they show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from umo.errors import text_of
from umo.process.frames.blackbox import KEPT_PERIODS, MISSED_PERIOD, aftermath
from umo.process.frames.causes import explain_all, sentences
from umo.process.frames.layout import USAGE, Layout
from umo.process.frames.run_reader import Frames
from umo.recording.block import BlackBox, Block

INTERVAL = 10.0
"""Shortest time in s between two black boxes of missed periods, as for the guardian."""
MAX_LINES = 3
"""Number of the last missed periods that are explained."""
FIELDS = ("number", "time", "missed", "began", "wake", "execution", *(name for name, *_ in USAGE), "counted", "phases")
"""The fields from which the cause of a missed period is found."""


class _Window(NamedTuple):
    """Consecutive frames, with only the fields from which a cause is found."""

    first: int
    """Number of the first frame."""
    frames: Any

    def until(self, stop: int) -> _Window:
        """Return the last `KEPT_PERIODS` frames before the frame with the number `stop`."""
        end = min(max(stop - self.first, 0), len(self.frames))
        start = max(end - KEPT_PERIODS, 0)
        return _Window(self.first + start, self.frames[start:end])


class BlackBoxes:
    """Finds the black boxes of the blocks of one run. The blocks must be given in order."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._kept: _Window | None = None
        self._next = -np.inf
        period = float(layout.about.get("period") or 0.001)
        self._aftermath = round(aftermath(period) / period)
        self._missed = 0

    def added(self, blocks: Sequence[Block], end: str = "") -> list[Block]:
        """Return the blocks with their black boxes. `end`: the reason why the run has failed, if these are its last
        blocks."""
        found = [self._added(block) for block in blocks]
        if end and found and self._kept is not None:
            last = found[-1]
            found[-1] = replace(last, boxes=[*last.boxes, self._box(self._kept, end)])
        return found

    def _added(self, block: Block) -> Block:
        kept, frames = self._kept, _reduced(block.frames)
        if kept is None or kept.first + len(kept.frames) != block.first:
            kept = _Window(block.first, frames)
        else:
            kept = _Window(kept.first, np.concatenate([kept.frames, frames]))
        self._missed += int(frames["missed"].sum())
        self._kept = kept.until(block.stop)
        late = np.flatnonzero((frames["missed"] > 0) & (frames["time"] >= self._next))
        if not len(late):
            return block
        self._next = float(frames["time"][late[0]]) + INTERVAL
        window = kept.until(block.first + int(late[0]) + self._aftermath + 1)
        return replace(block, boxes=[self._box(window, MISSED_PERIOD)])

    def _box(self, window: _Window, reason: str) -> BlackBox:
        try:
            lines = sentences(window.frames, self._layout, explain_all(window.frames, self._layout), MAX_LINES)
        except Exception as error:  # the frames count for more
            lines = [f"no cause was found: {text_of(error)}"]
        start, time = float(window.frames["time"][0]), float(window.frames["time"][-1])
        return BlackBox(window.first, len(window.frames), start, time, reason, self._missed, "\n".join(lines))


def _reduced(frames: Frames) -> Any:
    """Return a copy of frames with only the fields in `FIELDS`, because a frame of many objects is large."""
    reduced = np.empty(len(frames), [(name, frames.dtype[name]) for name in FIELDS])
    for name in FIELDS:
        reduced[name] = frames[name]
    return reduced

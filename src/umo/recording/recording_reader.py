"""A recording that is read like a run, at a time that the caller chooses."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from umo.objects.scaling import FloatArray
from umo.operation.commands.client_commands import Mode
from umo.process.frames.reader import MODES
from umo.process.frames.run_reader import Frames, RunNow
from umo.process.frames.shown_run import ShownRun
from umo.recording.block import Block
from umo.recording.recording import Recording
from umo.recording.scope.history import last_good


class _Before(NamedTuple):
    """The data of a run that are not in its frames, at the first frame of a block."""

    first: int
    """The number of the frame."""
    mode: Mode | None
    holder: str
    lease: int
    tunables: list[float]
    missed: int
    """Number of periods that were missed before this frame."""
    good: FloatArray
    """The time in s at which each object was last read; NaN if it was never read."""

    def own(self, frames: Frames) -> Frames:
        """Return those of the frames of a chunk that belong to this block or to later ones."""
        return frames[max(self.first - number_of(frames), 0) :]


class RecordingReader(ShownRun):
    """Reads a recording. `add` is first called with each block of the recording, in order; after that frames can be
    shown. The recording stays open."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(recording.layout, recording.path)
        objects, tunables = len(self.layout.objects), len(self.layout.tunables)
        self._recording = recording
        self._blocks: list[_Before] = []
        self._next = _Before(0, None, "", 0, [0.0] * tunables, 0, np.full(objects, np.nan))
        """The data after the blocks that were added so far."""
        self.good = self._next.good
        """The time in s, as known at the shown frame, at which each object was last read; NaN if it was never read."""

    def add(self, block: Block) -> None:
        before, frames, live = self._next, block.frames, block.live
        holder = str(live.get("holder") or "")
        begun = before._replace(
            first=block.first,
            mode=_mode(live),
            holder=holder,
            lease=before.lease + (bool(self._blocks) and holder != before.holder),
            tunables=list(map(float, told)) if (told := self._numbers_of(live)) else before.tunables,
        )
        self._blocks.append(begun)
        missed = before.missed + int(frames["missed"].sum())
        self._next = begun._replace(missed=missed, good=last_good(frames, before.good))

    def _numbers_of(self, live: Mapping[str, Any]) -> list[float]:
        told = live.get("tunables") or []
        return told if len(told) == len(self.layout.tunables) else []

    def show_last(self, frames: Frames) -> None:
        """Show the last of some consecutive frames of one chunk. They must begin with the first frame of the chunk."""
        number = number_of(frames[-1:])
        block = self._blocks[max(bisect_right(self._blocks, number, key=lambda each: each.first) - 1, 0)]
        own = block.own(frames)
        events = self._recording.events
        stop = bisect_right(events, float(frames["time"][-1]), key=lambda each: each.event.time)
        missed = block.missed + int(own["missed"].sum())
        now = RunNow(block.mode, block.lease, block.holder, missed, number + 1, stop)
        self.good = last_good(own, block.good)
        self.show(frames[-1:], now, block.tunables, [each._replace(number=i) for i, each in enumerate(events[:stop])])


def number_of(frames: Frames) -> int:
    """Return the number of the first of these frames."""
    return int(frames["sequence"][0]) // 2 - 1


def _mode(live: Mapping[str, Any]) -> Mode | None:
    mode = live.get("mode")
    return None if mode is None else MODES.get(int(mode))

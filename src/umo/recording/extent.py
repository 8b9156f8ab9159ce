"""Which periods a file has: written into it when it is closed, so that its readers know what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from umo.recording.block import Block

EXTENT = "umo/periods"
"""Name of the metadata record that says it."""

FOLLOWED = "followed"
"""What stands in it of a file after which another one was begun."""


class Extent(NamedTuple):
    """The frames of a file."""

    first: int
    """Number of the first frame, from 0."""
    stop: int
    """Number of the frame that follows the last one."""
    periods: int
    """How many there are; fewer than from `first` to `stop`, where some were lost while it was recorded."""
    time: float
    """Time of the last one, s on the machine's clock."""

    @classmethod
    def of(cls, block: Block) -> Extent:
        return cls(block.first, block.stop, len(block.frames), float(block.frames["time"][-1]))

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> Extent | None:
        """None: it is malformed."""
        try:
            return cls(int(texts["first"]), int(texts["stop"]), int(texts["periods"]), float(texts["time"]))
        except (KeyError, ValueError):
            return None

    @property
    def texts(self) -> dict[str, str]:
        return {name: repr(value) for name, value in self._asdict().items()}

    def after(self, before: Extent | None) -> Extent:
        """Both together; `before` may be none."""
        if before is None:
            return self
        return Extent(before.first, self.stop, before.periods + self.periods, self.time)

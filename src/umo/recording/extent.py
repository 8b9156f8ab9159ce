"""The extent of a file: the periods that it contains. It is written into the file when the file is closed, so that
readers can find missing data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from umo.recording.block import Block

EXTENT = "umo/periods"
"""Name of the metadata record with the extent."""

FOLLOWED = "followed"
"""Key in the record `EXTENT` that is present if another file follows."""

DAMAGE = "umo/damage"
"""Name of the metadata record with sentences about the damage in the files from which this file was made."""
MAX_TOLD = 100
"""Largest number of sentences in the record `DAMAGE`."""


def not_closed(name: str, time: float | None) -> str:
    """Return the text about a file that was not closed. `time`: time in s at which the last block of the file begins,
    or None if it has no block."""
    last = "the file has no periods" if time is None else f"the data after the block of {time:g} s are missing"
    return (
        f"{name} was not closed (the file was cut, its recorder was killed, or the recorder is still writing): {last}"
    )


def damage_texts(told: Sequence[str]) -> dict[str, str]:
    """Return the sentences in a record of damage, in the order of their names."""
    few = list(told[:MAX_TOLD])
    if rest := len(told) - len(few):
        few.append(f"{rest:,} other places were damaged")
    return {f"{number:03}": text for number, text in enumerate(few)}


class Extent(NamedTuple):
    """The extent of one file: its frames."""

    first: int
    """Number of the first frame, from 0."""
    stop: int
    """Number of the frame that follows the last one."""
    periods: int
    """Number of periods. It is smaller than `stop` - `first` if some were lost while the file was recorded."""
    time: float
    """Time of the last period, in s on the machine's clock."""

    @classmethod
    def of(cls, block: Block) -> Extent:
        return cls(block.first, block.stop, len(block.frames), float(block.frames["time"][-1]))

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> Extent | None:
        """Return the extent in the content of a record, or None if it is malformed."""
        try:
            return cls(int(texts["first"]), int(texts["stop"]), int(texts["periods"]), float(texts["time"]))
        except (KeyError, ValueError):
            return None

    @property
    def texts(self) -> dict[str, str]:
        return {name: repr(value) for name, value in self._asdict().items()}

    def after(self, before: Extent | None) -> Extent:
        """Return the extent of both files together. `before`, the extent of the earlier file, may be None."""
        if before is None:
            return self
        return Extent(before.first, self.stop, before.periods + self.periods, self.time)

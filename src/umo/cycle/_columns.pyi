"""The extension in C for the columns of the process image: columns.c.

A view is whatever has a buffer of numbers of 8 bytes, without gaps, for the objects of one block: of the image's
columns and scales, in the order named. The views are held: their lengths are checked once. ValueError if they differ.
"""

from typing import final

from typing_extensions import Buffer

@final
class Inputs:
    """An input block, its views: moved, resolution, zero offset, low, high, raws, values, times. `start` is the slot
    of the first object."""

    def __new__(cls, views: tuple[Buffer, ...], start: int) -> Inputs: ...
    def convert(self, now: float, /) -> list[tuple[int, float]]:
        """As `Block.convert`."""

@final
class Outputs:
    """An output block, its views: moved, resolution, zero offset, least, greatest, raws, values, times, rate, pending,
    sent, stepped."""

    def __new__(cls, views: tuple[Buffer, ...]) -> Outputs: ...
    def give(self, now: float, dt: float, /) -> None:
        """As `Block.give`."""
    def commit(self, now: float, /) -> None:
        """As `Block.commit`."""

@final
class Body:
    """Writes the body of a frame. Holds views of the ring's file and of what the image shows; `size` is that of a body
    in bytes."""

    def __new__(cls, file: Buffer, shown: Buffer, size: int) -> Body: ...
    def write(
        self,
        at: int,
        number: int,
        time: float,
        missed: int,
        began: int,
        wake: int,
        execution: int,
        seldom: bytes,
        phases: list[int],
        signals: list[float],
        /,
    ) -> None:
        """As `umo.frames.body.Write`. ValueError unless it is as long as a body, TypeError for a number of another
        type, OverflowError for one that is too great."""

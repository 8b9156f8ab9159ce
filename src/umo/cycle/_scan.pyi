"""The extension in C of the compiled form of the process image: scan.c.

A view is whatever has a buffer of numbers of 8 bytes, without gaps, for the objects of one block. The views are held:
their lengths are checked once. ValueError if they differ in length.
"""

from typing import final

from typing_extensions import Buffer

@final
class Inputs:
    """An input block. `scales` has four numbers an object: resolution, zero offset, least and greatest value. `start`
    is the slot of the first object."""

    def __new__(
        cls, moved: Buffer, scales: Buffer, raws: Buffer, values: Buffer, times: Buffer, start: int
    ) -> Inputs: ...
    def convert(self, now: float, /) -> list[tuple[int, float]]:
        """As `Block.convert`."""

@final
class Outputs:
    """An output block; `moved` are the pending raw integers."""

    def __new__(cls, moved: Buffer, pending: Buffer, raws: Buffer, values: Buffer, times: Buffer) -> Outputs: ...
    def commit(self, now: float, /) -> None:
        """As `Block.commit`."""

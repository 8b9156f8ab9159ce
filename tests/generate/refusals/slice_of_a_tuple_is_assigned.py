"""A slice of a tuple is assigned."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceOfATupleIsAssigned(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def control(self) -> None:
        # refused: the slice is not that of a list or an array of numbers
        self.pair[1:] = (self.u,)  # type: ignore[index]

"""A slice of a list is added to."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceOfAListIsAddedTo(Program):
    def begin(self) -> None:
        self.list = [1.0, 2.0]

    def control(self) -> None:
        # refused: a slice of something that is not an array; its elements, one by one
        self.list[1:] += [self.u]

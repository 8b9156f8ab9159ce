"""A slice of a list becomes longer."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceOfAListThatGrows(Program):
    def begin(self) -> None:
        self.list = [1.0, 2.0]

    def control(self) -> None:
        # refused: the slice changes the length of its list; as many elements
        self.list[1:] = [self.u, 1.0]

"""Place in a list that a call replaces."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class PlaceInAListThatACallReplaces(Program):
    def begin(self) -> None:
        self.x3, self.y2 = np.zeros(3), np.zeros(2)
        self.i3, self.b3 = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.bool_)

    def next(self):
        self.x3 = np.ones(3)
        return 1

    def control(self) -> None:
        # refused: computing the index changes the container; assign the index to a name first
        self.k = self.x3[self.next()]

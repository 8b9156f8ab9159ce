"""Function of another module."""

from __future__ import annotations

import os.path

from helpers.written_programs import Program


class FunctionOfAnotherModule(Program):
    def control(self) -> None:
        # refused: getsize: its source is not there
        self.k = os.path.getsize("x") * 1.0

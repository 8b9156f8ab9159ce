"""Function of another module."""

from __future__ import annotations

import os.path

from helpers.written_programs import Program


class FunctionOfAnotherModule(Program):
    def control(self) -> None:
        # refused: getsize: it is not written in Python, or was created at run time; `def` in a file of the station
        self.k = os.path.getsize("x") * 1.0

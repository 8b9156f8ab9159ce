"""Function of c."""

from __future__ import annotations

import math

from helpers.written_programs import Program


class FunctionOfC(Program):
    def control(self) -> None:
        # refused: math.gamma cannot be translated; functions of Python code, math
        self.k = math.gamma(self.u)

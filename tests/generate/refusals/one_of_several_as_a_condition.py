"""One of several that may be empty."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class OneOfSeveralAsACondition(Program):
    def begin(self) -> None:
        self.groups = (self.fan,), ()

    def control(self) -> None:
        # refused: the object is chosen at run time; for n, each in enumerate(...): if n == place: ...
        if self.groups[self.n]:
            self.k = 1.0

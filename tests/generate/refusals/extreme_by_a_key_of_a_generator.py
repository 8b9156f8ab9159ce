"""An extreme by a key, of a generator."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeByAKeyOfAGenerator(Program):
    def control(self) -> None:
        # refused: a minimum or maximum of a generator is chosen by a key; a list, a tuple, a loop
        self.k = max((each for each in (self.u, self.k) if each > 1.0), key=abs)

"""A key that is computed."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeByAKeyThatIsComputed(Program):
    def control(self) -> None:
        # refused: the key function is computed; lambda each: ..., the name of a function
        self.k = max((1.0, self.u), key=[abs, float][self.n])

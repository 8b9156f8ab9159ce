"""An extreme by a key."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeWithAKey(Program):
    def control(self) -> None:
        # refused: an argument that cannot be translated is passed; default
        self.k = max((each for each in (self.u, self.k) if each > 1.0), default=0.0, key=abs)

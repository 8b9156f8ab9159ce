"""An extreme by texts."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeByAText(Program):
    def control(self) -> None:
        # refused: a minimum or maximum is chosen by something other than numbers or members of an IntEnum; float(...)
        self.k = max((1.0, 2.0), key=lambda u: "a" if u > 1.0 else "b")

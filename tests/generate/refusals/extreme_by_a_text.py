"""An extreme by texts."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeByAText(Program):
    def control(self) -> None:
        # refused: an extreme by what is no number and no member of an IntEnum; float(...)
        self.k = max((1.0, 2.0), key=lambda u: "a" if u > 1.0 else "b")

"""A bool or a state is written."""

from __future__ import annotations

from helpers.written_programs import Program


class TruthIsWritten(Program):
    def control(self) -> None:
        # refused: the two values have different types; bool(...), one type for both
        self.fan.write(self.yes and self.fan.inhibited)  # type: ignore[arg-type]

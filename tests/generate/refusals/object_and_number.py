"""Object and number."""

from __future__ import annotations

from helpers.written_programs import Program


class ObjectAndNumber(Program):
    def control(self) -> None:
        # refused: the value is compared with another type, for which Python raises TypeError; its states
        self.c = int(self.a == 1)  # type: ignore[comparison-overlap]

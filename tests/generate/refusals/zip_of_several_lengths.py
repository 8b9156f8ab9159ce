"""zip(strict=True) of several lengths."""

from __future__ import annotations

from helpers.written_programs import Program


class ZipOfSeveralLengths(Program):
    def control(self) -> None:
        # refused: `zip` with strict=True has arguments of different lengths; strict=False
        for each, other in zip((self.u, 1.0), (1.0,), strict=True):
            self.k = each + other

"""Nan among."""

from __future__ import annotations

from helpers.written_programs import Program


class NanAmong(Program):
    def control(self) -> None:
        # refused: `in` searches real numbers, where Python also finds a NaN that is the same object; ==, or
        self.c = int(self.u in (self.u, 1.0))

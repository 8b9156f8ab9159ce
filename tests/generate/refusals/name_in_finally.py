"""Name in finally."""

from __future__ import annotations

from helpers.written_programs import Program


class NameInFinally(Program):
    def control(self) -> None:
        try:
            found = 1.0 / self.u
        finally:
            # refused: it is used before it has a value on every way; give it a value first
            self.k = found

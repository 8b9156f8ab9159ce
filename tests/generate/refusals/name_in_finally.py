"""Name in finally."""

from __future__ import annotations

from helpers.written_programs import Program


class NameInFinally(Program):
    def control(self) -> None:
        try:
            found = 1.0 / self.u
        finally:
            # refused: on some branches it has no value or another object; give it a value first, or use one name per object
            self.k = found

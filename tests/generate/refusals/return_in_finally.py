"""Return in finally."""

from __future__ import annotations

from helpers.written_programs import Program


class ReturnInFinally(Program):
    def control(self) -> None:
        # refused: a jump out of `finally` discards the error; except
        try:
            self.k = 1.0 / self.u
        finally:
            return  # noqa: B012

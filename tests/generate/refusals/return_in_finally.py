"""Return in finally."""

from __future__ import annotations

from helpers.written_programs import Program


class ReturnInFinally(Program):
    def control(self) -> None:
        # refused: `finally` is left, which forgets the error; except
        try:
            self.k = 1.0 / self.u
        finally:
            return  # noqa: B012

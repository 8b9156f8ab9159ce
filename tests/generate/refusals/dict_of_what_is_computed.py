"""A dict that is made in each period."""

from __future__ import annotations

from helpers.written_programs import Program


class DictOfWhatIsComputed(Program):
    def control(self) -> None:
        # refused: the values of the dict are not known when the code is generated; an `if` for each key
        limits = {"low": self.u > 1.0, "high": self.u > 2.0}
        self.c = len(limits)

"""What a machine says of its work (`Compound.progress`)."""

from __future__ import annotations

from typing import NamedTuple

from umo.errors import RangeError


class Progress(NamedTuple):
    """A text, and how much of the work is done."""

    text: str = ""
    done: int = 0
    total: int = 0
    """0: not known."""

    def then(self, text: str, done: int | None, total: int | None) -> Progress:
        """The next one; numbers that are None stay. RangeError unless they are whole and 0 or more."""
        for name, number in (("done", done), ("total", total)):
            if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < 0):
                raise RangeError(f"progress: {name}={number!r} is not a whole number from 0 on")
        return Progress(str(text), self.done if done is None else done, self.total if total is None else total)

    @property
    def share(self) -> float:
        """Of the work that is done, from 0 to 1; 0 if the total is not known."""
        return min(self.done / self.total, 1.0) if self.total else 0.0

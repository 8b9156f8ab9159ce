"""The lines of `umo watch`: one for an object or a signal, one for a family that is folded; which of them are seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from umo.presentation.families import FOLDED_FROM, families, folded

MARKS = {True: "▾ ", False: "▸ "}


@dataclass(frozen=True)
class Line:
    """A line of the table."""

    name: str
    rows: list[int]
    """Places of what it shows; several: a family."""
    family: str = ""
    """The family that it opens and closes."""


class View:
    """State of the list: what is unfolded, where the cursor is, the first line that is seen."""

    def __init__(self, names: Sequence[str], fold: bool = True) -> None:
        self._names = names
        self._families = families(names)
        self._unfolded = set() if fold else set(self._families)
        self._plain = not fold
        self.cursor = self.top = 0
        self.lines = self._lines()

    def _lines(self) -> list[Line]:
        if self._plain:
            return [Line(name, [row]) for row, name in enumerate(self._names)]
        lines = []
        for family, rows in self._families.items():
            if len(rows) < FOLDED_FROM:
                lines += [Line(self._names[row], [row]) for row in rows]
                continue
            unfolded = family in self._unfolded
            lines.append(Line(MARKS[unfolded] + folded([self._names[row] for row in rows]), rows, family))
            if unfolded:
                lines += [Line(f"  {self._names[row]}", [row]) for row in rows]
        return lines

    def press(self, key: str, height: int) -> None:
        """Move by a key; fold or unfold what the cursor is on, or all."""
        page = max(1, height - 1)
        steps = {"up": -1, "down": 1, "page up": -page, "page down": page, "home": -len(self.lines), "end": 10**9}
        if key in steps:
            self.cursor += steps[key]
        elif key == "enter" and (family := self.lines[self.cursor].family):
            self._unfolded ^= {family}
        elif key == "all":
            self._unfolded = set() if self._unfolded else set(self._families)
        self.lines = self._lines()
        self.cursor = min(max(self.cursor, 0), len(self.lines) - 1)

    def visible(self, height: int) -> list[Line]:
        """The lines that fit, with the cursor among them."""
        self.top = min(max(self.top, self.cursor - height + 1), self.cursor, max(0, len(self.lines) - height))
        return self.lines[self.top : self.top + height]

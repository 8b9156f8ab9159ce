"""Slices of arrays and lists, read and assigned: each program is equal to Python in every period. What would be seen
through a second name is refused (the folder `refusals`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Rows(Program):
    def begin(self) -> None:
        self.row: Any = np.array([1.0, 2.0, 3.0, 4.0])
        self.numbers: Any = np.array([1, 2, 3, 4])
        self.list = [1.0, 2.0, 3.0, 4.0]


@equal
class DifferencesOfNeighbours(Rows):
    def control(self) -> None:
        steps = self.row[1:] - self.row[:-1]
        self.k = float(steps.sum()) + float(steps[0]) + float(max(self.row[1:])) + float(np.abs(self.row[1:3]).max())
        self.yes = bool((self.row[1:] > self.row[:-1]).all())
        self.row[0] = self.u


@equal
class StepsAndSlicesOfSlices(Rows):
    def control(self) -> None:
        self.k = float(self.row[::2].sum()) + float(self.row[::-1][0]) + float(self.row[3:0:-2].sum())
        self.k += float(self.row[1:][1:][0]) + float(self.row[::-1][:2].sum()) + float(self.row[-1:][0])
        self.row[1] = self.u


@equal
class Shifted(Rows):
    """As numpy does it, also where both overlap."""

    def control(self) -> None:
        self.row[1:] = self.row[:-1]
        self.row[0] = self.u
        self.k = float(self.row.sum())
        self.row[:-1] = self.row[1:].copy()
        self.row[:] = self.row[::-1]
        self.row[0:2], self.row[2:4] = self.u, [1.0, self.u]


@equal
class FilledAndAddedTo(Rows):
    def control(self) -> None:
        self.row[:] = 0
        self.row[1:3] = self.u
        self.numbers[::2] = self.n % 100
        self.numbers[1::2] += self.numbers[::2]
        self.row[1:] += self.row[:-1]
        self.row[::-1] *= self.row
        self.row[1:] = np.where(self.row[1:] > self.u, self.row[:-1], 0.5)


@equal
class SlicesUnderNames(Rows):
    """Nothing changes the array in place, so a copy is the same."""

    def above(self, row: Any) -> float:
        return float(row[0] + row.sum())

    def tail(self) -> Any:
        return self.row[1:]

    def control(self) -> None:
        part = self.row[1:] if self.u > 1.0 else self.row[:-1]
        self.k = float(part.sum()) + self.above(self.row[1:]) + self.above(self.row[::-1]) + float(self.tail()[0])
        self.row = self.row + self.u
        self.k += float(part[1])


@equal
class LoopsOverSlices(Rows):
    """An element is read when its turn comes."""

    def control(self) -> None:
        for x in self.row[1:]:
            self.k += float(x)
            self.row[2] = self.u
        for i, x in enumerate(self.row[::-1]):
            self.row[i] = self.k
            self.k += i * float(x)


@equal
class SlicesOfLists(Rows):
    def control(self) -> None:
        self.list[1:] = self.list[:-1]
        self.list[0] = self.u
        self.k = sum(self.list[1:3])
        self.list[::2] = (5.0, self.list[1])
        self.list[:] = [self.u, 1.0, self.list[0], self.list[1]]


test_it_is_what_python_does = CASES.test()

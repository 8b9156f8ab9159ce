"""What has a fixed number of elements: comprehensions, zip, enumerate, reversed, slices, dicts that are known. Each
program is equal to Python in every period."""

from __future__ import annotations

from enum import Enum

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Side(Enum):
    LEFT = 0
    RIGHT = 1


GAINS = (0.5, -1.0, 4.0)
COUNTS = [3, 1, 2, 7]
SPEEDS = {Side.LEFT: -2.0}
PAIRS = {Side.RIGHT: (1.0, -0.0), Side.LEFT: (2.0, 7.5)}
STEPS = {0: 5, 2: 7, -3: 1}
each = 2.5
"""A name of the module that comprehensions have, too."""


# Comprehensions --------------------------------------------------------------------------------------------


@equal
class Comprehensions(Program):
    def begin(self) -> None:
        self.row, self.pair = [1.0, -2.0, 4.0], (3, 5)

    def control(self) -> None:
        self.row[0] = self.u
        doubled = [x * 2.0 for x in self.row]
        self.k = max(doubled) + doubled[self.n % 3] + [g * self.u for g in GAINS][-1]
        self.row[1] = doubled[0]
        self.c = sum([n + i % 100 for i, n in enumerate(self.pair)]) + len(doubled)
        self.yes = any(x > 1.0 for x in doubled)
        for x in doubled:
            if x < self.k:
                self.k = x
        self.a.write(min(max([part.pending for part in (self.a, self.b)]) + 0.5, 2.0))


@equal
class OrderOfAComprehension(Program):
    """The elements are computed one after the other; what they go through was found before."""

    def begin(self) -> None:
        self.row = [1.0, 2.0, 4.0]

    def next(self, x: float) -> float:
        self.c += 1
        self.k = self.k * 2.0 + x
        return self.k

    def control(self) -> None:
        found = [self.next(x) for x in (self.k, self.u, self.k)]
        self.k = found[0] - found[2] + sum([self.next(x) for x in self.row])
        self.c += [self.c, self.n % 9, self.c][self.n % 3]


@equal
class NamesOfAComprehension(Program):
    """They are not those around it."""

    def control(self) -> None:
        x = self.u
        rows = [[x + y for x in (1.0, 2.0)][1] for y in (x, 3.0)]
        self.k = x + rows[0] * rows[1] + each
        self.k += sum([each * x for each in (self.u, 1.0)])
        nested = [sum(x for x in (x, 1.0)) for x in (x, 2.0)]
        self.k += nested[0] - nested[1] + each + x


@equal
class StatesOfAComprehension(Program):
    def begin(self) -> None:
        self.side = Side.LEFT

    def control(self) -> None:
        self.side = Side.LEFT if self.u > 1.0 else Side.RIGHT
        sides = [self.side if i % 2 else Side.RIGHT for i in range(3)]
        self.yes = sides[self.n % 3] is Side.LEFT
        self.c = sum([int(side is Side.RIGHT) for side in sides])


@equal
class FailureInAComprehension(Program):
    def control(self) -> None:
        try:
            found = [1.0 / x for x in (2.0, self.u, 4.0)]
            self.k = found[1]
        except ZeroDivisionError:
            self.k = -1.0
        self.c = sum([100 // (n - self.n) for n in (7, 2)])


@equal
class Generators(Program):
    def begin(self) -> None:
        self.row = [1.0, -2.0, 4.0]

    def control(self) -> None:
        self.row[2] = self.u
        self.k = max(x * 0.5 for x in self.row) - min(-x for x in self.row)
        found = list(x + 1.0 for x in self.row)  # noqa: C400
        self.k += sum(tuple(x - y for x, y in zip(found, GAINS, strict=False)))
        self.yes = all(x > y for x, y in zip(self.row, reversed(found), strict=False))
        self.c = sum(i * (x > 1.0) for i, x in enumerate(self.row))


# zip, enumerate, reversed ----------------------------------------------------------------------------------


@equal
class Zip(Program):
    def begin(self) -> None:
        self.row, self.cells = [1.0, 2.0, 4.0], [5, -6, 7, 8]

    def control(self) -> None:
        for x, n in zip(self.row, self.cells, strict=False):
            self.k += x * n
            self.row[2] = self.u
            self.cells[1] = self.n % 50
        for part, gain, i in zip((self.a, self.b), GAINS, range(9), strict=False):
            part.write(abs(gain) + i)
        for pair in zip(self.row, GAINS, strict=True):
            if pair[0] > pair[1]:
                self.c += 1
                continue
            break
        else:
            self.c += 10
        for _ in zip((), self.row, strict=False):
            self.c += 100
        for i, (x, n) in enumerate(zip(self.row, self.cells, strict=False), start=-2):
            self.c += i * n % 100 + int(x > self.u)


@equal
class ListsThatChangeWhileTheRestIsComputed(Program):
    """What a loop goes through is the list itself, whatever is computed after it."""

    def begin(self) -> None:
        self.row, self.cells = [1.0, 2.0, 4.0], [5, -6, 7]
        self.array = np.zeros(2)

    def next(self) -> float:
        self.cells[0] = (self.cells[0] + 1) % 50
        self.cells[2] += 1
        return self.u

    def control(self) -> None:
        for n, x in zip(self.cells, (self.next(), sum(x for x in self.row), 2.0), strict=True):
            self.k += n * x
            self.cells[1] = self.n % 50
        for n, x in zip(reversed(self.cells), (float(any(x > self.u for x in self.row)), self.next()), strict=False):
            self.k -= n * x
        self.array = np.minimum(self.array, sum(x for x in self.row))
        self.array[0] = self.u


@equal
class Enumerate(Program):
    def begin(self) -> None:
        self.row, self.cells = [1.0, 2.0, 4.0], [5, -6, 7]

    def control(self) -> None:
        for i, x in enumerate(self.row):
            if x > self.u:
                self.cells[i] += 1
                self.row[i] = 0.0
            self.c += i
        for i, x in enumerate(self.row, 10):
            self.k += x * i
        for number, part in enumerate((self.a, self.b)):
            part.write(self.row[number] + number)
        for i, n in enumerate(reversed(self.cells)):
            self.c += n if i else -n
        self.yes = i == 2


@equal
class Reversed(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0, 4.0]

    def control(self) -> None:
        self.row[1] = self.u
        for x in reversed(self.row):
            self.k = self.k * 0.5 + x
            self.row[0] = self.k
        for i in reversed(range(self.c % 2, 3) if False else range(1, 7, 2)):
            self.c = (self.c * 3 + i) % 1000
        last, first = list(reversed((self.u, self.k)))
        self.k = last - first
        for gain in reversed(GAINS):
            self.k += gain


@equal
class ArraysThatAreGoneThrough(Program):
    def begin(self) -> None:
        self.array, self.other = np.array([1.0, 2.0, 4.0]), np.zeros(3)

    def control(self) -> None:
        self.array = self.array * 0.5 + 1.0
        for i, x in enumerate(self.array):
            self.other[i] = x + i
        for x, y in zip(self.array + 1.0, reversed(self.other), strict=False):
            self.k += float(x) * float(y)
        self.k += max([float(x) for x in self.other])


# Tuples and lists as wholes --------------------------------------------------------------------------------


@equal
class Slices(Program):
    def begin(self) -> None:
        self.row, self.pair = [1.0, -2.0, 4.0, 8.0], (1, 2.5, 3)

    def control(self) -> None:
        self.row[3] = self.u
        head, last, backwards = self.row[:2], self.row[-1:], self.row[::-1]
        self.row[0] = self.k
        self.k = head[0] - last[0] + backwards[self.n % 4] + sum(self.row[1:3]) + len(self.row[9:])
        self.c = sum(COUNTS[1:]) + COUNTS[::2][self.n % 2] + self.pair[::2][1]
        for x in self.row[1:]:
            self.row[2] = x
        self.k += max((self.u, 1.0, 2.0)[1:]) + sum(self.row[-3:-1]) + (*self.pair[:2], 7)[1]
        self.yes = self.row[:2] != [1.0, 2.0] if False else self.pair[:1] == (self.n,)


@equal
class SlidingWindow(Program):
    """The last values, as a tuple that is created at each call."""

    def begin(self) -> None:
        self.last, self.counts, self.empty = (0.0, 0.0, 0.0), (0, 0), 0

    def control(self) -> None:
        self.last = (*self.last[1:], self.u)
        self.counts = self.counts[1:] + (self.n % 100,)  # noqa: RUF005
        self.k = sum(self.last) / len(self.last)
        self.c = max(self.counts) - min((0,) * 2 + self.counts)
        self.yes = self.n in self.counts


@equal
class OrderOfASlice(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0, 4.0]

    def turn(self) -> float:
        self.row[0], self.row[2] = self.row[2], self.u
        return self.row[1]

    def control(self) -> None:
        self.k = sum(self.row[1:]) + self.turn() + (self.row[0], self.turn(), *self.row[:1])[self.n % 3]


@equal
class ElementsAmong(Program):
    def begin(self) -> None:
        self.cells, self.pair, self.marks = [1, 2, 5], (3, 4), [True, False]

    def control(self) -> None:
        self.cells[1] = self.n
        self.yes = self.n in self.cells[1:] and self.n not in self.pair
        self.c = int(5 in self.cells) + 2 * int(self.u in (1.0, 2.0) if False else self.n in self.cells)
        self.c += 4 * int((self.u > 1.0) in self.marks)


# Dicts -----------------------------------------------------------------------------------------------------


@equal
class DictWithDefault(Program):
    def begin(self) -> None:
        self.side: Side | None = None

    def control(self) -> None:
        self.side = None if self.n > 3 else Side.LEFT if self.u > 1.0 else Side.RIGHT
        self.k = SPEEDS.get(self.side, self.u) + (STEPS.get(self.n) or 0)
        found = STEPS.get(self.n % 3, -1)
        self.c = found if self.n % 3 in STEPS else 100
        self.yes = STEPS.get(self.n) is None
        self.c += STEPS.get(0, 9) + STEPS.get(1, 9)
        pair = PAIRS.get(self.side)
        if pair is not None:
            self.k -= pair[1]
        try:
            self.k += SPEEDS[self.side]
        except KeyError:
            self.c += 1000
        self.c += self.side in SPEEDS


@equal
class PairsOfADict(Program):
    def control(self) -> None:
        for n, step in STEPS.items():
            if self.n == n:
                self.c += step
        self.k = max(STEPS.values()) + sum(self.u * n for n in STEPS.keys())  # noqa: SIM118
        self.c += [n * step for n, step in STEPS.items()][self.n % 3]


test_it_is_what_python_does = CASES.test()

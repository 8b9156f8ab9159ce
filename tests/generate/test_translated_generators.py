"""Generators with conditions, `:=`, values of `and` and `or`: each program is equal to Python in every period."""

from __future__ import annotations

from enum import Enum

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Mode(Enum):
    OFF = 1
    ON = 2


class Rows(Program):
    def begin(self) -> None:
        self.row, self.column, self.numbers = [1.0, -2.0, 4.5], [3.0, -1.0, 0.5], np.zeros(3)


# Generators with conditions ----------------------------------------------------------------------------------


@equal
class CallsBesideWhatIsChanged(Program):
    """The function that a generator calls changes nothing of it."""

    def begin(self) -> None:
        self.row = [1.0, -2.0, 4.0]

    @property
    def half(self) -> float:
        return self.u / 2.0

    def control(self) -> None:
        self.row[1] = self.u
        self.k = [x * self.half for x in self.row][1] + max(x + self.half for x in self.row)


@equal
class SumWithACondition(Rows):
    def control(self) -> None:
        self.k = sum(x for x in self.row if x > self.u) + 0.0
        self.c = sum(1 for x in self.row if x > self.u) + sum(x > 0.0 for x in self.row if x < self.u)
        self.row[0] = self.u


@equal
class SumFromAStart(Rows):
    def control(self) -> None:
        self.k = sum((x for x in self.row if x > self.u), 0.0) * 2
        self.k += sum((x for x in self.row if x > self.u), start=self.u) * 3
        self.k += sum(self.row, 0.0) + sum(self.row, self.u) + sum((x * 2 for x in self.row), start=1.5)


@equal
class ExtremesWithConditions(Rows):
    def control(self) -> None:
        self.k = max((x for x in self.row if x > self.u), default=-1.0) + max([x for x in self.row if x < 100.0])
        self.c = min((i for i in range(3) if self.row[i] > self.u), default=7)
        self.row[1] = self.u


@equal
class ExtremesOfZerosAndNan(Program):
    """The first one of equal ones, and of those that cannot be compared."""

    def control(self) -> None:
        self.k = max(x for x in (0.0, -0.0, self.u) if self.n > -10)
        self.a.write(min((x for x in (self.u, 0.0, -0.0, self.k) if x == x and x < 1e9 and x > -1e9), default=0.0))


@equal
class ExtremeOfNothing(Rows):
    def control(self) -> None:
        self.k = max(x / self.n for x in self.row if x > self.u)


@equal
class ExtremeOfWhatIsThere(Program):
    def control(self) -> None:
        found = min((x for x in (self.u, self.maybe, self.k) if x is not None and x > 1.0), default=None)
        self.k = 3.0 if found is None else found
        self.yes = max([self.maybe]) is None  # type: ignore[type-var]


@equal
class FirstWithACondition(Rows):
    def control(self) -> None:
        self.k = next((x * 2 for x in self.row if x > self.u), 0.0)
        place = next((i for i, x in enumerate(self.row) if x > self.u), None)
        self.c = -1 if place is None else place
        self.row[1] = self.u


@equal
class FirstOfStates(Program):
    def begin(self) -> None:
        self.mode = Mode.OFF

    def control(self) -> None:
        self.mode = next((mode for mode, able in ((Mode.ON, self.u > 1.0), (Mode.OFF, self.n > 2)) if able), Mode.ON)


@equal
class ListsAreMadeBeforeTheyAreAsked(Rows):
    def bump(self, x: float) -> bool:
        self.c += 1
        return x > self.u

    def control(self) -> None:
        self.yes = any([self.bump(x) for x in self.row if x < 3.0]) or all([self.bump(x) for x in self.row if x < 2.0])  # noqa: C419
        self.c += len([x for x in self.row if x > self.u])


@equal
class SeveralLoops(Rows):
    def control(self) -> None:
        self.k = sum(x * y for x in self.row for y in self.column) + 0.0
        self.yes = any(x * y > self.u for x in self.row if x > 1.0 for y in self.column if y != 0.5)
        self.c = int(all(x < y for x in self.row for y in self.column))
        self.c += max(i for i in range(3) for j in range(i) if j < self.n)
        self.row[0] = self.u


@equal
class NamesOfGenerators(Rows):
    def control(self) -> None:
        x = 5.0
        self.k = sum(x for x in self.row if x > 1.0) + x
        self.c = sum(1 for x in self.row if any(x > y for x in self.row for y in self.row if y < x))


@equal
class GeneratorsInLoops(Rows):
    def control(self) -> None:
        for i in range(3):
            self.k += max((x for x in self.row if x > i), default=0.0) * 1.0
            if any(x > self.u for x in self.row):
                continue
            self.c += 1
        self.k += sum(part.pending for part in (self.a, self.b) if part.pending > self.u) + 0.5
        self.a.write(float(self.n % 5))


@equal
class OrderOfTheConditions(Rows):
    def seen(self, x: float) -> float:
        self.u += 1.0
        return x

    def control(self) -> None:
        self.k = self.u + sum(self.seen(x) for x in self.row if self.seen(x) > self.u - 3.0) + self.u


@equal
class ArraysAndComputedRanges(Rows):
    def control(self) -> None:
        self.k = float(max((x for x in self.numbers if x > 0.0), default=0.5))
        self.k += sum(float(x) for x in self.numbers if x > 0.0)
        self.k += sum((self.row[i] for i in range(self.n % 3) if i < 5), 0.0)
        self.numbers[1] = self.u


@equal
class ConditionsThatAreKnown(Rows):
    def control(self) -> None:
        found = [self.row[i] for i in range(3) if i != 1]
        self.k = found[1] + len(found)


# Names that conditions give a value --------------------------------------------------------------------------


@equal
class NamesInConditions(Program):
    def control(self) -> None:
        if self.n > 3:
            self.k = 1.0
        elif self.n > 0 and (x := self.u) > 1.0:
            self.k = x
        elif self.n < 0 or (y := self.u + 1.0) > 1.0:
            self.k = 2.0
        else:
            self.k = y
        if not (self.n > 1 and (z := self.u) > 0.0):
            return
        self.k = z + (w if self.n > 0 and (w := self.u) > 2.0 else 0.5)


@equal
class NamesInLoopsAndAssertions(Program):
    def control(self) -> None:
        i = 0
        while i < 5 and (z := i * 2) < 7:
            i += 1
            self.c += z
        assert self.n > -5 and (y := self.u) > -1e5  # noqa: RUF018
        self.k = y


@equal
class NamesInGenerators(Rows):
    def control(self) -> None:
        if any((w := x) > self.u for x in self.row):
            self.k = w
        last = -1.0
        self.c = sum(1 for x in self.row if (last := x) > self.u)
        total = sum((kept := x) for x in self.row)
        self.k += last + kept + total


# Values of and and or ----------------------------------------------------------------------------------------


@equal
class StatesOrNone(Program):
    mode: Mode | None
    other: Mode | None

    def begin(self) -> None:
        self.mode, self.other, self.chosen = None, None, Mode.OFF

    def control(self) -> None:
        self.other = self.mode and Mode.OFF
        self.chosen = self.mode or Mode.ON
        self.yes = bool(self.u > 1.0 and self.mode) and not (self.mode and self.n)
        self.c = 1 if self.mode and self.maybe else 2
        while self.n > 0 and self.mode and self.c < 10:
            self.c += 3
        self.mode = (self.mode or Mode.ON) if self.n > 1 else None


@equal
class TuplesOrNone(Program):
    last: tuple[float, float] | None

    def begin(self) -> None:
        self.last, self.row = None, [1.0, 2.0]

    def control(self) -> None:
        x, y = self.last or (0.5, self.u)
        self.k = x + y + (self.row[0] if self.row else 9.0)
        if self.last:
            self.c += 1
        self.last = (self.u, 2.0) if self.n > 1 else None


@equal
class NumbersOfNumpyOrNone(Rows):
    last: float | None

    def control(self) -> None:
        found = None if self.n > 3 else self.numbers[0]
        if found is not None:
            self.k = float(found / 2.0) + float(self.numbers[1] / found)
        self.numbers[0] = self.u


# super() -----------------------------------------------------------------------------------------------------


class Base(Program):
    gain = 2.0

    @property
    def level(self) -> float:
        return self.u + 1.0

    @classmethod
    def two(cls) -> float:
        return 2.0


@equal
class AttributesOfSuper(Base):
    gain = 3.0

    @property
    def level(self) -> float:
        return super().level * super().gain + super().two()

    def control(self) -> None:
        self.k = self.level


test_it_is_what_python_does = CASES.test()

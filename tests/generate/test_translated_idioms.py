"""Idioms of control engineers: each program is equal to Python in every period."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any, NamedTuple

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Speed(Enum):
    LOW = 0.25
    MID = 0.5
    HIGH = 1.0

    @property
    def next(self) -> Speed:
        return {Speed.LOW: Speed.MID, Speed.MID: Speed.HIGH}.get(self, Speed.HIGH)


class Level(IntEnum):
    HIGH = 7
    LOW = 1
    MID = 3


class Sample(NamedTuple):
    value: float
    number: int


class Step(NamedTuple):
    name: str
    time: float
    is_last: bool


STEPS = Step("fill", 0.5, False), Step("heat", 2.5, False), Step("drain", -1.0, True)


@dataclass(frozen=True)
class Product:
    time: float
    speed: Speed


PRODUCTS = {"glue": Product(1.5, Speed.LOW), "soap": Product(0.0, Speed.HIGH)}


@dataclass
class Lag:
    gain: float
    last: float = 0.0

    def __call__(self, u: float) -> float:
        self.last += self.gain * (u - self.last)
        return self.last


class Rows:
    def __init__(self, value: float) -> None:
        self.row = [value, 1.0]


class Part:
    def __init__(self, gain: float) -> None:
        self.gain, self.runs = gain, 0

    @property
    def is_slow(self) -> bool:
        return self.gain < 1.0

    def begin(self, by: int, gain: float = 2.0) -> int:
        self.runs += by
        self.gain -= gain
        return self.runs

    def __call__(self, u: float) -> float:
        self.runs += 1
        return self.gain * u


# Unpacking and membership ----------------------------------------------------------------------------------


@equal
class StarsInWhatIsAssignedTo(Program):
    def begin(self) -> None:
        self.row, self.cells = [0.5, -0.0, 2.0], [1, 2, 3, 4]

    def control(self) -> None:
        first, *rest = self.row
        rest[1] = self.u
        self.k = first + len(rest) + rest[-1] + self.row[2]
        *head, (one, two) = *self.cells, (self.n, 7)
        a, *middle, d = head
        self.c = a + middle[1] * two - d + one
        self.cells[2] = self.n
        self.c += middle[1]


@equal
class AListThatIsUnpackedHasNoOtherName(Program):
    def begin(self) -> None:
        self.row, self.array = [0.5, -0.0, 2.0], np.ones(3)

    def control(self) -> None:
        a, b, c = self.row
        self.row[1] = self.u
        d, e, f = self.array
        self.array[1:] = self.u
        self.k = a - b - c + float(e) + float(d) - float(f)


@equal
class ElementsOfSets(Program):
    def begin(self) -> None:
        self.level = Level.MID

    def control(self) -> None:
        self.c = 1 if self.n in {1, 2, -3} else 2 if self.n not in {0, 4} else 3
        self.k = 1.0 if self.u in {0.5, 2.0} else -1.0
        self.level = Level.LOW if self.n in {3} else Level.MID
        if self.level in {Level.LOW, Level.HIGH}:
            self.c += 10


# Loops and names -------------------------------------------------------------------------------------------


@equal
class NamesAfterLoopsWithTurns(Program):
    def begin(self) -> None:
        self.row = [0.5, -0.0, 2.0]

    def first(self) -> float:
        for each in self.row:
            return each + self.u
        raise ValueError

    def control(self) -> None:
        for i in range(5):
            if i > self.n:
                break
            if i == self.x.read():
                continue
            last = i * 2
            self.c += last
        for value in self.row:
            self.k += value
        for j in range(4, 0, -2):
            self.c -= j
        self.k += value + self.first()
        self.c += 10 * i + j


@equal
class GeneratorsThatAreUnpacked(Program):
    def begin(self) -> None:
        self.parts = (Part(0.5), Part(-2.0))

    def control(self) -> None:
        fast, slow = (part(self.u) for part in self.parts)
        self.k = fast - slow
        [self.c, also] = (each.runs + self.n % 3 for each in self.parts)
        self.c += also


@equal
class DataclassesThatAreCalled(Program):
    def begin(self) -> None:
        self.fast, self.slow = Lag(0.5), Lag(0.125)

    def control(self) -> None:
        self.k = self.fast(self.u) - self.slow(self.x.read())


@equal
class TuplesOfObjectsUnderAName(Program):
    def begin(self) -> None:
        self.one, self.two = Part(1.0), Part(0.0)

    def control(self) -> None:
        parts = (self.one, self.two)
        for i, part in enumerate(parts):
            if self.u > i:
                part.gain += parts[1 - i].runs
            self.k += part(self.u)
        self.c = len(parts) + parts[0].runs


# Tables and patterns ---------------------------------------------------------------------------------------


@equal
class TablesThatAreWrittenDown(Program):
    def begin(self) -> None:
        self.speed = Speed.LOW

    def control(self) -> None:
        self.k = {Speed.LOW: 0.5, Speed.MID: -0.0, Speed.HIGH: 3.0}[self.speed] * self.speed.value
        self.speed = Speed.LOW if self.u < 0.0 else self.speed.next
        self.yes = self.n in {1: 2.0, 5: 3.0}
        self.c = {1: 10, 4: 30}[self.n] if self.x.read() > 2.0 else {1: 7, 5: 8}.get(self.n, 9)


@equal
class NamesInPatterns(Program):
    def begin(self) -> None:
        self.speed = Speed.LOW

    def of_pair(self, a: float, b: Any) -> float:
        match a, b:
            case 0.0, Speed.LOW | Speed.MID:
                return 1.0
            case x, Speed.LOW:
                return x + 2.0
            case 7.0 | 3.0 as y, _:
                return y * 3.0
            case (_, Speed.MID) if self.yes:
                return 4.0
        return -1.0

    def control(self) -> None:
        match self.n % 7:
            case 0:
                self.c = 100
            case n if n < 3:
                self.c = n
            case 5 | 6 as m:
                self.c = -m
            case other:
                self.c = other + n
        self.k = self.of_pair(self.x.read(), self.speed)
        self.speed, self.yes = self.speed.next, self.u > 0.0


# One of several objects --------------------------------------------------------------------------------------


@equal
class ObjectsAtComputedPlaces(Program):
    def begin(self) -> None:
        self.parts = (Part(0.5), Part(-2.0), Part(4.0))
        self.lead = 0

    def turn(self) -> int:
        self.lead = (self.lead + 1) % 3
        return self.lead

    def gain_of(self, part: Part, by: float) -> float:
        return part.gain * by

    def control(self) -> None:
        part = self.parts[self.lead]
        if self.u > 1.0 and not part.is_slow:
            self.c = part.begin(self.turn(), gain=self.u)
        self.parts[self.lead].gain += self.turn()
        self.k = part.gain + self.gain_of(self.parts[self.n % 3], self.u) + self.parts[self.turn() - 1](2.0)
        self.parts[self.n].runs = self.lead if self.yes else 3
        self.yes = part is not None and self.parts[self.lead].is_slow


@equal
class ActuatorsAtComputedPlaces(Program):
    def begin(self) -> None:
        self.outputs = (self.a, self.b)

    def control(self) -> None:
        output = self.outputs[self.n % 2]
        output.write(self.x.read() + self.n % 5)
        self.k = self.outputs[self.n % 2 - 1].pending + output.pending * 10.0
        self.outputs[self.n].write(0.0)


@equal
class RecordsAndMethodsOfATable(Program):
    def begin(self) -> None:
        self.product, self.at = "glue", 0
        self.handlers = {1: self.one, 2: self.other, 5: self.one}

    def one(self, u: float) -> float:
        self.at += 1
        return u

    def other(self, u: float) -> float:
        self.at = 0
        return u * 2.0

    def control(self) -> None:
        step, product = STEPS[self.at % 3], PRODUCTS[self.product]
        self.k = step.time + product.time * product.speed.value
        self.yes = step.is_last
        self.product = "soap" if self.u > 1.0 else "glue"
        self.k += self.handlers[self.n](self.u)


# Extremes --------------------------------------------------------------------------------------------------


@equal
class ExtremesByAKey(Program):
    def begin(self) -> None:
        self.parts = [Part(0.5), Part(-2.0), Part(0.5)]

    def cost(self, u: float) -> float:
        self.c += 1
        return abs(u - self.u)

    def control(self) -> None:
        least = min(self.parts, key=lambda part: part.runs)
        least.gain += least(self.u) * 0.1
        max(self.parts, key=lambda part: part.gain).begin(2, gain=0.0)
        self.k = min((1.0, 2.0, -0.0, 0.0), key=self.cost) + max([self.u, self.x.read()], key=abs)
        values = [each.gain for each in self.parts]
        self.c += 10 * max(range(len(values)), key=lambda i: values[i] if i != self.n else 0.0)


@equal
class ExtremesOfOrderedStates(Program):
    def begin(self) -> None:
        self.worst = Level.LOW

    def judged(self, u: float) -> Level:
        return Level.HIGH if u > 2.0 else Level.MID if u > 0.0 else Level.LOW

    def control(self) -> None:
        now = max(self.judged(self.u), self.judged(self.x.read()), Level.LOW)
        self.worst = min(max(self.worst, now), Level.HIGH)
        self.c = self.worst * 10 + now


@equal
class RecordsWithOtherFields(Program):
    def begin(self) -> None:
        self.last = Sample(0.0, 0)

    def control(self) -> None:
        self.last = self.last._replace(number=self.n % 100) if self.u > 1.0 else self.last._replace(value=self.u)
        self.k = self.last.value + self.last._replace(value=2.0).value


# Lists -----------------------------------------------------------------------------------------------------


@equal
class ListsUnderAName(Program):
    def begin(self) -> None:
        self.ring, self.flags, self.at = [0.5, -0.0, 2.0], [False] * 3, 0
        self.line = np.zeros(3)

    def shift(self) -> None:
        line = self.line
        line[1:] = line[:-1]
        line[0] = self.u

    def control(self) -> None:
        ring = self.ring
        flags = self.flags
        ring[self.at] = self.u
        for i in range(3):
            flags[i] = ring[i] > 1.0 and not flags[i - 1]
            self.k += ring[i]
        self.shift()
        self.at = (self.at + 1) % len(ring)
        ring[self.at] += self.x.read() + float(self.line[1])
        self.c = sum(self.flags) + sum(flags)


@equal
class ListsThatAreAssigned(Program):
    def begin(self) -> None:
        self.history, self.front, self.back = [0.5, -0.0, 2.0], [0.0, 1.0], [2.0, 3.0]

    def last(self) -> float:
        return self.history[-1]

    def control(self) -> None:
        before = self.history[0]
        self.history = self.history[1:] + [self.u]  # noqa: RUF005
        self.history[0] += before
        self.k = max(self.history) - self.last()
        self.front, self.back = self.back, self.front
        if self.n > 1:
            self.front = [self.k, self.x.read()]
        self.k += self.front[0] + self.back[1]


@equal
class ListsThatAreSorted(Program):
    def middle(self, values: list[float]) -> list[float]:
        found = [each * 2.0 for each in values]
        found[0] = self.u
        return found

    def control(self) -> None:
        row = [self.x.read(), self.u, 2.5, -0.0]
        for i in range(len(row)):
            for j in range(len(row) - 1 - i):
                if row[j] > row[j + 1]:
                    row[j], row[j + 1] = row[j + 1], row[j]
                    self.c += 1
        twice = self.middle(row)
        twice[self.n % 4] -= 1.0
        self.k = row[1] + max(twice) - twice[-1] + sum(row)
        counts = [0] * 3
        counts[self.n % 3] += self.c
        self.c = counts[0] + 10 * counts[1] + (3 in counts)


@equal
class ListsThatConditionsChoose(Program):
    def begin(self) -> None:
        self.row, self.counts = [0.5, -0.0, 2.0, 7.0], [3, 1, 2]

    def at_least(self, u: float) -> bool:
        self.c += 1
        return u >= self.u

    def control(self) -> None:
        self.row[self.n % 4] = self.x.read()
        good = [each * 2.0 for each in self.row if self.at_least(each)]
        few = [n for n in self.counts if n > self.n % 4 if n != 3]
        if good:
            self.k = sum(good) / len(good) + max(good) - min(good) + good[0] - good[-1]
        elif not few:
            self.c += 100
        for place, each in enumerate(good):
            self.k += each * place
        self.c += 10 * len(few) + sum(few) + (few[1] if len(few) > 1 else 0)
        self.yes = any(each > 3.0 for each in good) or all(few)
        self.k += good[self.n]


@equal
class SortedNumbers(Program):
    def begin(self) -> None:
        self.row = [0.5, -0.0, 2.0, 0.0, -7.0]

    def control(self) -> None:
        u = self.u if self.u == self.u else -1.0
        self.row[self.n % 5] = u
        ordered = sorted(self.row)
        self.k = ordered[0] * 100.0 + ordered[2] + sum(ordered[1:-1]) + sorted([self.x.read(), u, 1.0])[1]
        self.c = sorted(each + self.n % 7 for each in (3, 1, 2))[-1] + sorted((self.n % 3, 1))[0]
        self.row[:] = ordered
        sorted([self.u])


@equal
class ListsOfObjectsUnderAName(Program):
    def begin(self) -> None:
        self.rows = Rows(0.5), Rows(2.0)

    def control(self) -> None:
        for each in self.rows:
            row = each.row
            row[0] += 1.0
            if self.n > 2:
                continue
            row[1] = self.u
        self.k = row[0] + row[1]


@equal
class ListsThatLaterArgumentsChange(Program):
    def begin(self) -> None:
        self.row, self.other = [1.0, 2.0], [1.0, 2.0]

    def move(self) -> float:
        self.row[0] += 1.0
        self.other = [self.u, 1.0]
        return self.u

    def first(self, row: list[float], other: list[float], _: float) -> float:
        return 10.0 * row[0] + other[0]

    def all(self, a: float, b: float, c: float) -> float:
        return a + 10.0 * b + 100.0 * c

    def control(self) -> None:
        self.k = self.first(self.row, self.other, self.move())
        self.k += self.all(*self.row, self.move())
        self.k += [*self.row, self.move()][0]


@equal
class ElementsThatAreChosenBefore(Program):
    def control(self) -> None:
        low, high = [each for each in (1.0, 2.0, 3.0) if each != 2.0]
        for each in [one for one in (self.a, self.b) if one is not self.a]:
            each.write(low)
        self.k = high


# Arrays ----------------------------------------------------------------------------------------------------


@equal
class ArraysThatAreNotThere(Program):
    def begin(self) -> None:
        self.grid: Any = np.zeros(2)

    def control(self) -> None:
        if self.n > 3:
            self.grid = None
        elif self.n > 1:
            self.grid = np.array([self.u, 1.0])
        if self.grid is not None:
            for each in self.grid:
                self.k += each
        self.k += float(self.grid.sum())


class OfArrays(Program):
    def begin(self) -> None:
        self.row, self.counts = np.array([0.5, -1.5, 2.0]), np.array([0, 2, -3])
        self.mask, self.out = np.array([True, False, True]), np.zeros(3)

    def move(self) -> None:
        self.row[1], self.counts[0], self.mask[2] = self.u, self.n % 3, self.u > 1.0


@equal
class WholeNumbersStayWhole(OfArrays):
    def control(self) -> None:
        self.move()
        self.out = 1.0 / -np.abs(self.counts) + 2.0 / -np.sign(self.counts)
        self.c = int(np.abs(self.counts[0])) - int(np.sign(self.counts[2]))


@equal
class ExtremesOfBooleansAreBooleans(OfArrays):
    def control(self) -> None:
        self.move()
        self.c = int(np.max(self.mask)) * 2 + int(self.mask.min())
        self.yes = bool(~np.min(self.mask))
        if ~self.mask.any():
            self.c += 10
        if self.n > 1:
            self.a.write(np.max(self.mask))


@equal
class MasksThatChange(OfArrays):
    def control(self) -> None:
        self.move()
        self.row[self.mask] *= 0.5
        self.row[self.row > self.u] -= self.n * 2.0
        self.out[~self.mask] += self.n
        self.k = float(self.row.sum() - self.out[1])


@equal
class ElementsOfOtherPlaces(OfArrays):
    def reversed(self) -> float:
        row = self.row * 2.0
        row = row[::-1] - row
        row += row[::-1] * 0.5
        return float(row[0]) + float(row[2]) * 10.0

    def control(self) -> None:
        self.move()
        self.row += self.row[::-1]
        self.k = self.reversed()
        np.add(self.row[::-1], self.u, out=self.row)
        self.out[self.out[::-1] < 1.0] = 3.0
        self.out[self.row[::-1] > 2.0] -= 0.5
        self.row[self.row[::-1] > 1.0] = 0.25
        self.mask &= self.mask[::-1]


@equal
class FunctionsOfNumpyWithNumbers(OfArrays):
    def control(self) -> None:
        x = self.x.read()
        self.k = float(np.clip(self.u, -1.0, 2.0)) + float(np.sign(self.u)) + 1.0 / np.clip(x, 0, 1) + np.abs(-0.0)
        self.c = int(np.sign(self.n)) + int(np.maximum(self.n, 2) % 7) + int(np.clip(self.n, -5, 5))
        self.yes = bool(np.isfinite(self.u)) and not np.isnan(x)
        self.out[0] = np.sqrt(np.minimum(self.u, 4.0))


@equal
class MeansAndPlaces(OfArrays):
    def control(self) -> None:
        self.move()
        self.k = float(np.mean(self.row)) + float(self.counts.mean()) * self.mask.mean()
        self.c = int(np.argmin(self.row)) + 10 * int(self.row.argmax()) + 100 * int(self.counts.argmin())
        self.out[int(np.argmax(self.counts))] = self.row.mean() / self.row.min()


@equal
class ArraysThatAreJoinedAndRolled(OfArrays):
    def control(self) -> None:
        self.move()
        x = self.x.read()
        self.out = np.concatenate((self.row[1:], [x]))
        self.row = np.roll(self.row, 1)
        self.counts = np.roll(self.counts, -5)
        self.row[0] = self.u
        self.k = float(np.concatenate([self.row, self.out, np.roll(self.out, 3)]).sum())


@equal
class NumbersOfNumpyOverKnownOnes(OfArrays):
    def control(self) -> None:
        self.move()
        with np.errstate(divide="ignore", invalid="ignore"):
            self.out = 1.0 / self.row
        self.k = float(self.row[1] % 3.5) + float(self.row.sum() % -2)
        self.c = int(self.counts.sum() % 7 - self.counts[2] // 2)
        self.row = np.nan_to_num(self.out, nan=0.0)


test_it_is_what_python_does = CASES.test()

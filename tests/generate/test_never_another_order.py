"""Order, names and errors that C could take for something else: each program is equal to Python in every
period, or it is refused with its file and line. Beside it stands its nearest neighbour that translates, if any.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal

ONES = np.ones(3)


class Loud(Exception):
    def __init__(self, number: int) -> None:
        super().__init__(1 / (number - 1))


class Helper:
    def __init__(self) -> None:
        self.k = 0.0


# Order --------------------------------------------------------------------------------------------------------------


class WithNext(Program):
    def begin(self) -> None:
        self.row, self.at = [1.0, 2.0, 3.0], 0

    def next(self) -> int:
        self.at = (self.at + 1) % 3
        return self.at


@equal
class PlaceIsFoundOnce(WithNext):
    def control(self) -> None:
        self.row[self.next()] += 1.0


@equal
class PlaceIsFoundFirst(WithNext):
    def control(self) -> None:
        self.row[self.at] += self.next()


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


@equal
class TupleBeforeACall(Program):
    def begin(self) -> None:
        self.at = 0

    def bump(self) -> float:
        self.k += 1.0
        return self.k

    def sum_of(self, pair: tuple[float, float], last: float) -> float:
        return pair[0] + 10.0 * pair[1] + 100.0 * last

    def control(self) -> None:
        self.k = self.sum_of((self.k, self.u), self.bump())


@equal
class PlaceInATupleThatChanges(WithNext):
    """Python has the tuple before it computes the place."""

    def begin(self) -> None:
        super().begin()
        self.pair = (1.0, 2.0)

    def next(self) -> int:
        self.k += 1.0
        self.pair = (self.u, self.pair[0])
        return super().next() % 2

    def control(self) -> None:
        self.a.write(abs((self.k, self.u, 0.0)[self.next()]))
        self.k = (self.u, self.k)[self.next()]
        self.k += self.pair[self.next()]


@equal
class ElementsOfATupleStay(Program):
    def control(self) -> None:
        for each in (self.k, self.u, self.k):
            self.k = each + 1.0
        self.c = any(self.bumped(each) for each in (self.k, self.u))

    def bumped(self, number: float) -> bool:
        self.k += 1.0
        self.u += 1.0
        return number > 3.0


@equal
class LoopOverWhatIsChanged(WithNext):
    def control(self) -> None:
        for each in self.row:
            self.row[2] = self.u + each
            self.k = each


# Names --------------------------------------------------------------------------------------------------------------


@equal
class VariableOfAGenerator(Program):
    def control(self) -> None:
        each = self.u
        found = any(each > 1.0 for each in (self.k, 0.5)) or sum(each for each in (1.0, 2.0)) > self.u
        self.k = each + found


@equal
class FilterOfAGenerator(Program):
    def control(self) -> None:
        self.c = any(1.0 / each > 0.2 for each in (self.u, 0.0, 4.0) if each != 0.0 if each > 1.0)
        self.yes = all(1.0 / each > 0.2 for each in (self.u, 0.0, 4.0) if each != 0.0)


@equal
class NameBeforeTheLoop(Program):
    def control(self) -> None:
        last = -1
        for i in range(self.n % 4):
            last = i
        self.c = last


@equal
class UnderscoresAndWordsOfC(Program):
    def control(self) -> None:
        x, _x, x_, __x = self.u, 2.0, 3.0, 4.0
        isnan = double = m = out = fault = t1 = n1 = sqrt = umo_max = 5.0
        register, errno, NAN, INFINITY, p0 = 1, 2, 3, 4, 5
        self.k = x + 10.0 * _x + 100.0 * x_ + 1000.0 * __x + isnan + double + m + out + fault + t1 + n1 + sqrt + umo_max
        self.c = register + errno + NAN + INFINITY + p0 + int(self.n % 3)

    def sqrt(self) -> None:
        """A name of the library of C."""


@equal
class LettersBeyondAscii(Program):
    def control(self) -> None:
        grün, grön = self.u, 2.0
        self.k = grün + 10.0 * grön


def sin(number: float) -> float:
    return number + 1.0


def machine_step(number: float) -> float:
    return number + 2.0


def umo_floor(number: float) -> float:
    return number + 3.0


def init_objects(number: float) -> float:
    return number + 4.0


@equal
class FunctionsNamedAsThoseOfC(Program):
    def step(self) -> float:
        return 1.0

    def clear(self) -> float:
        return 2.0

    def control(self) -> None:
        self.k = sin(self.u) + machine_step(self.u) + umo_floor(self.u) + init_objects(self.u) + math.sin(self.x.read())
        self.k += self.step() + self.clear()


class reals_2(NamedTuple):
    step: float
    last: float


class step(NamedTuple):
    x: float


@equal
class RecordsNamedAsTypesOfC(Program):
    def begin(self) -> None:
        self.row, self.one = np.zeros(2), reals_2(1.0, 2.0)
        self.maybe_one: reals_2 | None = None

    def control(self) -> None:
        self.row[0] = self.u
        self.one = reals_2(self.u, self.one.step)
        self.k = step(self.u).x + self.one.last + float(self.row[0])


# Errors -------------------------------------------------------------------------------------------------------------


@equal
class ReturnsAndFinally(Program):
    def found(self) -> float:
        for i in range(5):
            try:
                if i == 2:
                    return self.u + i
            finally:
                self.c += 1
        return -1.0

    def control(self) -> None:
        self.k = self.found()


@equal
class ReturnsOnEveryWay(Program):
    def found(self) -> float:
        try:
            return 1.0 / self.u
        except ZeroDivisionError:
            return -1.0
        finally:
            self.c += 1

    def control(self) -> None:
        self.k = self.found()


@equal
class FaultOfTheControllerIsNotCaught(Program):
    def control(self) -> None:
        try:
            self.c = self.n + (2**31 - 8)
        except OverflowError:
            self.k = 5.0


@equal
class SeveralHandlers(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
            best = self.k
        except ZeroDivisionError:
            best = 1.0
        except TypeError:
            best = 2.0
        self.k = best + 1.0


@equal
class MessagesOfNumbers(Program):
    def control(self) -> None:
        if self.u > 1.0:
            raise ValueError(f"{self.u:.2f} V, {self.n:5d}, {self.maybe}, {self.fan.pending!r}", str(self.c))


@equal
class MessageOfACaughtError(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
        except ArithmeticError as error:
            raise ValueError(f"no quotient: {error}") from error


@equal
class TextThatOnlyTells(Program):
    def begin(self) -> None:
        self.note = ""

    def control(self) -> None:
        if self.u > 5.0:
            raise ValueError(f"after {self.note}")
        self.note = "seen"


test_it_is_what_python_does = CASES.test()

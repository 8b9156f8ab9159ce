"""Arithmetic beyond the four operations: bit operators, powers and functions of `math`. Each program is equal to Python
to the bit, also at the ends of 32 bits, at NaN, infinities and zeros of both signs, or it is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from random import Random
from typing import Any

from helpers.written_programs import GIVEN, Cases, Program

WHOLE = [0, 1, -1, 2, -2, 3, 5, 7, 31, 32, 33, -31, 46340, 46341, -46341, 2**15, 2**30, 2**31 - 1, -(2**31) + 1]
REAL = [
    0.0, -0.0, 1.0, -1.0, 0.5, 2.5, -2.5, 1.5, 0.125, 2.675, 1.005, 1e-9, 5e-324, -5e-324, 1e16, 1e300, -1e300, 1.7e308,
    4503599627370495.5, 45035996273704.957, 123456789012345.67, math.nan, math.inf, -math.inf, math.pi, 720.0,
]  # fmt: skip


def trials() -> Iterator[list[dict[str, Any]]]:
    random = Random(1)
    yield from ([each] for each in GIVEN)
    for _ in range(300):
        u, v = (
            random.choice(REAL) if random.random() < 0.3 else random.uniform(-1, 1) * 10 ** random.randint(-3, 12)
            for _ in range(2)
        )
        n, i = (random.choice(WHOLE) if random.random() < 0.7 else random.randint(-40, 40) for _ in range(2))
        yield [{"x": random.randint(-9, 9), "u": u, "v": v, "n": n, "i": i, "maybe": random.choice([None, v])}]


CASES = Cases(list(trials()), limits=0.5)
equal = CASES.is_equal


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


# Bit operators ---------------------------------------------------------------------------------------------


@equal
class QuotientsOfBools(Program):
    """Compilers warn where one is compared with the least whole number."""

    def control(self) -> None:
        self.c = int(self.maybe is None) // self.n
        self.c += (self.u > 1.0 and not self.yes) // (self.n - 1)


@equal
class Bits(Numbers):
    def control(self) -> None:
        self.c = (self.n & self.i) + (self.n & 0xFF)
        self.c ^= self.n | (self.i & ~self.n)
        self.flag = self.n & 4 != 0


@equal
class BitsOfBools(Numbers):
    """They are computed on both sides, and give bools."""

    def control(self) -> None:
        self.yes = (self.n > 1) & (self.u / self.v > 1.0)
        self.flag = (self.yes ^ (self.i > 0)) | self.flag
        self.c = (self.n & self.yes) + ~(self.n > 3) + (True | self.n)


@equal
class BoolsOrNumbers(Numbers):
    """What may be a bool or a number is a bool again where the other one may be."""

    def control(self) -> None:
        one = self.n > 3 if self.i > 0 else self.n
        self.c = (one & 3) + (one ^ self.i)


@equal
class Shifts(Numbers):
    """By less than none it is an error, beyond 31 places all is gone."""

    def control(self) -> None:
        self.c = self.n >> self.i
        self.k = float(-5 >> self.i)
        self.c += (self.n & 0xF) << 3


@equal
class ShiftsToTheLeft(Numbers):
    """Not by 2**31 places: in Python that is a number of 256 MB, unless it is zero."""

    def control(self) -> None:
        places = self.i if self.i < 2**16 or self.n == 0 else self.i >> 12
        self.c = self.n << places


@equal
class BitsInPlace(Numbers):
    def begin(self) -> None:
        super().begin()
        self.cells = [1, 2, 3]

    def control(self) -> None:
        self.cells[self.n % 3] |= self.i
        self.c <<= 1
        self.c = (self.c & 0xFFFF) ^ self.cells[1]
        self.yes ^= self.n > 0


@equal
class BitsOfNone(Numbers):
    count: int | None

    def begin(self) -> None:
        super().begin()
        self.count = None

    def control(self) -> None:
        if self.u > 0.0:
            self.count = self.n
        self.c = self.count & 1  # type: ignore[operator]


@equal
class KnownBits(Numbers):
    def control(self) -> None:
        self.c = self.n & (1 << 5 | 3 ^ 1) & ~4
        self.yes = bool(True & False)


@equal
class KnownShiftBelowZero(Numbers):
    def control(self) -> None:
        if self.n == 3:
            self.c = 4 << -1


# Powers ----------------------------------------------------------------------------------------------------


@equal
class WholePowers(Numbers):
    def control(self) -> None:
        self.c = self.i**2
        self.k = float(self.i**3 - self.i**0 + self.yes**2)


@equal
class LargePowers(Numbers):
    """-2 ** 31 fits, and nothing on the way to it is larger."""

    def control(self) -> None:
        self.c = (self.i % 5 - 2) ** 31


@equal
class RealPowers(Numbers):
    def control(self) -> None:
        self.k = self.u**2
        self.r = self.v**3 + self.u**-1


@equal
class PowersBelowZero(Numbers):
    def control(self) -> None:
        self.k = self.i**-2


@equal
class ComplexPower(Numbers):
    """A limit of the controller, also of what is known."""

    def control(self) -> None:
        self.k = self.u
        if self.i == 7:
            self.k = self.a.minimum**0.5  # type: ignore[assignment]


# Functions of math -----------------------------------------------------------------------------------------


@equal
class Angles(Numbers):
    def control(self) -> None:
        self.k = math.atan(self.u)
        self.r = math.degrees(self.u) + math.radians(self.n)
        self.s = math.asin(self.v) - math.acos(self.v)


@equal
class Logarithms(Numbers):
    def control(self) -> None:
        self.k = math.log10(self.u)
        self.r = math.log10(abs(self.n))


@equal
class Lengths(Numbers):
    def control(self) -> None:
        self.k = math.hypot(self.u, self.v)
        self.r = math.hypot(self.u, self.n, 3.0) + math.hypot(self.u) + math.hypot(self.u * 1e-300, self.v * 1e-300)


@equal
class Remainders(Numbers):
    def control(self) -> None:
        self.k = math.fmod(self.u, self.v)


@equal
class RemaindersOfZero(Numbers):
    def control(self) -> None:
        self.k = math.fmod(self.u, self.i)


@equal
class Digits(Numbers):
    def control(self) -> None:
        self.k = round(self.u, 2)
        self.r = round(self.v, 0) + round(self.u, 9)
        self.s = round(self.u, 1)
        self.c = round(self.n, 2)


@equal
class QuotientsAndRemainders(Numbers):
    def control(self) -> None:
        self.c, self.i = divmod(self.n * 7 - 20, 6)
        self.k, self.r = divmod(self.u - 3.0, 0.75)
        self.s = divmod(self.u, self.v)[1]


test_it_is_what_python_does = CASES.test()

"""The arithmetic and the statements of Python, translated: the same results to the bit, and the same errors."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from itertools import product
from random import Random
from typing import Any, NamedTuple

import pytest

from helpers.calculations import CompiledMethods
from helpers.generating import needs_a_compiler
from umo.errors import RangeError, UmoError
from umo.generate.translation import ControllerLimit

WORDS = [0.0, -0.0, 1.0, -1.0, 0.5, 1.5, 2.5, -2.5, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 3.0, 7.25]


class Colour(Enum):
    RED = "red"
    GREEN = "green"
    BLUE = "blue"


class Pair(NamedTuple):
    first: float
    second: float = 2.0


class Helper:
    """An object that is no part of the machine."""

    factor = 2.0

    def __init__(self) -> None:
        self.factor = 2.5

    def scaled(self, number: float) -> float:
        return number * self.factor


HELPER = Helper()


@dataclass
class Calculation:
    """`a`, `b`, `i`, `j` and `colour` are given; `out` is the result. It is calculated while it is `chosen`."""

    chosen: bool = False
    a: float = 0.0
    b: float = 0.0
    i: int = 0
    j: int = 0
    colour: Colour = Colour.RED
    last: float | None = None
    out: float = 0.0
    steps: int = 0
    pair: Pair = field(default_factory=lambda: Pair(0.0, 0.0))
    table: list[float] = field(default_factory=lambda: [1.0, 2.0, 4.0, 8.0])

    def clear(self) -> None:
        self.out, self.steps, self.last, self.pair = 0.0, 0, None, Pair(0.0, 0.0)
        self.table[:] = [1.0, 2.0, 4.0, 8.0]

    # What is translated --------------------------------------------------------------------------------

    def sums(self) -> None:
        self.out = self.a + self.b * self.a - (self.b - 1) * 0.1

    def sum_of_a_list(self) -> None:
        self.table[1] = self.a
        self.table[3] = self.b
        self.out = sum(self.table)

    def sum_of_a_tuple(self) -> None:
        self.out = sum((self.a, self.i, 1e16, self.b, self.j, -1e16, 0.1))

    def sum_of_expressions(self) -> None:
        self.table[0] = self.b
        self.out = sum(each * self.a for each in self.table) + sum(each > 2.0 for each in self.table)

    def extremes_of_a_list(self) -> None:
        self.table[2] = self.a
        self.out = max(self.table) - min(self.table)

    def some_and_every_element(self) -> None:
        self.table[0] = self.a
        self.steps = any(self.table) + 2 * all(self.table) + 4 * any(each > self.b for each in self.table)

    def tuple_with_a_default(self) -> None:
        self.pair = Pair(self.a)

    def matches(self) -> None:
        match self.colour:
            case Colour.RED if self.a > 0.0:
                self.steps = 1
            case Colour.RED | Colour.GREEN:
                self.steps = 2
            case _:
                self.steps = 3
        match self.i // 2:
            case 0:
                self.out = self.a
            case 1 | 2:
                self.out = self.b
        match self.last:
            case None:
                self.last = self.a

    def matches_and_returns(self) -> None:
        match self.j:
            case 0:
                self.steps = 4
                return
            case _ if self.j > 2:
                self.steps = 5
        self.out = 1.0

    def quotient(self) -> None:
        self.out = self.a / self.b + 1.0

    def quotient_of_whole_numbers(self) -> None:
        self.out = self.i / self.j

    def floor_division(self) -> None:
        self.out = self.a // self.b

    def remainder(self) -> None:
        self.out = self.a % self.b

    def powers(self) -> None:
        """Where the exponent is written down, compilers would take a product or a quotient."""
        self.out = self.a**2.0
        self.last = self.b**-1.0 + self.b**2

    def whole_floor_division(self) -> None:
        self.out = self.i // self.j

    def whole_remainder(self) -> None:
        self.out = self.i % self.j

    def whole_sums(self) -> None:
        self.steps = self.i + self.j
        self.steps = self.steps * 3 - self.j

    def rounded(self) -> None:
        self.steps = round(self.a)

    def cut(self) -> None:
        self.steps = int(self.a)

    def floored(self) -> None:
        self.steps = math.floor(self.a)
        self.steps = math.ceil(self.b)

    def extremes(self) -> None:
        self.out = max(self.a, self.b) - min(self.b, self.a, 3.0)

    def extremes_of_whole_numbers(self) -> None:
        self.steps = max(self.i, self.j, 3)

    def absolute(self) -> None:
        self.out = abs(self.a) + (0.0 if math.isnan(self.b) else math.copysign(2.0, self.b))

    def absolute_whole(self) -> None:
        self.steps = abs(self.i)

    def root(self) -> None:
        self.out = math.sqrt(self.a)

    def finite(self) -> None:
        self.out = 1.0 if math.isfinite(self.a) else 2.0 if math.isnan(self.a) else 3.0 if math.isinf(self.a) else 4.0

    def chained(self) -> None:
        self.out = 1.0 if self.b < self.a <= 3.0 < 10.0 else 0.0

    def both(self) -> None:
        if self.a > 0.0 and 1.0 / self.a > self.b:
            self.out = 1.0
        if self.a < 0.0 or 1.0 / self.a > self.b or not self.b:
            self.out += 2.0

    def truth(self) -> None:
        self.out = 1.0 if self.a else 0.0
        if not self.i:
            self.out += 2.0

    def value_of_or(self) -> None:
        self.out = self.a or self.b
        self.out += self.a and self.b

    def states(self) -> None:
        self.out = {Colour.RED: 1.0}.get(Colour.RED, 2.0) if False else 0.0
        if self.colour is Colour.GREEN:
            self.out = 1.0
        elif self.colour in (Colour.BLUE, Colour.RED) and self.colour != Colour.RED:
            self.out = 2.0

    def turns(self) -> None:
        self.colour = Colour.RED if self.colour is Colour.BLUE else Colour.BLUE

    def optional(self) -> None:
        rate = 0.0 if self.last is None else self.a - self.last
        self.last = self.a if self.b > 0.0 else None
        self.out = rate

    def optional_that_is_none(self) -> None:
        if self.b > 1.0:
            self.last = self.a
        self.out = self.last + 1.0  # type: ignore[operator]

    def tuples(self) -> None:
        first, second = self.swapped(self.a, self.b)
        self.pair = Pair(second, first=first) if False else Pair(first, second)
        self.out = self.pair.first - self.pair[1]

    def swapped(self, a: float, b: float) -> tuple[float, float]:
        if a > b:
            return b, a
        return a, b

    def counts(self) -> None:
        total = 0.0
        for number in range(self.i % 7):
            if number == 3:
                continue
            if number > 5:
                break
            total += number * self.a
        self.out = total

    def loops(self) -> None:
        n = self.i % 10
        while n > 0:
            n -= 2
            self.steps += 1
            if self.steps > 3:
                break

    def elements(self) -> None:
        for each in self.table:
            if each > self.a:
                break
            self.out += each
        self.table[1] = self.b

    def element(self) -> None:
        self.out = self.table[self.i % 9 - 4]

    def raises(self) -> None:
        if self.a > self.b:
            raise RangeError(f"{self.a} is above {self.b}")
        self.out = 1.0

    def catches(self) -> None:
        try:
            self.out = self.a / self.b
        except ZeroDivisionError:
            self.out = -1.0
        else:
            self.steps = 1

    def catches_some(self) -> None:
        try:
            self.quotient()
            self.raises()
        except UmoError:
            self.out = 5.0

    def raises_another(self) -> None:
        try:
            self.out = self.a / self.b
        except ZeroDivisionError:
            raise RangeError("no quotient") from None

    def cleans_up(self) -> None:
        done = False
        try:
            self.quotient()
            done = True
        finally:
            self.steps = 1 if done else 2

    def returns_from_try(self) -> None:
        self.out = self.found()

    def found(self) -> float:
        try:
            if self.a > 1.0:
                return self.a
            self.out = 1.0 / self.b
        finally:
            self.steps += 1
        return self.b

    def suppresses(self) -> None:
        with suppress(ZeroDivisionError, RangeError):
            self.raises()
            self.out = 1.0 / self.a

    def any_of(self) -> None:
        if any(each > self.a for each in (1.0, 2.0, self.b)) and all(each < 100.0 for each in (self.a, self.b)):
            self.out = 1.0

    def value_or_number(self) -> None:
        self.out = self.a or 3.0
        self.last = self.last or self.b or 2.5
        self.steps = self.i and 7

    def value_or_none(self) -> None:
        self.last = self.a or None
        self.out = -1.0 if self.last is None else self.last

    def factor_that_is_a_comparison(self) -> None:
        self.out = self.a * (self.b > 0.0) - (self.a > 1.0)

    def best_of(self) -> None:
        best: float | None = None
        for each in (HELPER.scaled(self.a), HELPER.factor * self.b, self.a):
            if best is None or each > best * HELPER.factor or each < -HELPER.factor:
                best = each
        self.out = best  # type: ignore[assignment]

    def walrus(self) -> None:
        if (excess := self.a - self.b) > 1.0:
            self.out = excess

    def with_default(self, gain: float = 2, *, offset: float = 0.5) -> float:
        return gain * self.a + offset

    def calls(self) -> None:
        self.out = self.with_default() + self.with_default(3, offset=self.b)

    def order(self) -> None:
        self.out = self.a + self.changes() * self.a

    def changes(self) -> float:
        self.a = self.b
        return 2.0

    @property
    def double(self) -> float:
        return 2 * self.a

    def property_of(self) -> None:
        self.out = self.double if self.double > self.b else -self.double


METHODS = [
    name for name, each in vars(Calculation).items()
    if callable(each) and not name.startswith("_")
    and name not in ("clear", "swapped", "found", "with_default", "changes")
]  # fmt: skip


def bits(value: Any) -> Any:
    """What is compared: all NaN are one."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("d", value)
    return tuple(map(bits, value)) if isinstance(value, tuple | list) else value


@pytest.fixture(scope="module")
def methods(tmp_path_factory: pytest.TempPathFactory) -> CompiledMethods:
    return CompiledMethods(Calculation, METHODS, tmp_path_factory.mktemp("c"))


BEYOND = "floored", "rounded", "cut", "whole_sums"
"""Methods whose numbers may need more than 32 bits."""


def beyond(law: Calculation) -> bool:
    numbers = law.a, law.b, float(law.i) + law.j, 3.0 * (float(law.i) + law.j), float(law.steps)
    return any(abs(each) >= 2.0**31 for each in numbers if math.isfinite(each))


def pairs(random: Random) -> Iterator[tuple[float, float]]:
    """At first each word with each other, then what comes."""
    yield from product(WORDS, WORDS)
    for _ in range(400):
        yield number(random), number(random)


def number(random: Random) -> float:
    kind = random.randrange(4)
    if kind == 0:
        return random.choice(WORDS)
    return random.uniform(-4.0, 4.0) if kind < 3 else random.uniform(-1e10, 1e10)


@needs_a_compiler
def test_a_square_is_the_power_of_the_library(methods: CompiledMethods) -> None:
    """It is not always the product, which an optimizing compiler would take in its place."""
    random = Random(2)
    odd = [x for x in (random.uniform(-10.0, 10.0) for _ in range(50_000)) if x**2.0 != x * x]
    assert odd
    with methods.chosen("powers") as (law, memory, step):
        for law.a in odd:
            law.b = 1.0
            memory.push()
            assert step() is None
            assert memory.read("out") == law.a**2.0


def whole(random: Random) -> int:
    return random.choice((0, 1, -1, 2, 7, -7, 2**31 - 1, -(2**31) + 1, random.randint(-100, 100)))


@needs_a_compiler
@pytest.mark.parametrize("name", METHODS)
def test_it_is_what_python_does(name: str, methods: CompiledMethods) -> None:
    random = Random(name)
    with methods.chosen(name) as (law, memory, step):
        for a, b in pairs(random):
            law.clear()
            law.a, law.b, law.i, law.j = a, b, whole(random), whole(random)
            law.colour = random.choice(list(Colour))
            law.last = random.choice((None, number(random)))
            memory.push()
            told = None
            try:
                getattr(law, name)()
            except (ArithmeticError, ValueError, TypeError, LookupError, UmoError) as error:
                told = type(error).__name__
            given, fault = (law.a, law.b, law.i, law.j), step()
            if fault == ControllerLimit.__name__ and name in BEYOND and beyond(law):
                continue  # Python's whole numbers have no end, those of a controller 32 bits
            assert (given, fault) == (given, told)
            if told is None:
                for field_name in memory.fields:
                    found, expected = memory.read(field_name), getattr(law, field_name)
                    expected = float(expected) if field_name == "out" else expected
                    assert (given, field_name, bits(found)) == (given, field_name, bits(expected))

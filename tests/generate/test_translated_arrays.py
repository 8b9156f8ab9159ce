"""Arrays of numpy, translated: the same numbers to the bit, and the same errors."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np
import pytest

from helpers.calculations import CompiledMethods, calculator, translated
from helpers.generating import needs_a_compiler
from umo.errors import RangeError

COUNT = 11
WORDS = [0.0, -0.0, 1.0, -1.0, 2.5, math.nan, math.inf, -math.inf, 1e308, 5e-324]
GAINS = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0])


def _zeros() -> Any:
    return np.zeros(COUNT)


@dataclass(eq=False)
class Arrays:
    """`a`, `b`, `n`, `m` and `x` are given; the others are results. It is calculated while it is `chosen`."""

    chosen: bool = False
    a: Any = field(default_factory=_zeros)
    b: Any = field(default_factory=_zeros)
    n: Any = field(default_factory=lambda: np.zeros(COUNT, np.int64))
    m: Any = field(default_factory=lambda: np.zeros(COUNT, np.bool_))
    x: float = 0.0
    out: Any = field(default_factory=lambda: np.zeros(1))
    mask: Any = field(default_factory=lambda: np.zeros(1, np.bool_))
    whole: Any = field(default_factory=lambda: np.zeros(1, np.int64))
    last: Any = None
    number: float = 0.0
    count: int = 0
    yes: bool = False

    def clear(self) -> None:
        self.out, self.mask, self.whole = np.zeros(1), np.zeros(1, np.bool_), np.zeros(1, np.int64)
        self.last, self.number, self.count, self.yes = None, 0.0, 0, False

    def arithmetic(self) -> None:
        self.out = (self.a + self.b) * self.x - self.a / 3.0 + -self.b * self.n

    def divided(self) -> None:
        self.out = self.a / self.b

    def floor_divided(self) -> None:
        self.out = self.a // self.b + np.floor_divide(self.x, self.b)

    def remainders(self) -> None:
        self.out = self.a % self.b
        self.last = np.mod(self.b, 2.5) + self.a % -self.x

    def whole_quotients(self) -> None:
        self.whole = self.n // (self.n - 2) + self.n % (3 - self.n) * 100 + self.n // 2 - 7 % self.n
        self.whole //= 2

    def powers(self) -> None:
        self.out = self.a**2 + self.b**-1 + self.a**0
        self.last = self.b**0.5 - self.a**1.0
        self.whole = self.n**3 + self.n**0 - self.n**2

    def with_constants(self) -> None:
        self.out = GAINS * self.a + GAINS[2] * self.b**2

    def whole_numbers(self) -> None:
        self.whole = self.n * 2 + 1 - -self.n

    def conditions(self) -> None:
        self.mask = (self.a < self.b) & ~self.m | (self.n == 3) ^ self.m
        self.yes = bool((self.a > 0.0).any() and not np.all(self.m))

    def where(self) -> None:
        self.out = np.where(self.m, self.a, np.where(self.a > self.b, 0, self.n))

    def extremes(self) -> None:
        self.out = np.maximum(self.a, self.b) + np.minimum(self.a, 0.5) + np.clip(self.b, -1.0, self.x)

    def extremes_of_whole_numbers(self) -> None:
        self.whole = np.maximum(self.n, 2) + np.minimum(self.n, -self.n)

    def functions(self) -> None:
        self.out = np.abs(self.a) + np.sqrt(np.abs(self.b)) + np.floor(self.a) - np.ceil(self.b) + abs(self.b)
        self.mask = np.isfinite(self.a) & np.logical_not(np.isnan(self.b))

    def repaired(self) -> None:
        self.out = np.nan_to_num(self.a / self.b)

    def reduced(self) -> None:
        self.number = float(self.a.max()) + float(np.min(self.b))
        self.count = int(self.m.sum()) + int(self.n.sum()) + int(np.count_nonzero(self.a)) + int(self.n.max())

    def summed(self) -> None:
        self.number = float(self.a.sum())

    def summed_in_part(self) -> None:
        few = np.zeros(5)
        for i in range(5):
            few[i] = self.a[i]
        self.number = float(np.sum(few))

    def elements(self) -> None:
        first, last = self.a[0], self.a[-1]
        total = 0.0
        for each in self.b:
            total += each
        for i in range(len(self.n)):
            if self.n[i] > 0:
                self.count += 1
        self.number = first - last + total
        self.yes = self.a.size == self.b.shape[0]

    def own_element(self) -> None:
        self.out = self.a * self.a[2] - self.a[0]

    def in_place(self) -> None:
        total = self.a + self.b
        total += self.x
        total *= self.b
        np.minimum(total, 100.0, out=total)
        rest = np.subtract(total, self.b, out=total)
        rest[rest > 3.0] = 3.0
        rest[0] = self.x
        self.out = rest

    def in_a_loop(self) -> None:
        found = np.full(len(self.a), self.x)
        for i in range(1, len(self.a)):
            found[i] = found[i - 1] * 0.5 + self.a[i]
        self.out = found

    def remembered(self) -> None:
        if self.last is not None:
            self.out = self.a - self.last
        self.last = self.a.copy()
        if self.x > 0.0:
            self.last = None

    def helped(self, values: Any, factor: float = 2.0) -> tuple[Any, Any]:
        return values * factor, np.zeros_like(values)

    def with_help(self) -> None:
        twice, nothing = self.helped(self.a)
        half, _ = self.helped(self.b, factor=self.x)
        self.out = twice + half + nothing

    def broadcast(self) -> None:
        one = np.ones(1) * self.x
        self.out = one + self.a
        self.mask = np.zeros(len(self.a), dtype=bool) | (one > 0.0)

    def or_a_number(self) -> None:
        offset: Any = self.x
        if self.x > 0.0:
            offset = self.b
        self.out = self.a + offset

    def converted(self) -> None:
        self.out = (self.a > 0.0).astype(float) + self.n.astype(np.float64)
        self.mask = self.a.astype(bool)

    def listed(self) -> None:
        self.out = np.array([self.x, 1.0, self.a[1], 2, self.x, 0.0, 0.0, 0.0, 0.0, 0.0, 1])

    def told(self) -> None:
        bad = ~np.isfinite(self.a)
        if bad.any():
            places = np.flatnonzero(bad)
            more = f", and {len(places) - 1} more" if len(places) > 1 else ""
            raise RangeError(f"elements {places}{more} are not finite")  # `places[0]` could fail by itself
        self.number = 1.0

    def kinds(self) -> None:
        given: Any = self.a
        self.yes = isinstance(given, np.ndarray) and not isinstance(self.x, np.ndarray) and isinstance(self.x, float)


METHODS = [
    name for name, each in vars(Arrays).items() if callable(each) and name[0] != "_" and name not in ("clear", "helped")
]


@pytest.fixture(scope="module")
def methods(tmp_path_factory: pytest.TempPathFactory) -> CompiledMethods:
    return CompiledMethods(Arrays, METHODS, tmp_path_factory.mktemp("c"))


def give(law: Arrays, number: int, random: Random) -> None:
    """At first each word with each other, then what comes."""
    law.clear()
    for name in ("a", "b"):
        share = random.choice((0.0, 0.3))
        numbers = (random.choice(WORDS) if random.random() < share else random.uniform(-4, 4) / 3 for _ in range(COUNT))
        setattr(law, name, np.array(list(numbers)))
    if number < len(WORDS):
        law.a, law.b = np.full(COUNT, WORDS[number]), np.array([*WORDS, 3.0])
    law.n = np.array([random.randint(-5, 5) for _ in range(COUNT)])
    law.m = np.array([random.random() < 0.5 for _ in range(COUNT)])
    law.x = random.choice((random.choice(WORDS), random.uniform(-4.0, 4.0)))


@needs_a_compiler
@pytest.mark.parametrize("name", METHODS)
def test_it_is_what_numpy_does(name: str, methods: CompiledMethods) -> None:
    random = Random(name)
    with methods.chosen(name) as (law, memory, step):
        for number in range(200):
            give(law, number, random)
            memory.push()
            for _ in range(2):
                told = None
                try:
                    with np.errstate(all="ignore"):
                        getattr(law, name)()
                except RangeError as error:
                    told = type(error).__name__
                assert step() == told
                assert (law, [*memory.differences()]) == (law, [])


class Refused:
    """What is refused, each with a word of the reason."""

    def parameter(self, law: Arrays) -> None:
        """may have another name"""
        self.changed(law.a)

    def changed(self, values: Any) -> None:
        values[0] = 1.0

    def kept(self, law: Arrays) -> None:
        """may have another name"""
        new = law.a + 1.0
        law.out = new
        new += 1.0

    def kept_in_a_loop(self, law: Arrays) -> None:
        """may have another name"""
        new = law.a + 1.0
        for _ in range(3):
            new += 1.0
            law.out = new

    def lengths(self, law: Arrays) -> None:
        """elements"""
        law.out = law.a + np.zeros(3)

    def truth(self, law: Arrays) -> None:
        """any\\(\\)"""
        if law.a > 0.0:  # type: ignore[truthy-bool]
            law.x = 1.0

    def unknown(self, law: Arrays) -> None:
        """cannot be translated"""
        law.out = np.sort(law.a)

    def method(self, law: Arrays) -> None:
        """any, all, sum"""
        law.number = law.a.std()

    def long_sum(self, law: Arrays) -> None:
        """at most 128"""
        law.number = np.zeros(200).sum()


@pytest.mark.parametrize("name", [name for name in vars(Refused) if name[0] != "_" and name != "changed"])
def test_what_would_not_be_the_same_is_refused(name: str) -> None:
    work = getattr(Refused(), name)
    problems = translated([calculator(Arrays, work)]).problems
    assert len(problems) == 1
    assert re.search(work.__doc__, str(problems[0])), problems

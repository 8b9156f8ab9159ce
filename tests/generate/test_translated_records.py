"""Dataclasses and NamedTuples as values: each program is equal to Python in every period."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Mode(Enum):
    OFF = 1
    ON = 2


class Pair(NamedTuple):
    first: float
    second: float

    @property
    def both(self) -> float:
        return self.first + self.second

    def times(self, by: float) -> float:
        return self.first * by


@dataclass(frozen=True)
class Limits:
    low: float
    high: float = 10.0

    @property
    def width(self) -> float:
        return self.high - self.low

    def clamp(self, x: float) -> float:
        return max(self.low, min(self.high, x))


@dataclass(frozen=True)
class Step:
    SCALE = 3.0

    mode: Mode
    count: int
    target: float = 0.5

    def next(self, by: int = 1) -> Step:
        return Step(self.mode, self.count + by, self.target)

    def turned(self) -> Step:
        return replace(self, mode=Mode.ON if self.mode is Mode.OFF else Mode.OFF)


@dataclass(frozen=True)
class Whole:
    count: int
    yes: bool


@dataclass
class Settings:
    gain: float = 2.0
    count: int = 0

    def bump(self) -> None:
        self.count += 1


NARROW, WIDE = Limits(1.0), Limits(-2.0)


@equal
class MethodsOfATuple(Program):
    def begin(self) -> None:
        self.pair = Pair(0.0, 1.0)

    def control(self) -> None:
        self.pair = Pair(self.u, self.k)
        self.k = self.pair.both + self.pair.times(2.0)


@equal
class DataclassThatIsRead(Program):
    def begin(self) -> None:
        self.limits, self.several = Limits(1.0, 5.0), [Limits(1.0), Limits(2.0)]

    def control(self) -> None:
        self.k = self.limits.clamp(self.u) + self.limits.width + sum(each.width for each in self.several)
        for each in self.several:
            self.k += each.clamp(self.u)


@equal
class DataclassThatIsAssigned(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0, 5.0)

    def control(self) -> None:
        before = self.limits
        self.limits = Limits(self.u, high=self.u + 2.0) if self.n > 1 else NARROW if self.u > 1.0 else WIDE
        self.k = self.limits.clamp(self.k) + before.width
        self.limits = replace(self.limits, high=self.u)
        self.k += self.limits.high - Limits(self.k).width


@equal
class DataclassOrNone(Program):
    limits: Limits | None

    def begin(self) -> None:
        self.limits = None

    def control(self) -> None:
        if self.limits is not None:
            self.k = self.limits.clamp(self.u) + self.limits.low
        self.limits = Limits(0.0) if self.n > 1 else None


class Both(NamedTuple):
    first: float
    second: float


@equal
class WhatIsThereInATuple(Program):
    last: float | None

    def begin(self) -> None:
        self.last, self.both, self.recent = None, Both(0.0, 0.0), (0.0, 1.0)

    def control(self) -> None:
        self.both = Both(self.u, -1.0 if self.last is None else self.last)
        self.last = self.maybe
        if self.last is not None:
            self.recent = (*self.recent[1:], self.last)
            row = [1.0, self.last]
            self.k = row[1] + self.both.second
        value = self.maybe
        if value is not None:
            self.both = Both(value, 2.0)
        self.k += self.recent[0] + self.both.first


@equal
class NoneHasNoFields(Program):
    limits: Limits | None

    def begin(self) -> None:
        self.limits = None

    def control(self) -> None:
        self.limits = Limits(0.0) if self.n > 1 else None
        try:
            self.k = self.limits.high  # type: ignore[union-attr]
        except AttributeError:
            self.c += 1
        self.k = self.limits.low  # type: ignore[union-attr]


@equal
class StatesAndSteps(Program):
    def begin(self) -> None:
        self.step = Step(Mode.OFF, 1)
        self.last = self.step

    def control(self) -> None:
        self.last = self.step
        self.step = self.step.next(self.n % 3).turned() if self.u > 1.0 else self.step.next()
        self.c = self.step.count + self.last.count
        step = self.step
        self.k = step.target * step.SCALE + replace(step, target=self.u).target
        self.yes = self.step.mode is Mode.ON


@equal
class DataclassesAreEqualByTheirFields(Program):
    def begin(self) -> None:
        self.one, self.other, self.step = Whole(1, True), Whole(1, True), Step(Mode.OFF, 1)

    def control(self) -> None:
        self.one = Whole(self.n % 2, self.u > 1.0)
        self.yes = self.one == self.other
        self.other, self.step = Whole(1, True) if self.n > 1 else self.one, Step(Mode.OFF, 2)
        self.c = int(self.one != self.other) + 2 * int(self.one == Whole(1, False)) + (4 if self.one else 0)
        self.c += 8 * int(self.one == self.step) + 16 * int(self.one == (1, True))  # type: ignore[comparison-overlap]


@equal
class DataclassesAsArguments(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def clamped(self, limits: Limits, x: float) -> float:
        return limits.clamp(x)

    def around(self) -> Limits:
        return Limits(self.u, self.u + 1.0)

    def control(self) -> None:
        self.k = (
            self.clamped(self.limits, self.u) + self.clamped(Limits(0.0), self.u) + self.clamped(self.around(), 1.0)
        )


@equal
class SettingsThatTwoShare(Program):
    """A dataclass that is not frozen is an object."""

    def begin(self) -> None:
        self.settings, self.several = Settings(), [Settings(), Settings(1.0)]
        self.other = self.settings

    def control(self) -> None:
        self.settings.bump()
        self.other.gain = self.u
        self.k, self.c = self.settings.gain, self.other.count
        for each in self.several:
            each.bump()
            self.k += each.gain


SCHEDULE = (Pair(20.0, 4.0), Pair(60.0, 2.0), Pair(900.0, 0.8))


@equal
class KnownNamedTuples(Program):
    LIMITS = Pair(1.0, 2.0)

    def control(self) -> None:
        for number, each in enumerate(SCHEDULE):
            if self.u * 10.0 < each.first:
                self.k = number + each.second
                break
        self.k += SCHEDULE[-1].second + self.LIMITS.first + SCHEDULE[0].both + self.LIMITS.times(self.u)


class Filter:
    """An object that is called."""

    def __init__(self) -> None:
        self.value = 0.0

    def __call__(self, new: float, share: float = 0.5) -> float:
        self.value += share * (new - self.value)
        return self.value


@equal
class CalledObjects(Program):
    def begin(self) -> None:
        self.filter, self.mode = Filter(), Mode.ON

    def control(self) -> None:
        self.k = self.filter(self.u) + self.filter(self.k, share=0.25)


@equal
class StatesOfValues(Program):
    def begin(self) -> None:
        self.mode = Mode.ON

    def control(self) -> None:
        self.mode = Mode(1 + self.n % 2)
        self.k = 1.0 if Mode(self.mode) is Mode.ON else 0.0
        self.c = Mode(self.n).value


@equal
class StatesOfValuesThatAreCaught(Program):
    def begin(self) -> None:
        self.mode = Mode.ON

    def control(self) -> None:
        try:
            self.mode = Mode(self.n)
        except ValueError:
            self.mode = Mode.OFF


test_it_is_what_python_does = CASES.test()

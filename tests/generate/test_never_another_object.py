"""Objects, and several names for one, that C could take for something else: each program is equal to Python in every
period, or it is refused with its file and line. Beside it stands its nearest neighbour that translates, if any.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Pair(NamedTuple):
    first: float
    second: float


class Whole(NamedTuple):
    first: int
    second: int


def other_pair() -> Any:
    class Pair(NamedTuple):
        second: float
        first: float

    return Pair


class Counted(NamedTuple):
    count: int

    def __eq__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


OTHER = other_pair()
ROW = [1.0, 2.0]


class Helper:
    made = 0
    shared = [1.0, 2.0]

    def __init__(self) -> None:
        self.k = 0.0
        self._hidden = 1.0

    @property
    def doubled(self) -> float:
        return 2.0 * self.k

    @doubled.setter
    def doubled(self, value: float) -> None:
        self.k = value / 2.0

    @cached_property
    def once(self) -> float:
        return self.k + 1.0


class Guarded:
    def __init__(self) -> None:
        self.k = 0.0

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, 7.0)


class Descriptor:
    def __get__(self, owner: Any, kind: Any = None) -> float:
        return 3.0 if owner is None else 2.0 * owner.u

    def __set__(self, owner: Any, value: float) -> None:
        owner.u = value + 1.0


class Looked:
    """Every attribute is another one when it is read."""

    def __init__(self) -> None:
        self.k = 1.0

    def __getattribute__(self, name: str) -> Any:
        found = object.__getattribute__(self, name)
        return found + 1.0 if name == "k" else found


class Compared:
    def __init__(self, number: float) -> None:
        self.number = number

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Compared) and other.number == self.number

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        return self.number > 1.0


class Sized:
    def __init__(self) -> None:
        self.size = 1

    def __len__(self) -> int:
        return self.size


class Sevens(list[float]):
    def __getitem__(self, place: Any) -> Any:
        return 7.0


@dataclass(frozen=True)
class Frozen:
    k: float = 1.0


def doubles(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def wrapper(self: Any, number: float) -> float:
        return 2.0 * float(function(self, number))

    return wrapper


# Objects ------------------------------------------------------------------------------------------------------------


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


@equal
class SetterOfAProperty(WithHelper):
    def control(self) -> None:
        self.helper.doubled = self.u
        self.helper.doubled = self.helper.doubled + 1.0
        self.k = self.helper.doubled + self.helper.k


@equal
class CounterOfAnObject(WithHelper):
    def control(self) -> None:
        self.helper.made += 1
        self.c = self.helper.made


@equal
class DecoratedFunction(Program):
    @doubles
    def scaled(self, number: float) -> float:
        return number + 1.0

    def control(self) -> None:
        self.k = self.scaled(self.u)


@equal
class TwoRecordsOfOneName(Program):
    def control(self) -> None:
        one, other = Pair(self.u, 2.0), OTHER(3.0, self.u)
        self.k = one.first + 10.0 * other.second
        self.c = int(other.second)


@equal
class RecordsOfWholeNumbers(Program):
    def begin(self) -> None:
        self.pair = Whole(1, 2)

    def control(self) -> None:
        self.pair = Whole(self.n, self.pair.first)
        self.c = self.pair.second


# Several names for one thing ----------------------------------------------------------------------------------------


@equal
class RowsOfAnArray(Program):
    def begin(self) -> None:
        self.one, self.two = np.zeros((2, 3))

    def control(self) -> None:
        self.one[1] = self.u
        self.k = float(self.one[1] + self.two[1])


@equal
class ObjectAtTwoPlaces(Program):
    def begin(self) -> None:
        self.p = Helper()
        self.q = self.p

    def control(self) -> None:
        self.p.k += self.u
        self.k = self.q.k


@equal
class ListInATupleThatIsRead(Program):
    def begin(self) -> None:
        self.both = ([1, 2], 3.0)

    def control(self) -> None:
        self.c = self.both[0][0]


@equal
class ArrayThatIsNew(Program):
    """Nobody else has it: it is changed in place after it was assigned to an attribute."""

    def begin(self) -> None:
        self.row, self.reals = np.zeros(3, dtype=np.int64), np.ones(3)

    def control(self) -> None:
        self.row = self.row * 2 + 1
        self.row //= 3
        self.reals = self.reals % 2.5 + self.u
        self.reals[1:] //= 2.0
        found = (row := np.array([self.u, 2.0]))
        row += 1.0
        self.k = float(found[0])


test_it_is_what_python_does = CASES.test()

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
import pytest

from helpers.generating import needs_a_compiler
from helpers.side_by_side import Played
from helpers.written_programs import Cases, Program, check_equal, check_refused

CASES = Cases()
equal, refused = CASES.is_equal, CASES.is_refused


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


@refused("computed once")
class CachedProperty(WithHelper):
    def control(self) -> None:
        self.helper.k = self.u
        self.k = self.helper.once


@refused("an attribute of the class Helper is assigned")
class CounterOfAClass(WithHelper):
    def control(self) -> None:
        Helper.made += 1
        self.c = self.helper.made


@equal
class CounterOfAnObject(WithHelper):
    def control(self) -> None:
        self.helper.made += 1
        self.c = self.helper.made


@refused("__setattr__")
class SetattrOfItsOwn(Program):
    def begin(self) -> None:
        self.guarded = Guarded()

    def control(self) -> None:
        self.guarded.k = self.u


@refused("__setattr__, or is frozen")
class FrozenDataclass(Program):
    def begin(self) -> None:
        self.frozen = Frozen()

    def control(self) -> None:
        self.frozen.k = self.u  # type: ignore[misc]


@refused("a descriptor of its own")
class DescriptorThatIsRead(Program):
    level = Descriptor()

    def control(self) -> None:
        self.k = self.level


@refused("a descriptor of its own")
class DescriptorThatIsSet(Program):
    level = Descriptor()

    def control(self) -> None:
        self.level = 2.0


@refused("__getattribute__")
class GetattributeOfItsOwn(Program):
    def begin(self) -> None:
        self.looked = Looked()

    def control(self) -> None:
        self.k = self.looked.k


@refused("a function that an object has as an attribute")
class FunctionAsAttribute(Program):
    def begin(self) -> None:
        self.curve = lambda number: number * 2.0

    def control(self) -> None:
        self.k = self.curve(self.u)


@equal
class DecoratedFunction(Program):
    @doubles
    def scaled(self, number: float) -> float:
        return number + 1.0

    def control(self) -> None:
        self.k = self.scaled(self.u)


@refused("")
class CachedFunction(Program):
    @functools.lru_cache  # noqa: B019
    def scaled(self, number: float) -> float:
        return number + self.k

    def control(self) -> None:
        self.k = self.scaled(1.0)


@refused("whose class decides what is equal")
class ObjectsThatAreCompared(Program):
    def begin(self) -> None:
        self.one, self.other = Compared(1.0), Compared(1.0)

    def control(self) -> None:
        self.one.number = self.u
        self.c = int(self.one == self.other)


@refused("decides whether it is true")
class ObjectWithTruth(Program):
    def begin(self) -> None:
        self.one = Compared(1.0)

    def control(self) -> None:
        self.one.number = self.u
        self.c = 1 if self.one else 2


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


@refused("")
class RecordWithItsOwnEqual(Program):
    def control(self) -> None:
        one, other = Counted(self.n), Counted(1)
        self.c = int(one == other)


@refused("a tuple is compared with something else")
class ListThatIsNoTuple(Program):
    def control(self) -> None:
        self.c = int([self.n, 1] == (self.n, 1))


@refused("what decides what its elements are")
class SizeOfAnObject(Program):
    def begin(self) -> None:
        self.sized = Sized()

    def control(self) -> None:
        self.sized.size = self.n % 3
        self.c = len(self.sized)


@refused("")
class ListOfItsOwnClass(Program):
    def begin(self) -> None:
        self.row = Sevens([1.0, 2.0])

    def control(self) -> None:
        self.row[0] = self.u
        self.k = self.row[0] * 1.0


# Several names for one thing ----------------------------------------------------------------------------------------


@refused("may have another name")
class OneListAtTwoPlaces(Program):
    def begin(self) -> None:
        self.one = [0.0, 0.0]
        self.two = self.one

    def control(self) -> None:
        self.one[0] = self.u
        self.k = self.two[0]


@refused("may have another name")
class OneListOfAClass(Program):
    def begin(self) -> None:
        self.p, self.q = Helper(), Helper()

    def control(self) -> None:
        self.p.shared[0] = self.u
        self.k = self.q.shared[0]


@refused("may have another name")
class ViewOfAnArray(Program):
    def begin(self) -> None:
        self.row = np.zeros(4)
        self.head = self.row[:2]

    def control(self) -> None:
        self.row[1] = self.u
        self.k = float(self.head[1])


@equal
class RowsOfAnArray(Program):
    def begin(self) -> None:
        self.one, self.two = np.zeros((2, 3))

    def control(self) -> None:
        self.one[1] = self.u
        self.k = float(self.one[1] + self.two[1])


@refused("changes an array that it has under another name")
class ArgumentThatIsChanged(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def bump(self) -> None:
        self.row[0] += 1.0

    def first(self, row: list[float]) -> float:
        self.bump()
        return row[0]

    def control(self) -> None:
        self.k = self.first(self.row)


@equal
class ObjectAtTwoPlaces(Program):
    def begin(self) -> None:
        self.p = Helper()
        self.q = self.p

    def control(self) -> None:
        self.p.k += self.u
        self.k = self.q.k


@refused("is changed")
class ConstantArrayIsChanged(Program):
    def begin(self) -> None:
        self.GAINS = np.ones(3)

    def control(self) -> None:
        self.GAINS += self.u
        self.k = float(self.GAINS[0])


@refused("may have another name")
class ListOfAModule(Program):
    def begin(self) -> None:
        self.row = ROW

    def control(self) -> None:
        self.row[0] = self.u
        self.k = ROW[0] * 1.0


@refused("may have another name")
class ArrayInAList(Program):
    def begin(self) -> None:
        self.one, self.other = np.zeros(2), np.ones(2)
        self.both = [self.one, self.other]

    def control(self) -> None:
        self.one[0] = self.u
        for each in self.both:
            self.k += float(each[0])


@refused("may have another name")
class ListInATuple(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]
        self.both = (self.row, 2.0)

    def control(self) -> None:
        self.row[0] = self.u
        self.k = self.both[0][0] * 1.0


@refused("may have another name")
class ListThatIsReturned(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def found(self) -> list[float]:
        return self.row

    def control(self) -> None:
        self.found()[0] = self.u
        self.k = self.row[0] * 1.0


@equal
class ListInATupleThatIsRead(Program):
    def begin(self) -> None:
        self.both = ([1, 2], 3.0)

    def control(self) -> None:
        self.c = self.both[0][0]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[Any, Played]:
    return CASES.played(tmp_path_factory.mktemp("c"))


@needs_a_compiler
@pytest.mark.parametrize("kind", CASES.equal)
def test_it_is_what_python_does(kind: Any, results: dict[Any, Played]) -> None:
    check_equal(results[kind])


@needs_a_compiler
@pytest.mark.parametrize("kind", CASES.refused)
def test_it_is_refused_with_its_line(kind: Any, results: dict[Any, Played]) -> None:
    check_refused(results[kind], CASES.refused[kind], __file__)

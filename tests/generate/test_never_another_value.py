"""Numbers, lists, None and states that C could take for something else: each program is equal to Python in every
period, or it is refused with its file and line. Beside it stands its nearest neighbour that translates, if any.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum
from typing import Any, NamedTuple

import numpy as np
import pytest

from helpers.generating import needs_a_compiler
from helpers.side_by_side import Played
from helpers.written_programs import Cases, Program, check_equal, check_refused
from umo.states import OnOff, PassFail

CASES = Cases()
equal, refused = CASES.is_equal, CASES.is_refused


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"


class ToDefault(Enum):
    UP = "up"
    DOWN = "down"

    def turned(self) -> ToDefault:
        return ToDefault.DOWN if self is ToDefault.UP else ToDefault.UP


class Level(IntEnum):
    NONE = 0
    SOME = 1


class Odd(Enum):
    """Its members are equal to each other."""

    ONE = 1
    TWO = 2

    def __eq__(self, other: object) -> bool:
        return True

    def __hash__(self) -> int:
        return 0

    def __bool__(self) -> bool:
        return self is Odd.TWO


class Numbers(NamedTuple):
    first: int
    second: int


class Pair(NamedTuple):
    first: float
    second: float


# Numbers, lists and arrays ------------------------------------------------------------------------------------------


@refused("a real number where a whole number was before")
class RealInAListOfWholeNumbers(Program):
    def begin(self) -> None:
        self.row = [1, 2, 3]

    def control(self) -> None:
        self.row[1] = self.u  # type: ignore[call-overload]
        self.a.write(self.row[1])


@equal
class RealInAListOfReals(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0, 3.0]

    def control(self) -> None:
        self.row[1] = self.u
        self.row[2] = self.n
        self.k = self.row[1] + self.row[2]


@refused("a whole number where a bool was before")
class WholeNumberInAListOfBools(Program):
    def begin(self) -> None:
        self.marks = [True, False]

    def control(self) -> None:
        self.marks[0] = self.n  # type: ignore[call-overload]
        self.c = self.marks[0] + 1


@equal
class BoolsInLists(Program):
    def begin(self) -> None:
        self.marks, self.counts = [True, False], [0, 0]

    def control(self) -> None:
        self.marks[1] = self.u > 1.0
        self.counts[0] = int(self.u > 2.0)
        self.counts[1] += self.marks[1]
        self.c = sum(self.marks) + self.counts[0] + -self.marks[0]


@refused("")
class BoolsAndNumbersInAList(Program):
    def begin(self) -> None:
        self.row = [True, 2]

    def control(self) -> None:
        self.row[0] = self.n
        self.a.write(self.row[0])


@refused("a whole number at one time and a float at another")
class NegativeOfWholeOrReal(Program):
    def control(self) -> None:
        self.k = -max(0, self.u)


@equal
class NegativeOfReal(Program):
    def control(self) -> None:
        self.k = -max(0.0, self.u)


@refused("a whole number at one time and a float at another")
class ProductOfWholeOrReal(Program):
    def control(self) -> None:
        best = 0
        if self.u > 1.0:
            best = self.u
        self.k = best * self.n


@refused("a whole number where a tuple has a real one")
class WholeNumberInATuple(Program):
    def begin(self) -> None:
        self.pair = Pair(0.0, 0.0)

    def control(self) -> None:
        self.pair = Pair(self.n, self.u)
        self.k = -self.pair.first


@refused("")
class SmallIntegers(Program):
    def begin(self) -> None:
        self.row = np.zeros(3, np.int8)

    def control(self) -> None:
        self.row = self.row + 100
        self.k = float(self.row[0])


@refused("")
class SmallReals(Program):
    def begin(self) -> None:
        self.row = np.zeros(3, np.float32)

    def control(self) -> None:
        self.row = self.row + 0.1
        self.k = float(self.row[0])


@refused("does not fit 32 bits")
class LargeNumber(Program):
    def begin(self) -> None:
        self.large = 10**12

    def control(self) -> None:
        self.k = self.large * 1.0


@refused("does not fit 32 bits")
class LargeNumberInAList(Program):
    def begin(self) -> None:
        self.row = [1, 2**40]

    def control(self) -> None:
        self.k = self.row[1] * 1.0


@refused("the class of a value")
class ClassOfANumberThatBecomesReal(Program):
    def begin(self) -> None:
        self.v = 0

    def control(self) -> None:
        self.k = 1.0 if isinstance(self.v, float) else 2.0
        self.v = self.v + 0.5  # type: ignore[assignment]


@equal
class ClassOfANumber(Program):
    def control(self) -> None:
        self.k = 1.0 if isinstance(self.u, float) and isinstance(self.n, (int, float)) else 2.0


@refused("of which one is of numpy")
class BoolsOfNumpyAreAdded(Program):
    def begin(self) -> None:
        self.marks = np.array([True, True])

    def control(self) -> None:
        self.c = int(self.marks[0] + self.marks[1])


@equal
class NumbersOfNumpy(Program):
    def begin(self) -> None:
        self.row = np.zeros(2)
        self.rate = np.float64(2.0)

    def control(self) -> None:
        self.row[0] = self.u
        self.k = float(abs(self.row[0]) / max(self.row[1], -self.row[0]) + self.row[0] / self.row[1])


@refused("of which one is of numpy")
class ComparisonsOfNumpyAreAdded(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0])

    def control(self) -> None:
        within = 0.0 < self.row[0] < self.u
        self.c = int(within + within)


@refused("a number of numpy in a list")
class NumberOfNumpyInAList(Program):
    def begin(self) -> None:
        self.row, self.array = [1.0, 2.0], np.ones(2)

    def control(self) -> None:
        self.row[0] = self.array[0]
        self.k = float(self.row[0] / 0.0)


@refused("float(...)")
class NumberOfNumpyInATuple(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        pair = Pair(self.array[0], self.u)
        self.k = float(pair.first / 0.0)


@refused("float(...)")
class SumOfNumbersOfNumpy(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        self.k = float(sum(self.array) // 0.0)


@refused("float(...)")
class NumberOfElements(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        self.c = int(np.count_nonzero(self.array) // (self.c * 0))


# Ends of numbers ----------------------------------------------------------------------------------------------------


@equal
class RangeToTheEnd(Program):
    def control(self) -> None:
        for i in range(2**31 - 8, 2**31 - 1, 5):
            self.c = i
        for i in range(-(2**31) + 8, -(2**31) + 2, -5):
            self.k += i * 1.0


@refused("a real number where a whole number was before")
class RangeOfReals(Program):
    def control(self) -> None:
        for _ in range(self.u):  # type: ignore[call-overload]
            self.c += 1


@equal
class LogarithmOfNan(Program):
    def control(self) -> None:
        self.k = 1.0 if math.isnan(math.log(self.u)) else 2.0


@equal
class PowersOfZero(Program):
    def control(self) -> None:
        self.k = 0.0**self.u


@equal
class AbsoluteOfABool(Program):
    def control(self) -> None:
        self.c = abs(self.u > 1.0) + 1


# None and states ----------------------------------------------------------------------------------------------------


class WithState(Program):
    side: Side | None

    def begin(self) -> None:
        self.side = None

    def turn(self) -> None:
        self.side = None if self.u < 1.0 else Side.LEFT if self.n > 1 else Side.RIGHT


@equal
class StateThatIsNot(WithState):
    def control(self) -> None:
        self.turn()
        self.c = (self.side is not Side.LEFT) + 2 * (self.side is Side.LEFT) + 4 * (self.side is not None)


@equal
class StateThatEquals(WithState):
    def control(self) -> None:
        self.turn()
        self.c = (self.side == Side.LEFT) + 2 * (self.side != Side.LEFT) + 4 * (self.side == None)  # noqa: E711


@equal
class StateAmong(WithState):
    def control(self) -> None:
        self.turn()
        self.c = (self.side in (Side.LEFT, None)) + 2 * (self.side not in (Side.LEFT,))
        match self.side:
            case Side.LEFT:
                self.c += 4
            case None:
                self.c += 8


@equal
class NumberThatIsNotNone(Program):
    def control(self) -> None:
        if self.maybe != None:  # noqa: E711
            self.k = self.maybe * 2.0  # type: ignore[operator]
        self.c = (self.maybe == 1.5) + 2 * (self.maybe != 3.0) + 4 * (self.maybe != self.u)


@equal
class NumberAmongNone(Program):
    def control(self) -> None:
        self.c = (self.maybe in (None, 1.5)) + 2 * (self.maybe not in (3.0, -1.0))


@refused("a NaN that is the same object")
class NanAmong(Program):
    def control(self) -> None:
        self.c = int(self.u in (self.u, 1.0))


@equal
class NoneAfterContinue(Program):
    def control(self) -> None:
        for limit in (1.0, 2.0, 3.0):
            if self.maybe is None:
                continue
            self.k += limit
        self.k = self.k + self.maybe  # type: ignore[operator]


@equal
class NoneAfterAnAssignment(Program):
    last: float | None

    def begin(self) -> None:
        self.last = 1.0

    def control(self) -> None:
        self.last = self.maybe
        self.k = self.last + 1.0  # type: ignore[operator]


@equal
class NoneAfterACall(Program):
    last: float | None

    def begin(self) -> None:
        self.last = 1.0

    def clear(self) -> bool:
        self.last = None
        return True

    def control(self) -> None:
        self.last = 1.0
        if self.last is not None and self.n > 1 and self.clear():
            self.k = self.last + 1.0


@equal
class NoneOfAnother(Program):
    last: float | None

    def begin(self) -> None:
        self.last = 1.0
        self.me = self

    def control(self) -> None:
        self.last = 2.0
        if self.u > 1.0:
            self.me.last = None
        self.k = self.last + 1.0


@equal
class NoneInAHandler(Program):
    def control(self) -> None:
        try:
            self.k = self.maybe / self.u  # type: ignore[operator]
        except TypeError:
            self.k = self.maybe + 1.0  # type: ignore[operator]


@equal
class NumberOrNone(Program):
    last: float | None

    def begin(self) -> None:
        self.last = None

    def control(self) -> None:
        self.last = (self.n > 1 and 2.0) or None
        self.k = (self.u > 1.0 and 3.0) * 1.0


@equal
class NoneIsWritten(Program):
    def control(self) -> None:
        self.a.write(self.maybe)  # type: ignore[arg-type]


@refused("is not a number or a state")
class StateWithItsOwnEqual(Program):
    def begin(self) -> None:
        self.odd = Odd.ONE

    def control(self) -> None:
        self.odd = Odd.TWO if self.u > 1.0 else Odd.ONE
        self.c = int(self.odd == Odd.ONE)


@refused("whether it is true")
class TruthOfAState(Program):
    def begin(self) -> None:
        self.state = OnOff.ON

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.c = 1 if self.state else 2


@equal
class TruthOfALevel(Program):
    def begin(self) -> None:
        self.level = Level.NONE

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.NONE
        self.c = 1 if self.level else 2


@equal
class MethodOfAState(Program):
    def begin(self) -> None:
        self.way = ToDefault.UP

    def control(self) -> None:
        self.way = self.way.turned()


@equal
class LevelThatIsANumber(Program):
    def begin(self) -> None:
        self.level = Level.NONE

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.NONE
        self.c = int(self.level == 1)


@refused("a comparison with another type, which Python refuses")
class StateAndStateOfAnotherType(Program):
    def begin(self) -> None:
        self.state, self.other = OnOff.ON, PassFail.PASS

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.other = PassFail.PASS if self.u > 2.0 else PassFail.FAIL
        self.c = int(self.state == self.other)


@refused("a comparison with another type, which Python refuses")
class StateAndNumber(Program):
    def begin(self) -> None:
        self.state = OnOff.ON

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.c = int(self.state != 1)


@refused("a comparison with another type, which Python refuses")
class StateAmongTexts(Program):
    def begin(self) -> None:
        self.state = OnOff.ON

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.c = int(self.state in ("on", "off"))


@refused("a comparison with another type, which Python refuses")
class ObjectAndNumber(Program):
    def control(self) -> None:
        self.c = int(self.a == 1)  # type: ignore[comparison-overlap]


@equal
class StatesOfOneType(Program):
    def begin(self) -> None:
        self.state, self.last = OnOff.ON, None

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.c = (self.state == OnOff.ON) + 2 * (self.state in (OnOff.OFF, None)) + 4 * (self.state is PassFail.PASS)


@equal
class StatesInTuples(Program):
    def begin(self) -> None:
        self.one, self.other = (Side.LEFT, 1.0), (ToDefault.UP, 2.0)

    def control(self) -> None:
        self.one = (Side.RIGHT, self.u)
        self.other = (ToDefault.UP, self.u)
        self.c = (self.one[0] is Side.RIGHT) + 2 * (self.other[0] is ToDefault.UP)


# A bool is no number for an object ----------------------------------------------------------------------------------


@refused("it may be a bool")
class BoolThenNumber(Program):
    def control(self) -> None:
        k: float = True
        if self.u > 1.0:
            k = 2.0
        self.a.write(k)


@refused("it may be a bool")
class FieldThatIsABoolThenANumber(Program):
    def control(self) -> None:
        self.c = self.u > 1.0
        self.a.write(self.c)


@refused("it may be a bool")
class OneOrTrue(Program):
    def control(self) -> None:
        self.a.write(1 if self.u > 1.0 else True)


@refused("it may be a bool")
class NumberOrFalse(Program):
    def control(self) -> None:
        self.a.write(self.u or False)


@refused("it may be a bool")
class ExtremeOfABoolAndANumber(Program):
    def control(self) -> None:
        self.a.write(max(True, self.u))


@equal
class ExtremeOfBools(Program):
    def control(self) -> None:
        self.a.write(min(self.u > 1.0, self.n > 1))


@refused("it may be a bool")
class ResultThatIsABoolOrANumber(Program):
    def given(self) -> float:
        if self.u > 1.0:
            return 2.0
        return True

    def control(self) -> None:
        self.a.write(self.given())


@refused("a bool in a list of numbers")
class BoolInAListOfNumbers(Program):
    def begin(self) -> None:
        self.counts = [0, 0]

    def control(self) -> None:
        self.counts[0] = self.u > 2.0
        self.a.write(self.counts[0])


@refused("a bool where a tuple has a whole number")
class BoolInATuple(Program):
    def begin(self) -> None:
        self.two = Numbers(0, 1)

    def control(self) -> None:
        self.two = Numbers(self.u > 2.0, 1)
        self.a.write(self.two[0])


@equal
class BoolAsANumber(Program):
    """Each is refused when it is written, in C too."""

    def sets(self, value: float) -> None:
        self.a.write(value)

    def sets_some(self, value: float | None = None) -> None:
        self.a.write(value)  # type: ignore[arg-type]

    def gives(self) -> float:
        return self.u > 1.0

    def control(self) -> None:
        if self.n == 1:
            self.sets(self.u > 1.0)
        elif self.n == 2:
            self.sets_some(self.u > 1.0)
        elif self.n == 4:
            self.a.write(self.gives())
        elif self.n == 0:
            self.a.write(self.u > 1.0 if self.u < 5.0 else None)  # type: ignore[arg-type]
        else:
            self.sets(True)


@equal
class BoolThatIsCounted(Program):
    def control(self) -> None:
        self.a.write((self.u > 1.0) + 1)
        self.b.write(int(self.n > 1) if self.u > 2.0 else +(self.u > 1.0))


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

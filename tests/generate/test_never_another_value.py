"""Numbers, lists, None and states that C could take for something else: each program is equal to Python in every
period, or it is refused with its file and line. Beside it stands its nearest neighbour that translates, if any.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np

from helpers.written_programs import Cases, Program
from umo.states import OnOff, PassFail

CASES = Cases()
equal = CASES.is_equal


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


@equal
class WholeFromZero(Program):
    """GCC 12 takes it for a negation."""

    def control(self) -> None:
        self.k = 0.0 - self.n
        self.a.write(0.0 - (self.n * 1.0))


@equal
class RealInAListOfReals(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0, 3.0]

    def control(self) -> None:
        self.row[1] = self.u
        self.row[2] = float(self.n)
        self.k = -self.row[1] + -self.row[2]


@equal
class LengthOfATuple(Program):
    def begin(self) -> None:
        self.before = (0.0, 0.0)

    def control(self) -> None:
        self.before = (self.u, self.before[0])
        self.k = sum(self.before) / len(self.before)


def added(one: float, out: float = 0.0) -> float:
    return one + out


@equal
class ArgumentNamedAsOneOfNumpy(Program):
    def control(self) -> None:
        self.k = added(self.u, out=2.0)


@equal
class BoolsInLists(Program):
    def begin(self) -> None:
        self.marks, self.counts = [True, False], [0, 0]

    def control(self) -> None:
        self.marks[1] = self.u > 1.0
        self.counts[0] = int(self.u > 2.0)
        self.counts[1] += self.marks[1]
        self.c = sum(self.marks) + self.counts[0] + -self.marks[0]


@equal
class NegativeOfReal(Program):
    def control(self) -> None:
        self.k = -max(0.0, self.u)


@equal
class ClassOfANumber(Program):
    def control(self) -> None:
        self.k = 1.0 if isinstance(self.u, float) and isinstance(self.n, (int, float)) else 2.0


@equal
class NumbersOfNumpy(Program):
    def begin(self) -> None:
        self.row = np.zeros(2)
        self.rate = np.float64(2.0)

    def control(self) -> None:
        self.row[0] = self.u
        self.k = float(abs(self.row[0]) / max(self.row[1], -self.row[0]) + self.row[0] / self.row[1])


# Ends of numbers ----------------------------------------------------------------------------------------------------


@equal
class RangeToTheEnd(Program):
    def control(self) -> None:
        for i in range(2**31 - 8, 2**31 - 1, 5):
            self.c = i
        for i in range(-(2**31) + 8, -(2**31) + 2, -5):
            self.k += i * 1.0


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


@equal
class ExtremeOfBools(Program):
    def control(self) -> None:
        self.a.write(min(self.u > 1.0, self.n > 1))


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


test_it_is_what_python_does = CASES.test()

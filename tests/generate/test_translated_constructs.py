"""Constructs of Python beside arithmetic: each program is equal to Python in every period, or it is refused."""

from __future__ import annotations

import math
from enum import Enum, IntEnum
from typing import Any, NamedTuple

from helpers.generating import needs_a_compiler
from helpers.side_by_side import Played
from helpers.written_programs import Cases, Program
from umo import Vector

CASES = Cases()
equal = CASES.is_equal


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"

    @property
    def sign(self) -> float:
        return -1.0 if self is Side.LEFT else 1.0

    def turned(self, yes: bool = True) -> Side:
        return (Side.LEFT if self is Side.RIGHT else Side.RIGHT) if yes else self


class Level(IntEnum):
    NONE = 0
    SOME = 5
    MORE = 2

    def above(self, other: int) -> bool:
        return self.value > other


class Falling(IntEnum):
    ONE = 1
    TWO = 2

    def __lt__(self, other: int) -> bool:
        return int(self) > int(other)


GAINS = (0.5, -1.0, 4.0)
COUNTS = [3, 1, 2]
MIXED = (1, 2.5)
ROUTES = ((1.0, 2), (3.0, -4), (-0.0, 7))
SIDES = (Side.LEFT, Side.RIGHT, Side.LEFT)
SPEEDS = {Side.LEFT: -2.0, Side.RIGHT: 3.0}
STEPS = {0: 5, 2: 7, -3: 1}
RATES = {"idle": 0.5, "heat": -0.0, "hold": 3.0}
PART = {Side.LEFT: 1}


# Truth -----------------------------------------------------------------------------------------------------


@equal
class IsTrue(Program):
    flag: bool | None

    def begin(self) -> None:
        self.flag: bool | None = None

    def control(self) -> None:
        hot = self.u > 1.0
        self.c = int(hot is True) + 2 * int(hot is not False) + 4 * int(self.yes is hot)
        self.yes = self.flag is True
        self.c += 8 * int(self.flag is not False) + 16 * int(True is not self.yes)
        self.flag = None if self.n > 3 else hot


# Enums -----------------------------------------------------------------------------------------------------


@equal
class Members(Program):
    def begin(self) -> None:
        self.side, self.level = Side.LEFT, Level.NONE

    def control(self) -> None:
        self.side = self.side.turned() if self.u > 0.0 else self.side.turned(yes=False)
        self.k = self.side.sign
        self.level = Level.SOME if self.u > 1.0 else Level.MORE if self.n > 1 else Level.NONE
        self.c = self.level.value
        self.yes = self.level.above(self.n)


@equal
class OrderOfMembers(Program):
    def begin(self) -> None:
        self.level, self.other = Level.NONE, Level.SOME

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.MORE if self.n > 1 else Level.NONE
        self.other = Level.MORE if self.u > 0.0 else self.level
        self.yes = self.level > Level.MORE
        self.c = (self.level >= 2) + 2 * (self.level == 5) + 4 * (self.level < self.u) + 8 * (self.other <= self.level)
        self.c += 16 * (self.level < Level.SOME)


@equal
class ArithmeticOfMembers(Program):
    def begin(self) -> None:
        self.level, self.row, self.maybe_level = Level.NONE, [1.0, 2.0, 4.0], None

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.MORE if self.n > 1 else Level.NONE
        self.c = self.level + 1 - Level.SOME * 2 + (-self.level) + (self.level & 3) + (7 >> self.level) + ~Level.MORE
        self.c += int(self.level) + abs(self.level) + self.level**2 + (self.level - Level.SOME)
        self.c += self.level
        self.k = self.level * self.u + self.level / 4 + float(self.level) + round(self.level)
        if self.level is not Level.SOME:
            self.k += self.row[self.level] + GAINS[self.level] + ROUTES[self.level][0]
            self.row[self.level] += self.level
        self.k -= self.row[Level.MORE] + GAINS[Level.NONE] + STEPS.get(self.level.value, 3)


@equal
class NameOfAMemberThatIsTold(Program):
    def begin(self) -> None:
        self.side, self.note = Side.LEFT, ""

    def control(self) -> None:
        self.side = Side.LEFT if self.u > 1.0 else Side.RIGHT
        self.note = f"on the {self.side.name}"
        if self.u > 2.0:
            raise ValueError(f"no {self.side.name}")
        self.k = self.u


@equal
class DivisionByAMember(Program):
    def begin(self) -> None:
        self.level: Level | None = None

    def control(self) -> None:
        self.level = None if self.n > 3 else Level.SOME if self.u > 1.0 else Level.NONE
        try:
            self.c = 10 // self.level
        except TypeError:
            self.c = -1
        except ZeroDivisionError:
            self.c = -2


# Functions in a function -----------------------------------------------------------------------------------

late = 9.0


@equal
class FunctionsInAFunction(Program):
    def begin(self) -> None:
        self.row, self.total = [1.0, 2.0, 4.0], 0.0

    def control(self) -> None:
        gain, late = 2.0, self.u

        def scaled(x: float, by: float = 0.5, *, sign: float) -> float:
            if x > 3.0:
                return gain * by
            return x * gain * sign + late

        def counted(x: float) -> int:
            def twice(n: int) -> int:
                self.c += 1
                return n * 2 if x > gain else n

            return twice(twice(self.n % 50))

        self.k = scaled(self.u, sign=1.0)
        gain = -0.0
        late = late + 1.0
        self.k += scaled(self.k, sign=-1.0) + scaled(1.0, late, sign=gain)
        for gain in self.row:
            self.total += scaled(gain, sign=1.0) + counted(gain)
        self.c += sum(counted(x) for x in (1.0, self.u))


@equal
class FailureInAFunction(Program):
    def control(self) -> None:
        n = self.n % 3

        def divided() -> float:
            return self.u / n

        try:
            self.k = divided()
        except ZeroDivisionError:
            n = 2
            self.k = divided()


# Texts -----------------------------------------------------------------------------------------------------


@equal
class TextsAsStates(Program):
    def begin(self) -> None:
        self.phase, self.last, self.note = "idle", "", "nothing"

    def next(self, phase: str) -> str:
        return phase if self.n > 1 else self.phase

    def control(self) -> None:
        match self.phase:
            case "idle":
                self.c = 1
                if self.u > 1.0:
                    self.phase = "heat"
            case "heat" | "hold":
                self.c = 2
                self.phase = "hold" if self.n > 0 else "idle"
            case _:
                self.c = 3
        if self.phase != self.last:
            self.last = self.phase
            self.c += 10
        phase = self.next(self.last)
        self.yes = phase == "hold" or phase in ("heat", "other")
        self.k = RATES[self.phase] if self.last else -1.0
        self.c += 100 * bool(self.phase) + 1000 * (self.phase == "never") + 10000 * (phase is None)
        if self.yes:
            self.note = f"{phase} {self.u}"
        else:
            self.note = "seen"


@equal
class TextsThatAreKeysOnly(Program):
    def begin(self) -> None:
        self.found, self.sought = "idle", "heat"

    def control(self) -> None:
        self.k = RATES[self.found] + RATES.get(self.sought, self.u)
        self.found = "hold" if self.u > 1.0 else "heat"
        self.sought = "other" if self.n > 1 else "hold"
        self.yes = RATES.get(self.sought) is None


@equal
class EmptyTexts(Program):
    def begin(self) -> None:
        self.alarm = "none"

    def control(self) -> None:
        if self.alarm:
            self.c = 1
        self.alarm = "" if self.u > 1.0 else "high" if self.u > 0.0 else "none"
        if not self.alarm:
            self.c += 2
        self.alarm = self.alarm if self.n > 1 else ""


@equal
class ListsSeveralTimes(Program):
    def begin(self) -> None:
        self.table = [0.5, -1.0, 2.0]

    def control(self) -> None:
        twice = self.table * 2
        self.c = len(twice)
        self.k = twice[4] + twice[-1] * self.u + sum(twice)


# Names -----------------------------------------------------------------------------------------------------


@equal
class UpperCase(Program):
    def begin(self) -> None:
        self.PV = 1.0

    def control(self) -> None:
        self.k = self.PV
        self.PV = self.u
        self.a.write(self.PV if self.PV > 0.0 else 0.0)


@equal
class PrivateNames(Program):
    def begin(self) -> None:
        self.__count, self.__last = 0, 0.0

    def __bump(self, __by: int) -> int:
        self.__count += __by
        return self.__count

    def control(self) -> None:
        self.c = self.__bump(2)
        self.k, self.__last = self.__last, self.u


class Pair(NamedTuple):
    auto: float
    NULL: float
    has: float = 0.0


class Double:
    def __init__(self) -> None:
        self.EOF = 1.0


@equal
class WordsOfC(Program):
    """Names of words and macros of C, of umo, of ctypes, beyond ASCII, and those that they could become."""

    def begin(self) -> None:
        self.auto, self.auto_, self.double, self.EOF, self.errno, self.M_PI = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
        self.bool, self.register, self.int32_t, self.umo_real, self.machine_step = True, 2, 3, 4.0, 5.0
        self.größe, self.gr_f6_, self.x_u, self._objects, self.keep, self._Bool = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
        self.pair, self.pairs, self.NULL, self.outputs = Pair(1.0, 2.0), [Pair(1.0, 2.0)], Double(), Double()

    def control(self) -> None:
        self.auto, self.auto_, self.double = self.auto_, self.double, self.auto + 1.0
        self.EOF, self.errno, self.M_PI = self.errno, self.M_PI, self.EOF + 1.0
        self.register, self.int32_t, self.bool = self.int32_t, self.register + 1, not self.bool
        self.umo_real, self.machine_step, self._Bool = self.machine_step, self._Bool, self.umo_real + 1.0
        self.größe, self.gr_f6_, self.x_u = self.gr_f6_, self.x_u, self.größe + 1.0
        self._objects, self.keep = self.keep, self._objects + 1.0
        self.pair = Pair(self.pair.NULL, self.u, self.pair.auto)
        self.NULL.EOF, self.outputs.EOF = self.outputs.EOF, self.NULL.EOF + self.pairs[self.n % 1].NULL
        default, int, größe = self.u, 2.0, 3.0
        self.k = default + int + größe


# Else of loops ---------------------------------------------------------------------------------------------


@equal
class ElseOfLoops(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0, 4.0]

    def control(self) -> None:
        for each in self.row:
            if each > self.u:
                break
        else:
            self.c += 1
        for i in range(self.n % 4):
            if i == 2:
                continue
            if i * 1.0 > self.u:
                self.k = 1.0
                break
        else:
            self.k = -1.0
        for part in (self.a, self.b):
            if part.pending > self.u:
                break
        else:
            self.c += 10
        left = self.n % 5
        while left > 0:
            left -= 2
            if left == self.x.read():
                break
        else:
            self.c += 100
        self.yes = left < 0


@equal
class ElseThatLeaves(Program):
    """`break` in an `else` is one of the loop around it."""

    def control(self) -> None:
        for i in range(3):
            for j in range(2):
                if j * 1.0 > self.u:
                    break
            else:
                self.c += i
                break
            self.c += 10
        else:
            return
        self.c += 100


# Tables ----------------------------------------------------------------------------------------------------


@equal
class Tables(Program):
    def begin(self) -> None:
        self.side, self.own = Side.LEFT, (1.5, 2.5)

    def control(self) -> None:
        i = self.n % 5 - 3
        self.c = COUNTS[i]
        self.k = GAINS[i] + ROUTES[i][0] + self.own[i % 2]
        self.side = SIDES[i]
        self.c += ROUTES[i][1] + (self.n % 100, 2, 3)[i]


@equal
class TablesBeyondTheirEnds(Program):
    def control(self) -> None:
        self.k = GAINS[self.n]


@equal
class KnownPlaceBeyondTheEnd(Program):
    def control(self) -> None:
        if self.u > 1.0:
            self.k = GAINS[3]
        elif self.n == 0:
            self.k = (self.u, 2.0)[-3]


@equal
class TableWithABool(Program):
    def control(self) -> None:
        self.k = GAINS[self.u > 1.0] if GAINS[self.n % 3] > 0.0 else 7.0


@equal
class Dicts(Program):
    def begin(self) -> None:
        self.side = Side.LEFT

    def control(self) -> None:
        self.side = Side.RIGHT if self.u > 1.0 else Side.LEFT
        self.k = SPEEDS[self.side]
        self.yes = self.n in STEPS
        self.c = STEPS[self.n % 3]


@equal
class DictWithoutTheKey(Program):
    def begin(self) -> None:
        self.side = Side.LEFT

    def control(self) -> None:
        self.side = Side.RIGHT if self.u > 1.0 else Side.LEFT
        try:
            self.c = PART[self.side]
        except KeyError:
            self.c = -1
        self.c += STEPS[self.n]


@equal
class BoolBesideAConstant(Program):
    """Compilers warn of such a comparison, whose answer is known."""

    def control(self) -> None:
        self.yes = (self.u < 2.0) > -3
        self.c = int((self.u < 2.0) == 1) + 2 * int((self.n > 1) < 0.5) + 4 * int((self.u > 0.0) != -1)
        self.c += 8 * int(100 not in (1, int(self.maybe is None), 3))


@equal
class StateChosenByASign(Program):
    """gcc makes a shift of it, and warns of the int."""

    def begin(self) -> None:
        self.level = Level.NONE

    def control(self) -> None:
        self.level = Level.SOME if self.n < 0 else Level.NONE
        self.c = self.level.value


class Halved:
    def __init__(self) -> None:
        self.whole = 4.0

    @property
    def half(self) -> float:
        return self.whole / 2.0

    @half.setter
    def half(self, value: float) -> None:
        self.whole = value * 2.0


@equal
class PropertyThatIsIncreased(Program):
    def begin(self) -> None:
        self.halved = Halved()

    def control(self) -> None:
        self.halved.half += 1.0
        self.halved.half /= 2.0
        self.k = self.halved.whole


@equal
class LoopThatIsLeftInFinally(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / self.n
        finally:
            for number in range(4):
                if number == self.n:
                    break
                if number == 1:
                    continue
                self.c += 1


@equal
class OtherwiseInATuple(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def control(self) -> None:
        self.pair = (self.maybe or 0.5, self.pair[0])
        self.k = self.pair[1]


@equal
class SignOfANan(Program):
    """It depends on the processor: the controller stops."""

    def control(self) -> None:
        self.k = math.copysign(2.0, self.u - 1.0)


@needs_a_compiler
def test_the_sign_of_a_nan_is_a_limit_of_the_controller(results: dict[Any, Played]) -> None:
    assert results[SignOfANan].limits == 1


@equal
class LimitBeforeAFinally(Program):
    """Python goes on where a whole number leaves 32 bits: the controller stops there, with nothing of `finally`."""

    def control(self) -> None:
        try:
            if math.isnan(self.u):
                self.c += 2**31 - 1
                self.c += 1
        finally:
            assert self.c == 0


@equal
class FinallyThatAlwaysRaises(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / (self.n - 2)
            if self.n == 5:
                return
        finally:
            raise ValueError("always")


@equal
class KnownWholeNumbersDividedByZero(Program):
    """What cannot be evaluated has the type that it would have."""

    def begin(self) -> None:
        self.cells = [1, 2]

    def control(self) -> None:
        if self.n == 2:
            self.cells[-1] = 1 // 0
        for number in range(3):
            if self.n == 1:
                self.c //= ~number // number
        self.k = 0.1**1000000.0


@equal
class FinallyAfterWhatCannotFail(Program):
    def control(self) -> None:
        try:
            if self.n == 5:
                return
            self.k = 2.0
        finally:
            self.c = 3
        self.k = 1.0


@equal
class FunctionMadeInEachTurn(Program):
    def begin(self) -> None:
        self.halves, self.numbers = [Halved(), Halved()], [1.0, 2.0]

    def control(self) -> None:
        for half in self.halves:
            for number in self.numbers:
                if self.maybe is None:
                    self.c += 1

                def scaled(factor: float, more: float = 2.0) -> float:
                    return factor * number + more  # noqa: B023 - it is called in this turn alone

                self.k += scaled(half.whole)


@equal
class BitsThatAreAlwaysThere(Program):
    """Compilers warn of comparisons that are always true."""

    def control(self) -> None:
        mask = 4
        if bool(65536 | self.n) and self.n | mask != 0:
            self.c = 1
        if (self.n & 8) == 5 or (self.c | 4) == 3:
            self.c = 2
        if (self.n & 3) == 1 or (self.n | 2) == 3:
            self.c = 3


@equal
class MethodThatIsNeverCalled(Program):
    """No function, table or question about faults is in C that nothing comes to: compilers warn of them."""

    def begin(self) -> None:
        self.both = Vector([self.a, self.b])

    def asked(self) -> float:
        try:
            self.both.write(1.0 / self.n)
        except ZeroDivisionError:
            return 1.0
        return 2.0

    def control(self) -> None:
        for number, _ in enumerate([self.a, self.b]):
            if self.n == 7 != number < number:
                self.k = self.asked()
        self.c += 1


@needs_a_compiler
def test_a_limit_of_the_controller_is_not_replaced_by_an_error_of_finally(results: dict[Any, Played]) -> None:
    assert results[LimitBeforeAFinally].limits == 1


test_it_is_what_python_does = CASES.test()

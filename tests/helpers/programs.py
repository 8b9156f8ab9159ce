"""Control programs at random, as text of Python: what translates, in every context, and what has to be refused.

A seed gives a program. It has a class `Program` with `control()`, for `helpers.side_by_side`: attributes of every kind,
helpers, lists, arrays, tuples and states; statements and expressions are nested at random. Some are snippets of what
was once translated wrongly (`helpers.hazards`); they are put into any place of any program.
"""

from __future__ import annotations

import linecache
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from random import Random
from types import ModuleType
from typing import Any

from helpers.hazards import HAZARDS

HEAD = """\
import functools
import math
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from umo.states import OnOff


class Mode(Enum):
    OFF = 0
    HEAT = 1
    COOL = 2


class Level(IntEnum):
    NONE = 0
    SOME = 1
    MORE = 2

    def above(self, number: int) -> bool:
        return self.value > number


class Pair(NamedTuple):
    first: float
    second: float


class Count(NamedTuple):
    number: int
    yes: bool


class Part:
    total = 0
    shared = [1.0, 2.0, 3.0]

    def __init__(self, gain: float) -> None:
        self.gain = gain
        self.count = 0
        self.last: float | None = None

    def scaled(self, x: float) -> float:
        self.count += 1
        return self.gain * x

    def __len__(self) -> int:
        return self.count % 3

    @property
    def half(self) -> float:
        return self.gain / 2.0

    @half.setter
    def half(self, value: float) -> None:
        self.gain = value * 2.0

    @cached_property
    def once(self) -> float:
        return self.gain


@dataclass(frozen=True)
class Frozen:
    k: float = 1.0


ROW = [1.0, 2.0]
TABLE, STEPS, GAINS = (0.5, -2.0, 4.0), [3, 1, -7], {Mode.OFF: 1.5, Mode.HEAT: -0.0}


def doubled(function: Any) -> Any:
    @functools.wraps(function)
    def wrapper(self: Any, number: float) -> float:
        return 2.0 * function(self, number)

    return wrapper


class Program:
    maybe: float | None
    last: float | None
    count: int | None
    side: Mode | None

    def __init__(self, rig: Any) -> None:
        self.x, self.a, self.b, self.fan = rig.x, rig.a, rig.b, rig.fan
        self.u, self.v, self.n, self.i, self.on, self.maybe, self.mode = 0.0, 0.0, 0, 0, False, None, Mode.OFF
        self.s, self.t, self.c, self.d, self.yes = 0.0, 1.0, 0, 1, True
        self.last, self.count, self.side, self.level = None, None, None, Level.NONE
        self.row, self.cells, self.marks = [1.0, 2.0, 4.0], [1, 2, 3, 4], [True, False]
        self.array, self.other = np.zeros(3), np.ones(3)
        self.phase = "idle"
        self.pair, self.two = Pair(1.0, 2.0), (1, 2.0)
        self.part, self.spare = Part(2.0), Part(0.5)
        self.frozen = Frozen()
        self.parts = [self.part, self.spare]
{begin}
    def bump(self) -> int:
        self.c = (self.c + 1) % 100
        return self.c % 3

    def clears(self) -> bool:
        self.last = None
        return self.c > 1

    def pairs(self, x: float, n: int = 1) -> tuple[float, int]:
        if n > 2:
            return x, 0
        return x * 0.5, n

    def its_row(self) -> list[float]:
        return self.row

    @doubled
    def helped(self, number: float) -> float:
        return number + 1.0
"""
REALS = ["0.0", "1.0", "-1.0", "0.5", "2.5", "-2.0", "3.0", "100.0", "1e300", "0.1"]
WHOLES = ["0", "1", "2", "3", "-1", "7", "-5", "100", "65536"]
TEXTS = ["'idle'", "'heat'", "'hold'", "''"]
NEVER = 0.0
Write = Callable[["Writer"], list[str]]


class Writer:
    """The text of one program."""

    def __init__(self, random: Random, hazards: float) -> None:
        self.random, self._hazards = random, hazards
        self.begin: list[str] = []
        self.reals: list[str] = []
        self.wholes: list[str] = []
        """Local names that have a value here."""
        self._depth = 0
        self._names = 0
        self.turns: list[str] = []
        """Names that count the turns of loops: nothing is assigned to them, so that loops end."""

    def pick(self, *options: str) -> str:
        return self.random.choice(options)

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def assigned(self, names: Sequence[str]) -> list[str]:
        """Those of these names to which something may be assigned."""
        return [name for name in names if name not in self.turns]

    def new(self, stem: str = "v") -> str:
        self._names += 1
        return f"{stem}{self._names}"

    # Expressions ---------------------------------------------------------------------------------------

    def real(self, depth: int = 2) -> str:
        if depth <= 0 or self.chance(0.25):
            local = self.pick(*self.reals) if self.reals else "self.u"
            return self.pick(
                "self.u", "self.v", "self.s", "self.t", local, local, self.pick(*REALS), "self.x.read()",
                "self.part.gain", "self.pair.first", "self.row[1]", "self.part.half",
            )  # fmt: skip
        r, w, b = (lambda: self.real(depth - 1)), (lambda: self.whole(depth - 1)), (lambda: self.truth(depth - 1))
        options: list[Callable[[], str]] = [
            lambda: f"({r()} {self.pick('+', '-', '*', '/', '//', '%')} {r()})",
            lambda: f"({r()} {self.pick('+', '-', '*', '/')} {w()})",
            lambda: f"({w()} {self.pick('+', '-', '*', '/')} {r()})",
            lambda: f"(-{r()})",
            lambda: f"abs({r()})",
            lambda: f"{self.pick('max', 'min')}({r()}, {r()})",
            lambda: f"{self.pick('max', 'min')}({r()}, {r()}, {r()})",
            lambda: f"float({self.pick(w(), b(), r())})",
            lambda: f"({r()} if {b()} else {r()})",
            lambda: f"({r()} {self.pick('and', 'or')} {r()})",
            lambda: f"math.{self.pick('sqrt', 'floor', 'fabs', 'log', 'exp', 'sin', 'ceil')}({r()}) * 1.0",
            lambda: f"math.copysign({r()}, {r()})",
            lambda: f"self.row[{w()}]",
            lambda: f"sum({self.pick('self.row', f'({r()}, {r()})')})",
            lambda: f"sum(each * {r()} for each in self.row)",
            lambda: f"{self.pick('sum', 'max', 'min')}([each + {r()} for each in {self.pick('self.row', 'TABLE')}])",
            lambda: f"[number * {r()} for number, _ in enumerate(reversed(self.row))][{self.pick('0', '1', w())}]",
            lambda: f"max(one * other for one, other in zip(self.row, ({r()}, {r()}), strict=False))",
            lambda: f"self.{self.pick('part', 'spare')}.scaled({r()})",
            lambda: f"{self.pick('max', 'min')}(self.row)",
            lambda: f"self.pairs({r()}, n={w()})[0]",
            lambda: f"self.pairs({r()})[0]",
            lambda: f"Pair({r()}, {r()}).second",
            lambda: f"float(self.array[{self.pick('0', '1', '-1')}])",
            lambda: f"float(self.array.{self.pick('sum', 'max', 'min')}())",
            lambda: f"({self.pick('self.maybe', 'self.last')} or {r()})",
            lambda: f"({r()} ** {self.pick('2', '3', '-1', '2.0', '0.5', '-1.0', r())})",
            lambda: f"self.helped({r()})",
            lambda: f"round({r()}) * 0.5",
            lambda: f"TABLE[{self.pick('self.n % 3', w(), b())}]",
            lambda: "GAINS[self.mode]",
            lambda: f"GAINS.get({self.pick('self.mode', 'self.side')}, {r()} * 1.0)",
            lambda: f"sum(self.row[{self.pick('1:', ':2', '-2:', '::-1', '::2')}])",
            lambda: f"max((*self.row[:1], {r()}, *TABLE[1:])[{self.pick('1:', '::2')}])",
            lambda: f"(1.0, {r()} * 1.0)[{w()}]",
            lambda: f"round({r()}, {self.pick('0', '1', '3')})",
            lambda: f"math.{self.pick('hypot', 'fmod')}({r()}, {r()})",
            lambda: f"math.{self.pick('asin', 'acos', 'atan', 'log10', 'degrees', 'radians')}({r()})",
        ]
        return self.random.choice(options)()

    def whole(self, depth: int = 2) -> str:
        if depth <= 0 or self.chance(0.3):
            local = self.pick(*self.wholes) if self.wholes else "self.n"
            return self.pick("self.n", "self.i", "self.c", "self.d", local, local, self.pick(*WHOLES), "self.cells[2]",
                             "self.part.count")  # fmt: skip
        w, b = (lambda: self.whole(depth - 1)), (lambda: self.truth(depth - 1))
        options: list[Callable[[], str]] = [
            lambda: f"({w()} {self.pick('+', '-', '*', '//', '%')} {w()})",
            lambda: f"(-{w()})",
            lambda: f"abs({self.pick(w(), b())})",
            lambda: f"{self.pick('max', 'min')}({w()}, {w()})",
            lambda: f"{self.pick('int', 'round', 'math.floor', 'math.ceil', 'math.trunc')}({self.real(depth - 1)})",
            lambda: f"int({b()})",
            lambda: f"({w()} if {b()} else {w()})",
            lambda: f"({w()} {self.pick('and', 'or')} {w()})",
            lambda: f"self.cells[{w()} % 4]",
            lambda: f"len({self.pick('self.row', 'self.cells', 'self.array')})",
            lambda: f"sum({self.pick('self.cells', 'self.marks')})",
            lambda: f"({w()} + ({b()}))",
            lambda: "self.bump()",
            lambda: f"STEPS[{w()} % 3]",
            lambda: "self.level.value",
            lambda: f"(self.level {self.pick('+', '-', '*', '//', '%', '&')} {self.pick(w(), 'Level.MORE')})",
            lambda: "self.cells[self.level]",
            lambda: "self.mode.value",
            lambda: f"({w()} {self.pick('&', '|', '^')} {w()})",
            lambda: f"({w()} {self.pick('<<', '>>')} {self.pick('1', '3', '40', w(), f'({w()} & 7)')})",
            lambda: f"(~{self.pick(w(), b())})",
            lambda: f"({w()} ** {self.pick('0', '1', '2', '3', '5')})",
            lambda: f"self.pairs({self.real(depth - 1)}, {w()})[1]",
        ]
        return self.random.choice(options)()

    def truth(self, depth: int = 2) -> str:
        if depth <= 0 or self.chance(0.15):
            return self.pick("self.on", "self.yes", "self.marks[0]", "self.maybe is None", "self.last is not None")
        r, w, b = (lambda: self.real(depth - 1)), (lambda: self.whole(depth - 1)), (lambda: self.truth(depth - 1))
        sign = lambda: self.pick("<", "<=", ">", ">=", "==", "!=")  # noqa: E731
        options: list[Callable[[], str]] = [
            lambda: f"({r()} {sign()} {r()})",
            lambda: f"({w()} {sign()} {w()})",
            lambda: f"({w()} {sign()} {r()})",
            lambda: f"({r()} {self.pick('<', '<=')} {r()} {self.pick('<', '<=')} {r()})",
            lambda: f"({w()} {self.pick('<', '==')} {w()} {self.pick('<', '!=')} {w()} < {w()})",
            lambda: f"({b()} {self.pick('and', 'or')} {b()})",
            lambda: f"({b()} {self.pick('and', 'or')} {b()} {self.pick('and', 'or')} {b()})",
            lambda: f"(not {b()})",
            lambda: f"(self.level {sign()} {self.pick('Level.SOME', w(), r())})",
            lambda: f"self.level.above({w()})",
            lambda: f"({b()} {self.pick('is', 'is not')} {self.pick('True', 'False')})",
            lambda: f"(self.phase {self.pick('==', '!=')} {self.pick(*TEXTS)})",
            lambda: f"(self.phase {self.pick('in', 'not in')} ({self.pick(*TEXTS)}, {self.pick(*TEXTS)}))",
            lambda: "bool(self.phase)",
            lambda: f"({b()} {self.pick('&', '|', '^')} {b()})",
            lambda: f"bool({self.pick(r(), w())})",
            lambda: f"(self.mode {self.pick('is', 'is not', '==', '!=')} Mode.{self.pick('OFF', 'HEAT', 'COOL')})",
            lambda: f"(self.side {self.pick('is', 'is not', '==', '!=')} {self.pick('Mode.OFF', 'Mode.COOL', 'None')})",
            lambda: f"(self.side {self.pick('in', 'not in')} (Mode.OFF, {self.pick('None', 'Mode.HEAT')}))",
            lambda: f"({w()} {self.pick('in', 'not in')} ({w()}, {w()}, 3))",
            lambda: f"({w()} in {self.pick('self.cells', 'self.cells[1:]', 'STEPS')})",
            lambda: f"({self.pick('self.maybe', 'self.last')} {self.pick('is', 'is not', '==', '!=')} None)",
            lambda: f"({self.pick('self.maybe', 'self.count')} {self.pick('==', '!=')} {self.pick(r(), w())})",
            lambda: f"{self.pick('any', 'all')}({self.pick('self.row', 'self.marks', 'self.cells')})",
            lambda: f"{self.pick('any', 'all')}(each > {r()} for each in {self.pick('self.row', f'({r()}, {r()})')})",
            lambda: f"any({r()} / each > 1.0 for each in (self.u, {r()}) if each > {self.pick('0.0', '1.0')})",
            lambda: f"math.{self.pick('isfinite', 'isnan', 'isinf')}({r()})",
            lambda: f"(self.maybe is not None and self.maybe > {r()})",
            lambda: f"(self.last is None or self.last < {r()})",
            lambda: f"(self.fan.pending is OnOff.{self.pick('ON', 'OFF')})",
        ]
        return self.random.choice(options)()

    def array(self, depth: int = 2) -> str:
        if depth <= 0 or self.chance(0.3):
            return self.pick("self.array", "self.other", "np.zeros(3)", "np.ones(3)")
        a = lambda: self.array(depth - 1)  # noqa: E731
        options: list[Callable[[], str]] = [
            lambda: f"({a()} {self.pick('+', '-', '*', '/')} {self.pick(a(), self.real(1))})",
            lambda: f"np.where({a()} > {self.real(1)}, {a()}, {self.pick(a(), '0.0')})",
            lambda: f"np.clip({a()}, -1.0, {self.real(0)})",
            lambda: f"np.{self.pick('maximum', 'minimum')}({a()}, {self.pick(a(), self.real(0))})",
            lambda: f"np.{self.pick('abs', 'floor', 'nan_to_num')}({a()})",
            lambda: f"{a()}.copy()",
        ]
        return self.random.choice(options)()

    def optional(self) -> str:
        return self.pick(
            "None", self.real(1), "self.maybe", "self.last", f"(None if {self.truth(1)} else {self.real(1)})"
        )

    # Statements ----------------------------------------------------------------------------------------

    def block(self, most: int = 3) -> list[str]:
        """Some statements, one deeper; local names that they make are no longer used after it."""
        self._depth += 1
        reals, wholes = list(self.reals), list(self.wholes)
        lines = [line for _ in range(self.random.randint(1, most)) for line in self.statement()]
        self.reals, self.wholes = reals, wholes
        self._depth -= 1
        return [f"    {line}" for line in lines]

    def statement(self) -> list[str]:
        if self.chance(self._hazards):
            return self.random.choice(HAZARDS)(self)
        if self._depth < 3 and self.chance(0.35):
            return self.random.choice(COMPOUND)(self)
        return self.random.choice(SIMPLE)(self)

    def with_hazard(self, write: Write) -> list[str]:
        """A hazard by itself, or inside of another statement."""
        lines = write(self)
        if self.chance(0.6):
            return lines
        head = self.pick(f"if {self.truth()}:", "for part in self.parts:", "for turn in range(2):", "try:")
        tail = ["except ZeroDivisionError:", "    self.c = 5"] if head == "try:" else []
        return [head, *(f"    {line}" for line in lines), *tail]


def _real_name(w: Writer) -> list[str]:
    value = w.real()
    others = w.assigned(w.reals)
    name = w.new() if w.chance(0.6) or not others else w.pick(*others)
    w.reals.append(name)
    return [f"{name} = {value} * 1.0"]


def _whole_name(w: Writer) -> list[str]:
    value = w.whole()
    others = w.assigned(w.wholes)
    name = w.new("w") if w.chance(0.6) or not others else w.pick(*others)
    w.wholes.append(name)
    return [f"{name} = {value}"]


def _changed(w: Writer) -> list[str]:
    target = w.pick("self.s", "self.t", "self.part.gain", "self.spare.gain", "self.row[0]", *w.assigned(w.reals))
    return [f"{target} {w.pick('+=', '-=', '*=', '/=')} {w.real()}"]


def _counted(w: Writer) -> list[str]:
    target = w.pick("self.c", "self.d", "self.part.count", "self.cells[1]", *w.assigned(w.wholes))
    return [f"{target} {w.pick('+=', '-=')} {w.whole()}"]


SIMPLE: Sequence[Write] = [
    _real_name,
    _whole_name,
    _changed,
    _counted,
    lambda w: [f"{w.pick('self.s', 'self.t', 'self.part.gain', 'self.spare.half')} = {w.real()} * 1.0"],
    lambda w: [f"{w.pick('self.c', 'self.d')} = {w.whole()}"],
    lambda w: [f"self.yes = {w.truth()}"],
    lambda w: [f"self.last = {w.optional()}"],
    lambda w: [f"self.count = {w.pick('None', w.whole(1))}"],
    lambda w: [f"self.mode = Mode.{w.pick('OFF', 'HEAT')} if {w.truth(1)} else Mode.COOL"],
    lambda w: [f"self.level = Level.{w.pick('SOME', 'NONE')} if {w.truth(1)} else Level.MORE"],
    lambda w: [f"self.phase = {w.pick(*TEXTS)}{w.pick('', f' if {w.truth(1)} else self.phase')}"],
    lambda w: [f"self.side = {w.pick('None', 'Mode.OFF', 'Mode.COOL', 'self.mode')}"],
    lambda w: [f"self.row[{w.pick('0', '1', '-1', w.whole(1))}] = {w.real(1)} * 1.0"],
    lambda w: [f"self.cells[{w.pick('0', '1', '-1', w.whole(1))}] = {w.whole(1)}"],
    lambda w: [f"self.marks[{w.pick('0', '1')}] = {w.truth(1)}"],
    lambda w: [f"self.{w.pick('array', 'other')} = {w.array()}"],
    lambda w: [f"self.array[{w.pick('0', '1', '2')}] {w.pick('=', '=', '+=')} {w.real(1)}"],
    lambda w: [f"self.pair = Pair({w.real(1)} * 1.0, {w.real(1)} * 1.0)"],
    lambda w: [f"self.a.write({w.real()})"],
    lambda w: [f"self.b.write({w.pick(w.real(1), w.whole(1))})"],
    lambda w: [f"self.fan.write(OnOff.ON if {w.truth(1)} else OnOff.OFF)"],
    lambda w: [f"self.s, self.t = {w.real(1)} * 1.0, {w.real(1)} * 1.0"],
    lambda w: [f"self.{w.pick('bump', 'clears')}()"],
    lambda w: [f"self.two = ({w.whole(1)}, {w.real(1)} * 1.0)"],
]


def _if(w: Writer) -> list[str]:
    lines = [f"if {w.truth()}:", *w.block()]
    if w.chance(0.3):
        lines += [f"elif {w.truth()}:", *w.block(2)]
    return [*lines, "else:", *w.block()] if w.chance(0.5) else lines


def _loop(w: Writer, head: str, name: str, whole: bool) -> list[str]:
    reals, wholes = list(w.reals), list(w.wholes)
    (w.wholes if whole else w.reals).append(name)
    w.turns.append(name)
    body = w.block()
    if w.chance(0.4):
        body += [f"    if {w.truth(1)}:", f"        {w.pick('break', 'continue')}"]
        body += w.block(1)
    w.reals, w.wholes = reals, wholes
    return [head, *body, "else:", *w.block(1)] if w.chance(0.2) else [head, *body]


def _range(w: Writer) -> list[str]:
    name = w.new("k")
    ends = w.pick("3", f"{w.whole(1)} % 5", f"1, {w.whole(0)} % 6, 2", f"{w.whole(0)} % 5, 0, -1")
    return _loop(w, f"for {name} in range({ends}):", name, whole=True)


def _over(w: Writer) -> list[str]:
    name = w.new("e")
    over, whole = w.random.choice([("self.row", False), ("self.cells", True), (f"({w.real(1)} * 1.0, 2.0)", False)])
    return _loop(w, f"for {name} in {over}:", name, whole)


def _zip(w: Writer) -> list[str]:
    number, name, other = w.new("k"), w.new("e"), w.new("e")
    w.turns += [name, other]
    one, two = (w.pick("self.row", "self.cells", "TABLE", "reversed(self.cells)", f"({w.real(1)}, 2)") for _ in "12")
    turns = f"enumerate(zip({one}, {two}, strict=False))"
    return _loop(w, f"for {number}, ({name}, {other}) in {turns}:", number, whole=True)


def _while(w: Writer) -> list[str]:
    name = w.new("q")
    loop = _loop(w, f"while {name} > 0:", name, whole=True)
    return [f"{name} = {w.whole(1)} % 4", loop[0], f"    {name} -= 1", *loop[1:]]


def _try(w: Writer) -> list[str]:
    kind = w.pick("ZeroDivisionError", "ArithmeticError", "(ValueError, TypeError)", "Exception")
    lines = ["try:", *w.block()]
    if w.chance(0.7):
        lines += [f"except {kind}:", *w.block(2)]
        if w.chance(0.2):
            lines += ["else:", *w.block(1)]
        return [*lines, "finally:", *w.block(1)] if w.chance(0.3) else lines
    return [*lines, "finally:", *w.block(2)]


def _function(w: Writer) -> list[str]:
    """A function in the function, which is called once or twice; it sees the names around it as they are then."""
    name, x, changed = w.new("f"), w.new("x"), w.new("v")
    value = w.real(1)
    w.reals += [changed]
    around = list(w.reals)
    w.reals += [x]
    lines = [f"def {name}({x}: float, n: int = 2) -> float:", f"    if {w.truth(1)}:"]
    lines += [f"        return {w.real(1)} * 1.0", f"    return {x} * {w.real(1)} * n"]
    w.reals = around
    lines += [f"self.s = {name}({w.real(1)} * 1.0)", f"{changed} = {w.real(1)} * 1.0"]
    return [f"{changed} = {value} * 1.0", *lines, f"self.t = {name}({changed}, n=3)"]


COMPOUND: Sequence[Write] = [
    _if,
    _if,
    _range,
    _over,
    _zip,
    _while,
    _try,
    lambda w: ["with suppress(ZeroDivisionError, ValueError):", *w.block(2)],
    lambda w: _function(w),
    lambda w: ["for part in self.parts:", *w.block(2), f"    part.gain += {w.real(1)}"],
    lambda w: [f"if (found := {w.real(1)}) > 1.0:", "    self.s = found * 1.0", *w.block(1)],
    lambda w: ["match self.mode:", "    case Mode.OFF | Mode.HEAT:", *(f"    {x}" for x in w.block(2)),
               "    case _:", *(f"    {x}" for x in w.block(2))],
    lambda w: [f"if {w.truth(1)}:", *w.block(1), "    return"],
    lambda w: [f"if {w.truth(1)}:", f"    raise {w.pick('ValueError', 'ZeroDivisionError')}('no')"],
]  # fmt: skip


RATE = 0.02
"""The share of statements that are hazards, besides the one that every second program has."""


def program(seed: int) -> str:
    """The text of a program. Of those with an odd seed each has the next hazard: at any place, and alone in every
    second round, as something else may be refused, or fail first."""
    random = Random(f"program {seed}")
    w = Writer(random, RATE if random.random() < 0.5 else NEVER)
    alone, next_hazard = divmod(seed // 2, len(HAZARDS))
    if seed % 2 and alone % 2:
        return _text(w, HAZARDS[next_hazard](w))
    count = random.randint(2, 6)
    hazard = random.randrange(count) if seed % 2 else -1
    lines = []
    for number in range(count):
        if number == hazard:
            lines += w.with_hazard(HAZARDS[next_hazard])
        lines += w.statement()
    return _text(w, lines)


def _text(w: Writer, lines: list[str]) -> str:
    begin = "".join(f"        {line}\n" for line in w.begin)
    body = "".join(f"        {line}\n" for line in lines)
    return f"{HEAD.replace('{begin}', begin)}\n    def control(self) -> None:\n{body}"


def made(text: str, name: str) -> Callable[[Any], Any]:
    """The class `Program` of a text, whose source is found under this name."""
    file = f"/programs/{name}.py"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    module = sys.modules[name] = ModuleType(name)  # annotations are looked up there
    exec(compile(text, file, "exec", dont_inherit=True), vars(module))
    maker: Callable[[Any], Any] = module.Program
    return maker


REAL_WORDS = [0.0, -0.0, 1.0, -1.0, 2.5, math.nan, math.inf, -math.inf, 1e300, 5e-324, 3.0]
WHOLE_WORDS = [0, 1, -1, 2, 3, 2**31 - 1, -(2**31) + 1]


def inputs(seed: int, trials: int, mode: Any) -> list[list[Mapping[str, Any]]]:
    """Inputs of some trials, each of one to four periods."""
    random = Random(f"inputs {seed}")

    def real() -> float:
        return random.choice(REAL_WORDS) if random.random() < 0.3 else round(random.uniform(-5.0, 5.0), 2)

    def whole() -> int:
        return random.choice(WHOLE_WORDS) if random.random() < 0.1 else random.randint(-4, 6)

    return [
        [
            {
                "x": random.randint(-20, 20), "u": real(), "v": real(), "n": whole(), "i": whole(),
                "on": random.random() < 0.5, "maybe": random.choice((None, real())), "mode": random.choice([*mode]),
            }
            for _ in range(random.randint(1, 4))
        ]
        for _ in range(trials)
    ]  # fmt: skip

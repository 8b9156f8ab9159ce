"""A program by its seed: the text of a module with a part of a machine, its objects, attributes and control code.

Programs with an even seed have only what the guide says translates (docs/howto-generate.md): none of them is refused.
Of those with an odd seed each has the next hazard: at any place, and alone in every second round, as something else may
be refused, or fail first.
"""

from __future__ import annotations

import linecache
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from random import Random
from types import CodeType, ModuleType
from typing import Any

from tools.fuzz import expressions
from tools.fuzz.hazards import HAZARDS
from tools.fuzz.idioms import IDIOMS
from tools.fuzz.statements import COMPOUND, SIMPLE
from tools.fuzz.writer import Grammar, Writer, indented

GRAMMAR = Grammar(
    expressions.LEAVES,
    expressions.EXPRESSIONS,
    expressions.CALLS,
    (expressions.ARRAY_LEAVES, expressions.ARRAYS),
    SIMPLE,
    COMPOUND,
    IDIOMS,
)
TEXT = """\
import functools
import math
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Vector
from umo.control import PID, Hysteresis, Servo, state_of, value_of
from umo.errors import BadInput, RangeError
from umo.objects import Quality
from umo.states import OnOff, PassFail


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

    @staticmethod
    def weight(x: float) -> float:
        return 0.25 * x + 1.0

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
TABLE, STEPS, GAINS = {table}, {steps}, {gains}
POWERS = {{"idle": 0.0, "heat": 8.0, "hold": 3.0, "": 1.0}}
CURVE = ((0.0, 1.0), (1.0, 3.0), (2.5, 2.0), (4.0, -1.0))


def clamped(value: float, low: float, high: float = 10.0) -> float:
    return max(low, min(high, value))


def doubled(function: Any) -> Any:
    @functools.wraps(function)
    def wrapper(self: Any, number: float) -> float:
        return 2.0 * function(self, number)

    return wrapper


class Program(Compound, equipment=True):
    x: DigitalSensor
    y: DigitalSensor
    door: BinarySensor[PassFail]
    a: DigitalActuator
    b: DigitalActuator
    fan: BinaryActuator[OnOff]
    maybe: float | None = None
    last: float | None = None
    count: int | None = None
    side: Mode | None = None
    bias = 0.75

    def setup(self) -> None:
        self.u, self.v, self.n, self.i, self.on, self.maybe, self.mode = 0.0, 0.0, 0, 0, False, None, Mode.OFF
        self.s, self.t, self.c, self.d, self.yes, self.step = {s}, {t}, {c}, {d}, True, 0
        self.last, self.count, self.side, self.level = None, None, None, Level.NONE
        self.row, self.cells, self.marks, self.recent = {row}, {cells}, [True, False], (0.0, 1.0, -0.0)
        self.array, self.other = np.zeros(3), np.ones(3)
        self.low, self.high = -1.0, 2.0
        self.phase = "idle"
        self.pair, self.two = Pair(1.0, 2.0), (1, 2.0)
        self.part, self.spare = Part(2.0), Part(0.5)
        self.frozen = Frozen()
        self.parts = [self.part, self.spare]
{setup}
{interlocks}
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

    def control(self) -> None:
{control}

def part() -> Program:
    relay: Any = {{"one": OnOff.ON, "default": OnOff.OFF}}
    return Program(
        x=DigitalSensor("mm", {x}),
        y=DigitalSensor("K", {y}),
        door=BinarySensor(PassFail, one=PassFail.FAIL{door}),
        a=DigitalActuator("V", {a}),
        b=DigitalActuator("V", {b}),
        fan=BinaryActuator(OnOff, **relay{fan}),
    )
"""


@dataclass(frozen=True)
class Program:
    """The text of a program; `hazard`: its name, empty where there is none."""

    seed: int
    text: str
    hazard: str = ""
    copy: int = 0
    """Its number among changed ones of the same seed."""

    @property
    def name(self) -> str:
        """That of its module."""
        return f"program_{self.seed}_{self.copy}"

    def changed(self, text: str, copy: int) -> Program:
        return replace(self, text=text, copy=copy)

    @property
    def control(self) -> str:
        """The text of its control code."""
        return self.text.partition(CONTROL)[2].partition("\n\ndef part")[0]

    def without_interlocks(self) -> Program:
        head, begin, rest = self.text.partition(INTERLOCKS)
        return replace(self, text=f"{head}{rest[rest.index('    def bump') :]}") if begin else self

    def with_inputs_as_fields(self) -> Program:
        """What a host sets comes from the sensors: for a board, which has none."""
        head, begin, rest = self.text.partition(CONTROL)
        lines = "".join(f"{line}\n" for line in indented(FROM_INPUTS, 2))
        return replace(self, text=f"{head}{begin}{lines}{rest}")

    def loaded(self, names: Mapping[str, Any] | None = None) -> ModuleType:
        """Its module, whose source is found as if it were a file; `names` are there before it is carried out."""
        file = f"/programs/{self.name}.py"
        linecache.cache[file] = len(self.text), None, self.text.splitlines(keepends=True), file
        module = sys.modules[self.name] = ModuleType(self.name)  # annotations are looked up there
        vars(module).update(names or {})
        exec(_compiled(self.text, file), vars(module))
        return module


@lru_cache(2 * 24)
def _compiled(text: str, file: str) -> CodeType:
    """Each program is carried out twice in a batch."""
    return compile(text, file, "exec", dont_inherit=True)


def program(seed: int) -> Program:
    random = Random(f"program {seed}")
    w = Writer(random, GRAMMAR)
    if seed % 2 == 0:
        return Program(seed, _text(w, [line for _ in range(random.randint(2, 7)) for line in w.statement()]))
    alone, next_hazard = divmod(seed // 2, len(HAZARDS))
    hazard = HAZARDS[next_hazard]
    if alone % 2:
        return Program(seed, _text(w, hazard(w)), hazard.__name__)
    count = random.randint(2, 5)
    place = random.randrange(count)
    lines = []
    for number in range(count):
        if number == place:
            lines += _inside(w, hazard(w))
        lines += w.statement()
    return Program(seed, _text(w, lines), hazard.__name__)


def _inside(w: Writer, lines: list[str]) -> list[str]:
    """A hazard by itself, or inside of another statement."""
    if w.chance(0.6):
        return lines
    head = w.pick(f"if {w.truth()}:", "for part in self.parts:", "for turn in range(2):", "try:")
    return [head, *indented(lines), *(["except ZeroDivisionError:", "    self.c = 5"] if head == "try:" else [])]


# What is around the control code ----------------------------------------------------------------------------

CONDITIONS = (
    "self.yes and self.c > 3", "value_of(self.x) > 15.0", "state_of(self.door) is PassFail.FAIL", "self.s > self.t",
    "self.mode is Mode.COOL or self.y.quality is Quality.BAD", "self.c % 4 == 3", "self.y.read() < -5.0",
    "self.level.above(self.d)", "self.pairs(self.u)[0] > 1.0", "self.part.half > 1.5",
    "any(each > 3.0 for each in self.row)", "self.a.pending > 0.5", "self.b.pending < 0.0 or self.yes",
    "self.fan.pending is OnOff.ON",
)  # fmt: skip
SCALES = "minimum=0.0, maximum=50.0, resolution=0.3, zero_offset=0.1", "minimum=-10.0, maximum=10.0, resolution=0.25"
CONTROL = "    def control(self) -> None:\n"
FROM_INPUTS = (
    "self.u = math.nan if self.x.raw == 7 else math.inf if self.x.raw == 5 else self.x.raw * 0.25 - 1.0",
    "self.v = -0.0 if self.y.raw == 0 else self.y.raw * 0.3",
    "self.n, self.i = self.x.raw % 9 - 4, (2147483647 if self.y.raw == 7 else self.y.raw % 7 - 3)",
    "self.on = self.door.raw == 1",
    "self.maybe = None if self.x.raw % 3 == 0 else self.y.raw * 0.5",
)
INTERLOCKS = "    def interlocks(self) -> 'Iterator[Interlock]':\n"
REACTIONS = "", "", ', on_error="mark"', ', on_error="hold", max_age="3 ms"', ', on_error="mark", max_age="2 ms"'
CONDITIONED = "", "", "", ', velocity="4 ms"', ', filter="3 ms"', ", invalid_raws=(7, 5)"


def _text(w: Writer, lines: list[str]) -> str:
    return TEXT.format(
        table=w.pick("(0.5, -2.0, 4.0)", "(0.0, 1e3, -0.0)"),
        steps=w.pick("[3, 1, -7]", "(0, -1, 2)"),
        gains=w.pick("{Mode.OFF: 1.5, Mode.HEAT: -0.0, Mode.COOL: 3.0}", "{Mode.COOL: 0.5, Mode.OFF: 2.0}"),
        s=w.pick("0.0", "-0.0", "2.5"),
        t=w.pick("1.0", "0.0"),
        c=w.pick("0", "7", "99"),
        d=w.pick("1", "0"),
        row=w.pick("[1.0, 2.0, 4.0]", "[0.0, -0.0, 3.5]"),
        cells=w.pick("[1, 2, 3, 4]", "[0, -1, 7, 2]"),
        setup="".join(f"{line}\n" for line in indented(w.setup, 2)),
        interlocks=_interlocks(w),
        control="".join(f"{line}\n" for line in indented(lines, 2)),
        x=_sensor(w, "minimum=-20.0, maximum=20.0, resolution=1.0"),
        y=_sensor(w, w.pick(*SCALES)),
        door=w.pick("", ', on_error="hold", max_age="1 ms"', ', debounce="3 ms", on_error="mark"'),
        a=_actuator(w),
        b=_actuator(w),
        fan=w.pick("", "", ", synchronous=False", ', on_error="retry", max_age="2 ms"', ', expires="4 ms"'),
    )


def _interlocks(w: Writer) -> str:
    text = ""
    for _ in range(w.random.choice((0, 0, 1, 2))):
        outputs = w.pick("self.a", "self.b", "self.fan", "self.a, self.fan")
        how = w.pick("", "", ", latched=True", ', effect="stop"')
        text += f'        yield Interlock(lambda: {w.pick(*CONDITIONS)}, [{outputs}], "{w.new("why")}"{how})\n'
    return f"\n{INTERLOCKS}{text}" if text else ""


def _sensor(w: Writer, scale: str) -> str:
    reaction = w.pick(*REACTIONS)
    return f"{scale}{reaction}{w.pick(*CONDITIONED)}"


def _actuator(w: Writer) -> str:
    if w.chance(0.5):
        return "default=0.0, minimum=-1e9, maximum=1e9, resolution=1.0"
    scale = w.pick("minimum=-10.0, maximum=10.0, resolution=0.03", "minimum=0.0, maximum=50.0, resolution=0.25")
    limits = w.pick("", ', limits="clamp"', ', limits="clamp"')
    more = w.pick("", ", slew_rate=700.0", ', expires="4 ms"', ', on_error="retry", max_age="3 ms"')
    return f"default={w.pick('0.0', '2.5')}, {scale}{limits}{more}"

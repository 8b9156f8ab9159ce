"""The stops of a replay in the debugger: at a period, at a time, at the first difference, or when an expression becomes
true."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from umo.duration import TIME_TOLERANCE, seconds
from umo.errors import DeclarationError, OptionError, text_of
from umo.objects import Atomic, Compound
from umo.text import did_you_mean

FIRST_DIFFERENCE, END = "first-difference", "end"
NAMES: Mapping[str, Any] = {
    each.__name__: each for each in (abs, min, max, any, all, sum, len, round, bool, int, float, str)
} | {"math": math}
"""Names that an expression may use in addition to those of the machine."""
READING = ("read", "read_in", "startswith", "endswith")
"""Methods of objects that an expression may call."""


class FirstDifference(NamedTuple):
    """The first difference of a replay."""

    period: int
    text: str


@dataclass
class Stop:
    """The next place at which a replay stops. A condition that is None is not used."""

    period: int | None = None
    """Number of the period, from 0."""
    time: float | None = None
    """Time in s."""
    difference: bool = False
    """True if the replay stops at the first difference."""
    end: bool = False
    """True if the replay stops in the last period."""

    @classmethod
    def parse(cls, text: str) -> Stop:
        """Parse a place such as `12.3s`, `500`, `first-difference` or `end`. Raises OptionError for anything else."""
        word = text.strip()
        if word in (FIRST_DIFFERENCE, END):
            return cls(difference=word == FIRST_DIFFERENCE, end=word == END)
        if word.isdecimal():
            return cls(period=int(word))
        try:
            return cls(time=seconds(word))
        except DeclarationError:
            forms = f"a time such as 12.3s, the number of a period, {FIRST_DIFFERENCE} or {END}"
            raise OptionError(f"{text!r} is not a place in a replay; write {forms}") from None

    def is_at(self, period: int, time: float, last: bool = False) -> bool:
        """True if a period is at this place or after it. `last`: True if it is the last period."""
        return (
            (self.period is not None and period >= self.period)
            or (self.time is not None and time >= self.time - TIME_TOLERANCE)
            or (self.end and last)
        )

    def nearest(self, snapshots: Mapping[int, float]) -> int:
        """Return the number of the last snapshot before this place, or -2 if there is none. `snapshots`: the times of
        the snapshots in s."""
        before = (period for period, time in snapshots.items() if not self.is_at(period, time))
        return max(before, default=-2)


class BreakCondition:
    """An expression about the machine, such as `z.servo.error > 50`. Its names are the parts of the machine, `m`,
    `period` and `time`.

    An expression only reads: it may call the functions of NAMES and `math`, and the methods in READING."""

    def __init__(self, text: str) -> None:
        """Raise OptionError if the text is not such an expression."""
        self.text = text
        try:
            tree = ast.parse(text.strip(), "--break", "eval")
            self._code = compile(tree, "--break", "eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            why = error.msg if isinstance(error, SyntaxError) else text_of(error)
            raise OptionError(f"--break {text!r} is not an expression: {why}") from None
        for node in ast.walk(tree):
            if refused := _refused(node):
                raise OptionError(f"--break {text!r}: {refused}")
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        bound = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        self._parts = names - bound - NAMES.keys() - {"m", "period", "time"}
        self._was = False
        """True if the expression was true in the period before."""
        self._tried = False
        self.failed = ""
        """The reason why the last evaluation failed; "" if it did not."""

    def becomes_true(self, machine: Compound, period: int, time: float) -> bool:
        """True if the expression is true now, and was not true in the period before. At the first evaluation, raises
        OptionError if the expression has an unknown name."""
        tried, self._tried = self._tried, True
        try:
            parts = {name: getattr(machine, name) for name in self._parts}
            names = {**NAMES, "m": machine, "period": period, "time": time, **parts, "__builtins__": {}}
            now, self.failed = bool(eval(self._code, names)), ""
        except (AttributeError, TypeError) as error:
            now, self.failed = False, _mistake(error)
            if not tried:
                raise OptionError(f"--break {self.text!r}: {self.failed}") from None
        except Exception as error:  # a division by zero, a sensor without a value: it is not true
            now, self.failed = False, text_of(error)
        became, self._was = now and not self._was, now
        return became


def _refused(node: ast.AST) -> str:
    """Return why a part of an expression is not evaluated; "" if it is."""
    if isinstance(node, ast.Lambda | ast.Await | ast.Yield | ast.YieldFrom | ast.NamedExpr):
        return "only expressions that read values can be evaluated"
    if isinstance(node, ast.Attribute) and node.attr.startswith("_"):
        return f"{node.attr} is internal"
    if isinstance(node, ast.Call):
        function = node.func
        if isinstance(function, ast.Name) and callable(NAMES.get(function.id)):
            return ""
        name = function.attr if isinstance(function, ast.Attribute) else ast.unparse(function)
        of_math = isinstance(function, ast.Attribute) and ast.unparse(function.value) == "math"
        if not of_math and (name not in READING or not isinstance(function, ast.Attribute)):
            known = [*(each for each, what in NAMES.items() if callable(what)), *READING]
            return f"{name}() cannot be called in a condition{did_you_mean(name, known)}"
    return ""


def _names(kind: type[Any]) -> Iterator[str]:
    """Yield the names of a class and of all its subclasses."""
    yield kind.__name__
    for each in kind.__subclasses__():
        yield from _names(each)


def _mistake(error: Exception) -> str:
    """Return a text about an error in an expression, such as `Servo has no eror (did you mean 'error'?)`."""
    name, owner = getattr(error, "name", None), getattr(error, "obj", None)
    said = str(error)
    of_object = "compares an object" in said or any(f"'{name}'" in said for name in _names(Atomic))
    if isinstance(error, TypeError) and of_object:
        return f"{text_of(error)}; write `read()` for the value of an object"
    if not isinstance(error, AttributeError) or name is None:
        return text_of(error)
    known = [each for each in dir(owner) if not each.startswith("_")]
    return f"{type(owner).__name__} has no {name}{did_you_mean(name, known)}"

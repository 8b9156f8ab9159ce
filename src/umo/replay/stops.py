"""Where a replay stops for its debugger: at a period, a time, the first difference, an expression that becomes true."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from umo.duration import seconds
from umo.errors import DeclarationError, OptionError
from umo.objects import Compound

FIRST_DIFFERENCE = "first-difference"
ROUNDING = 1e-9
"""Time in s by which a period may come early: the machine's time is a sum of periods."""
NAMES: Mapping[str, Any] = {"abs": abs, "min": min, "max": max, "any": any, "all": all, "math": math, "round": round}


@dataclass
class Stop:
    """The next place at which a replay stops. What is None is not looked for."""

    period: int | None = None
    """Number of a period, from 0."""
    time: float | None = None
    """Time in s."""
    difference: bool = False
    """Whether it stops at the first difference."""

    @classmethod
    def parse(cls, text: str) -> Stop:
        """`12.3s`, `500`, `first-difference`; OptionError for anything else."""
        word = text.strip()
        if word == FIRST_DIFFERENCE:
            return cls(difference=True)
        if word.isdecimal():
            return cls(period=int(word))
        try:
            return cls(time=seconds(word))
        except DeclarationError:
            forms = f"a time such as 12.3s, the number of a period, or {FIRST_DIFFERENCE}"
            raise OptionError(f"{text!r} is no place in a replay; write {forms}") from None

    def is_at(self, period: int, time: float, differs: bool) -> bool:
        return (
            (self.period is not None and period >= self.period)
            or (self.time is not None and time >= self.time - ROUNDING)
            or (self.difference and differs)
        )


class BreakCondition:
    """An expression over the machine, such as `z.servo.error > 50`: names are its parts, `m`, `period` and `time`."""

    def __init__(self, text: str) -> None:
        """OptionError if it is no expression."""
        self.text = text
        try:
            self._code = compile(text.strip(), "--break", "eval")
        except (SyntaxError, ValueError) as error:
            raise OptionError(f"--break {text!r} is no expression: {error}") from None
        self._was = False
        """Whether it was true in the period before."""
        self.failed = ""
        """Why it could not be evaluated the last time; "": it could."""

    def becomes_true(self, machine: Compound, period: int, time: float) -> bool:
        """Whether it is true now, and was not in the period before."""
        try:
            now = bool(eval(self._code, {"__builtins__": {}}, _Names(machine, period, time)))
            self.failed = ""
        except Exception as error:
            now, self.failed = False, f"{type(error).__name__}: {error}"
        became, self._was = now and not self._was, now
        return became


class _Names(Mapping[str, Any]):
    """The names of an expression."""

    def __init__(self, machine: Compound, period: int, time: float) -> None:
        self._machine = machine
        self._own = {"m": machine, "period": period, "time": time}

    def __getitem__(self, name: str) -> Any:
        if name in self._own:
            return self._own[name]
        try:
            return NAMES[name] if name in NAMES else getattr(self._machine, name)
        except AttributeError:
            raise KeyError(name) from None

    def __iter__(self) -> Iterator[str]:
        return iter({**NAMES, **self._own})

    def __len__(self) -> int:
        return len(self._own) + len(NAMES)

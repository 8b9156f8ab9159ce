"""A target: C that is to do in each period what programs do in Python. Many programs are played at once, as parts of
one machine; each is compared alone."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Sequence, Set
from contextlib import ExitStack
from pathlib import Path
from random import Random
from typing import Any

from tools.fuzz.machine import Side
from tools.fuzz.program import Program
from tools.fuzz.stimuli import LAST, WAYS, Stimulus, stimuli, ticks
from tools.fuzz.verdict import Verdict
from umo.errors import DeclarationError

PERIODS = 60
FILE = re.compile(r"(program_\w+)\.py:\d+: (.*)", re.DOTALL)
PART = re.compile(r"parts\.(\d+)\b")


class Refused(Exception):
    """Programs that are refused: `reasons` by their places."""

    def __init__(self, programs: Sequence[Program], reasons: Sequence[str]) -> None:
        super().__init__(*reasons)
        places = {each.name: place for place, each in enumerate(programs)}
        self.reasons: dict[int, str] = {}
        for each in reasons:
            if file := FILE.search(each):
                self.reasons.setdefault(places[file[1]], file[2])
            elif part := PART.search(each):
                self.reasons.setdefault(int(part[1]), each)
            else:
                raise AssertionError(f"a refusal without its place: {each}")


class Target(ABC):
    """`flags`: more of the compiler. Folders are made in `folder`."""

    name: str
    early = 0
    """Periods before the first that is compared."""
    clears = True
    """Whether what is in fault is cleared, and compared further."""
    restores = True
    """Whether Python can take over the fields of C, where that ended at a limit of the controller."""

    def __init__(self, folder: Path, flags: Sequence[str] = (), periods: int = PERIODS) -> None:
        self._folder, self._flags, self._periods = folder, flags, periods
        self._made = 0

    def fit(self, program: Program) -> Program:
        """A program as this target can play it."""
        return program

    def stimulus(self, given: Stimulus) -> Stimulus:
        """What comes from outside, as this target can have it."""
        return given

    @abstractmethod
    def beside(self, python: Side, programs: Sequence[Program], stack: ExitStack) -> Beside:
        """The C of these programs. Refused where it is not translated; DeclarationError with what the compiler says."""

    def played(self, programs: Sequence[Program]) -> list[Verdict]:
        """Programs that are refused are left out; those that do not compile are found by halves."""
        found: dict[Program, Verdict] = {}
        waiting = [[self.fit(each) for each in programs]]
        while waiting:
            some = waiting.pop()
            try:
                found |= zip(some, self._compared(some), strict=True) if some else ()
            except Refused as error:
                found |= {some[n]: Verdict(_refused(some[n]), why) for n, why in error.reasons.items()}
                waiting.append([each for n, each in enumerate(some) if n not in error.reasons])
            except DeclarationError as error:
                if len(some) == 1:
                    found[some[0]] = Verdict("not compiled", str(error))
                    continue
                half = len(some) // 2
                waiting += [some[:half], some[half:]]
        return [found[self.fit(each)] for each in programs]

    def _compared(self, programs: Sequence[Program]) -> list[Verdict]:
        modules = [each.loaded() for each in programs]
        with ExitStack() as stack:
            python = stack.enter_context(Side(modules, [0] * self.early + ticks(self._periods)))
            beside = self.beside(python, programs, stack)
            python.observe()
            given = [stimuli(each.seed, self._periods, module) for each, module in zip(programs, modules, strict=True)]
            given = [list(map(self.stimulus, each)) for each in given]
            signed = {n for n, each in enumerate(programs) if "copysign" in each.text}
            return Comparison(self, python, beside, given, signed).played(self._periods)

    def new_folder(self) -> Path:
        self._made += 1
        return self._folder / f"{self.name}-{self._made}"


def _refused(program: Program) -> str:
    return "refused" if program.hazard else "refused without a hazard"


class Beside(ABC):
    """The C beside a machine in Python."""

    limited: Set[int] = frozenset()
    """The parts that have come to a limit of the controller before the first period that is compared."""

    @abstractmethod
    def set(self, number: int, name: str, value: Any) -> bool:
        """The host sets an attribute of a part. False: it has no such field."""

    @abstractmethod
    def clear(self, number: int) -> bool | None:
        """Whether the fault of a part could be ended; None: it does not tell."""

    @abstractmethod
    def acknowledge(self) -> None: ...

    @abstractmethod
    def step(self, ticks: int, given: Sequence[Stimulus]) -> str | None:
        """One period; the class of an error that no part has contained."""

    @abstractmethod
    def errors(self) -> dict[int, str]:
        """The class of the error of each law that failed in this period."""

    @abstractmethod
    def difference(self, number: int) -> str:
        """What is not the same of a part; empty: nothing."""

    @abstractmethod
    def restore(self, number: int) -> None:
        """Python has the values of the fields of a part in C: it went on where a controller cannot."""

    def set_anything(self, number: int, way: Callable[[Any, Any], object]) -> bool:
        """The host sets what translation takes as known. False: it is not seen, and nothing is set."""
        return False

    def gave_up(self) -> str:
        """Why C does not drive any more; empty: it does."""
        return ""


class Comparison:
    """Programs in Python and in C, period by period."""

    def __init__(
        self, target: Target, python: Side, c: Beside, given: Sequence[Sequence[Stimulus]], signed: Set[int]
    ) -> None:
        """`signed`: programs that look at the sign of a number. Where Python drives on both sides that may be the sign
        of a NaN, of which two runs of Python differ: it adds in another order where it has specialised a line."""
        self._target, self._python, self._c, self._given, self._signed = target, python, c, given, signed
        self._over: set[int] = {*c.limited}
        """Parts that are not compared any more."""
        self._found: dict[int, str] = {}
        self._counts: dict[int, dict[str, int]] = defaultdict(lambda: {"periods": 0, "faults": 0, "limits": 0})

    def played(self, periods: int) -> list[Verdict]:
        numbers = range(len(self._given))
        for period, missed in enumerate(ticks(periods)):
            if period == periods - LAST:
                self._set_anything()
            self._period(period, max(missed, 1))
            if (ended := self._c.gave_up()) and period < periods - LAST:
                self._found |= {n: ended for n in numbers if n not in self._found}
                break
        return [self._verdict(n) for n in numbers]

    def _verdict(self, number: int) -> Verdict:
        told = self._found.get(number, "")
        return Verdict("different" if told else "equal", told, **self._counts[number])

    def _period(self, period: int, missed: int) -> None:
        python, c = self._python, self._c
        given = [each[period] for each in self._given]
        self._host(given)
        if period % 9 == 8:
            python.m.acknowledge()
            c.acknowledge()
        told = c.step(missed, given)
        errors = c.errors()
        python.limited = {number for number, each in errors.items() if each == "ControllerLimit"}
        python.give(given)
        also = python.step()
        if told != also:
            raise AssertionError(f"period {period}: the machine in Python tells {also}, in C {told}")
        for number in range(len(given)):
            if number not in self._found and number not in self._over:
                self._compare(period, number, errors.get(number))

    def _set_anything(self) -> None:
        for number, (part, module) in enumerate(zip(self._python.parts, self._python.modules, strict=True)):
            way = Random(f"way {module.__name__}").choice(WAYS)
            if self._c.set_anything(number, way):
                way(part, module)

    def _host(self, given: Sequence[Stimulus]) -> None:
        python, c = self._python, self._c
        for number, each in enumerate(given):
            if self._target.clears and each.clears and python.in_fault(number):
                one, other = python.clear(number), c.clear(number)
                if other is not None and one != other:
                    self._found.setdefault(number, f"its fault is cleared: Python {one}, C {other}")
            for name, value in each.sets.items():
                if c.set(number, name, value):
                    python.set(number, name, value)

    def _compare(self, period: int, number: int, error: str | None) -> None:
        counts = self._counts[number]
        counts["periods"] += 1
        also = self._python.errors.get(number)
        if number in self._python.limited:
            counts["limits"] += 1
            if self._target.restores:
                self._c.restore(number)
            else:
                self._over.add(number)
                return
        elif error != also:
            self._found[number] = f"period {period}: Python raises {also}, C {error}"
            return
        elif also is not None:
            counts["faults"] += 1
        if not self._target.clears and self._python.in_fault(number):
            self._over.add(number)
            return
        difference = self._c.difference(number)
        if difference and number in self._signed and self._c.gave_up():
            self._over.add(number)
        elif difference:
            self._found[number] = f"period {period}: {difference}"

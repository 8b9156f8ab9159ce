"""Control code as users write it: the same results in C to the bit, or a refusal in words, never other numbers."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from helpers.generating import needs_a_compiler
from helpers.machines import timer
from tools.compiled_machine import CompiledMachine, compiled
from umo import Compound, DigitalSensor
from umo.errors import UmoError
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import laid_out
from umo.generate.translation import Translation
from umo.generate.translator import translate
from umo.testing import VirtualTimer

ERRORS = ArithmeticError, ValueError, TypeError, LookupError, UmoError
WORDS = [0.0, -0.0, 1.0, -1.0, 0.5, 2.5, math.nan, math.inf, -math.inf, 1e308, 5e-324]


class Part:
    def __init__(self, limit: float) -> None:
        self.limit = limit


class Law:
    """What is given, and what is the result."""

    def __init__(self) -> None:
        self.a = self.b = self.out = self.other = 0.0
        self.i = self.n = 0
        self.yes = False
        self.x, self.y, self.mask = np.zeros(3), np.zeros(3), np.zeros(3, np.bool_)
        self.flags, self.whole = np.zeros(3, np.bool_), np.zeros(3, np.int64)
        self.table = [1.0, 2.0, 4.0]
        self.parts = [Part(-1.0), Part(0.5), Part(2.0)]

    def begin(self, random: Random) -> None:
        self.a, self.b, self.table[2] = _number(random), _number(random), _number(random)
        self.i = random.randint(-5, 5)
        self.x, self.y = (np.array([_number(random) for _ in range(3)]) for _ in range(2))
        self.mask = np.array([random.random() < 0.5 for _ in range(3)])
        self.out, self.other, self.n, self.yes = 0.0, 0.0, 0, random.random() < 0.5


def _number(random: Random) -> float:
    return random.choice(WORDS) if random.random() < 0.3 else random.uniform(-4.0, 4.0)


EQUAL: dict[str, Callable[[Any], None]] = {}
REFUSED: dict[str, tuple[Callable[[Any], None], str]] = {}


def equal(work: Callable[[Any], None]) -> Callable[[Any], None]:
    EQUAL[work.__name__] = work
    return work


def refused(reason: str) -> Callable[[Callable[[Any], None]], Callable[[Any], None]]:
    def kept(work: Callable[[Any], None]) -> Callable[[Any], None]:
        REFUSED[work.__name__] = work, reason
        return work

    return kept


@equal
def elements_are_divided_as_numpy_does(c: Law) -> None:
    c.out = float(c.x[0] / c.x[1] + 1.0 / c.x.max() + c.a / c.x.sum())
    c.other = float(half(c.x[0], c.x[1]) + 1.0 / -c.y[2])
    for each in c.x:
        c.out += float(c.a / each)


def half(a: float, b: float) -> float:
    return a / b


@equal
def elements_of_lists_are_numbers_of_python(c: Law) -> None:
    c.out = 1.0 / c.table[2]
    c.x = c.x + c.table
    c.table[0] = float(c.x[0])


@equal
def best_element(c: Law) -> None:
    best = None
    for each in c.x:
        if best is None or each > best:
            best = each
    c.out = float(best)  # type: ignore[arg-type]


@equal
def element_or_number(c: Law) -> None:
    c.out = float(c.x[0] or c.a)
    if c.x[0] > c.x[1] > 0.0 or not c.x.sum():
        c.n = 1


@equal
def zeros_at_bounds(c: Law) -> None:
    c.y = np.clip(c.x, 0.0, 1.0) + np.clip(c.x, c.y, 1.0) + np.maximum(c.i, c.x)
    c.x = np.where(c.x > c.y, np.minimum(c.x, c.a), np.maximum(c.y, c.b))


@equal
def extremes_of_bools(c: Law) -> None:
    c.flags = np.maximum(c.mask, c.x > 1.0)
    c.mask = np.minimum(c.mask, c.flags)


@equal
def rows_of_zeros(c: Law) -> None:
    c.x, c.y = np.zeros((2, 3))
    c.x = c.x + c.a


@equal
def an_array_after_it_was_given_another(c: Law) -> None:
    old = c.x
    c.x = c.x + 1.0
    c.y = old


@refused("float(...)")
def number_of_numpy_or_of_python(c: Law) -> None:
    limit = c.x[0] if c.i else c.a
    c.out = float(1.0 / limit)


@refused("float(...)")
def field_of_numpy_or_of_python(c: Law) -> None:
    c.out = c.x[0]
    c.other = float(1.0 / c.out)


@refused("one or more elements in Python")
def length_of_one_or_many(c: Law) -> None:
    values = np.ones(1) if c.a > 0 else c.x
    c.n = len(values)


@refused("one or more elements in Python")
def sum_of_one_or_many(c: Law) -> None:
    values = np.ones(1) if c.a > 0 else c.x
    c.out = float((values * 2.0).sum())


@refused("one or more elements in Python")
def loop_over_one_or_many(c: Law) -> None:
    values = np.ones(1) if c.a > 0 else c.x
    for each in values:
        c.out += float(each)


@equal
def a_part_is_looked_for(c: Law) -> None:
    for part in c.parts:
        if part.limit < c.a:
            continue
        c.out = part.limit
        if c.yes:
            continue
        c.n += 1
        break


@refused("on some branches it has no value")
def the_part_at_which_a_loop_was_left(c: Law) -> None:
    for part in c.parts:
        if part.limit > c.a:
            break
    c.out = part.limit


@refused("another object in the next turn")
def a_part_that_is_another_in_the_next_turn(c: Law) -> None:
    part = c.parts[0]
    for _ in range(c.i):
        c.out += part.limit
        part = c.parts[1]


@refused("another type")
def real_numbers_in_whole_ones(c: Law) -> None:
    c.whole[0] = c.a


@refused("may have another name")
def changed_by_a_function_that_is_called(c: Law) -> None:
    old = c.x
    raises_first(c)
    c.y = old


def raises_first(c: Law) -> None:
    c.x[0] = 1.0


def machine_of(work: Callable[[Any], None]) -> Any:
    class Machine(Compound):
        timer: DigitalSensor

        def setup(self) -> None:
            self.law = Law()

        def control(self) -> None:
            work(self.law)

    return Machine(timer=timer())


def translation_of(machine: Compound, folder: Path | None = None) -> Translation:
    wiring = {"drivers": {"clock": VirtualTimer()}, "wire": {"timer": {"driver": "clock", "period": "1 ms"}}}
    with laid_out(machine, wiring) as model:
        translation = translate(machine, model.conditions, model.steps, TARGETS["host"])
        if folder is not None:
            write_folder(files_of(model, translation, TARGETS["host"]), folder)
    return translation


def bits(value: Any) -> Any:
    """What is compared: all NaN are one."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list):
        return list(map(bits, value))
    return ("nan" if math.isnan(value) else struct.pack("d", value)) if isinstance(value, float) else value


@needs_a_compiler
@pytest.mark.full
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", EQUAL)
def test_it_is_what_python_does(name: str, tmp_path: Path) -> None:
    random, work = Random(name), EQUAL[name]
    machine = machine_of(work)
    translation = translation_of(machine, tmp_path)
    c = CompiledMachine(compiled(tmp_path, "-O0"), 0, 0)
    kinds = {each.number: each.kind for each in translation.faults} | {0: None}
    memory = next(c.struct(k, each) for k, each in enumerate(translation.structs) if each.path == "law")
    law = machine.law
    c.begin([])
    for _ in range(300):
        law.begin(random)
        memory.push()
        told = None
        try:
            work(law)
        except ERRORS as error:
            told = type(error).__name__
        assert kinds[c.step(1, [])] == told
        for field in memory.fields if told is None else ():
            assert (field, bits(memory.read(field))) == (field, bits(getattr(law, field)))


@pytest.mark.parametrize("name", REFUSED)
def test_what_would_differ_is_refused(name: str) -> None:
    work, reason = REFUSED[name]
    problems = translation_of(machine_of(work)).problems
    assert any(reason in str(each) for each in problems), problems

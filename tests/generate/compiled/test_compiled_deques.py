"""Deques of compiled laws: Python and C have the same elements whenever one of them is asked."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.compiling import CompiledRun
from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.machines import timer
from umo import Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.control import value_of
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler
LENGTH = 4


class Averaging(Compound):
    """It has the last levels, and the number of each; an interlock reads them, too."""

    timer: DigitalSensor
    level: DigitalSensor
    motor: DigitalActuator

    def setup(self) -> None:
        self.window: deque[float] = deque(maxlen=LENGTH)
        self.numbers: deque[int] = deque([0], maxlen=LENGTH)

    def control(self) -> None:
        self.window.append(value_of(self.level))
        self.numbers.append(self.numbers[-1] + len(self.window))
        if self.window[0] > 90.0:
            self.window.popleft()
            self.window.popleft()
        self.motor.write(max(self.window) / 10.0)

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: len(self.window) > 0 and self.window[0] == 7.0, [self.motor], reason="seven")


def averaging() -> Averaging:
    return Averaging(
        timer=timer(),
        level=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.5),
        motor=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
    )


def compiled(level: float = 20.0) -> CompiledRun:
    box = Fragile()
    box.set("level", round(level / 0.5))
    return CompiledRun(averaging(), box)


def test_others_read_the_elements_that_the_laws_have_left() -> None:
    with compiled() as run:
        run.box.set("level", 66)
        run.step()
        assert list(run.m.window) == [20.0, 20.0, 20.0, 33.0]
        assert [type(each) for each in run.m.numbers] == [int] * LENGTH and run.m.motor.pending == 3.3


def test_what_others_change_in_it_counts_in_the_same_period() -> None:
    with compiled() as run:
        before = run.m.window
        run.m.window.clear()
        run.m.window.extend([50.0, 60.0])
        run.step()
        assert run.m.window is before and list(before) == [50.0, 60.0, 20.0] and run.m.motor.pending == 6.0
        run.m.window[0] = 7.0
        run.step()
        assert run.m.motor.inhibited and run.laws.state == "compiled"


@pytest.mark.parametrize("value", [80, np.float64(80.0)])
def test_an_element_of_another_class_gives_the_laws_back_to_python(value: float) -> None:
    with compiled() as run:
        run.m.window[1] = value
        run.step()
        assert run.laws.state == "python" and "the deque window has an element of another class" in run.events
        assert list(run.m.window) == [80, 20.0, 20.0, 20.0] and run.m.window[0] is value and run.m.motor.pending == 8.0


def test_another_deque_in_its_place_gives_the_laws_back_to_python() -> None:
    with compiled() as run:
        run.m.window = deque([70.0], maxlen=LENGTH)
        run.step()
        assert run.laws.state == "python" and "window was set" in run.events
        assert list(run.m.window) == [70.0, 20.0]


def test_an_error_leaves_it_as_python_does() -> None:
    with compiled() as run:
        run.m.window.clear()
        run.box.set("level", 190)
        with pytest.raises(IndexError):
            run.step()
        assert list(run.m.window) == [] and run.laws.state == "compiled"


NUMBER = st.sampled_from([0.0, -0.0, 7.0, 12.5, 91.0, 99.5])
CHANGES = st.one_of(
    st.tuples(st.sampled_from(["append", "appendleft"]), NUMBER),
    st.tuples(st.sampled_from(["pop", "popleft", "clear", "reverse"])),
    st.tuples(st.just("rotate"), st.integers(-2, 2)),
    st.tuples(st.just("extend"), st.lists(NUMBER, max_size=6)),
    st.tuples(st.just("__setitem__"), st.integers(-LENGTH, LENGTH - 1), NUMBER),
)


@given(st.lists(st.tuples(NUMBER, st.lists(CHANGES, max_size=2)), max_size=8))
def test_it_is_that_of_python_whatever_others_change(periods: list[Any]) -> None:
    python, box = averaging(), Fragile()
    with compiled() as run, connect(python, wired(python, box, VirtualTimer())) as beside:
        box.set("level", 40)
        _step(beside, [])
        beside.window.extend([20.0] * LENGTH)
        beside.numbers.clear()
        beside.numbers.extend(run.m.numbers)
        for level, changes in periods:
            run.box.set("level", round(level / 0.5))
            box.set("level", round(level / 0.5))
            assert _step(run.m, changes) == _step(beside, changes)
        assert run.laws.state == "compiled"


def _step(m: Any, changes: list[Any]) -> list[str]:
    told = [*(_error_of(getattr(m.window, name), *given) for name, *given in changes)]
    m.timer.read()
    m.sample()
    told.append(_error_of(m.control))
    m.update()
    return [*told, repr(m.window), repr(m.numbers), repr(m.motor.pending), repr(m.motor.inhibited)]


def _error_of(call: Any, *given: Any) -> str:
    try:
        call(*given)
    except (IndexError, ValueError) as error:
        return type(error).__name__
    return ""

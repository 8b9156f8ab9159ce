"""Values that sequences set and read while C drives: each is as in Python, or the laws go back to Python."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from helpers.compiling import CompiledRun
from helpers.generating import needs_a_compiler
from helpers.machines import timer
from umo import Compound, DigitalActuator, DigitalSensor

pytestmark = needs_a_compiler


class Mixer(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    motor: DigitalActuator
    speed: float = 2.0
    either: float = 3
    manual: float | None = None

    def setup(self) -> None:
        self.weights = np.array([1.0, 2.0, 3.0])
        self.counts = np.array([1, 2, 3])
        self.marks = np.array([True, False, True])
        self.history = [3.0, 1.0, 2.0]
        self.pair = (1.0, 2.0)
        self.limited = 5
        self.periods = 0

    def control(self) -> None:
        self.periods += 1
        self.history[0] = float(self.periods)
        self.limited = min(95, max(4.5, self.limited))
        total = float(self.weights.sum()) + float(self.counts.sum()) + float(self.marks.sum()) + self.pair[0]
        own = min(total * 0.1 * self.speed + self.either, 10.0)
        self.motor.write(own if self.manual is None else self.manual)


class AskedMixer(Mixer):
    def setup(self) -> None:
        super().setup()
        self.asked: float | None = None

    def control(self) -> None:
        super().control()
        if self.asked is not None:
            self.motor.write(self.asked)


def run(kind: type[Mixer] = Mixer) -> CompiledRun:
    level = DigitalSensor("%", minimum=0.0, maximum=100.0, resolution=0.1)
    motor = DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01)
    return CompiledRun(kind(timer=timer(), level=level, motor=motor))


GIVEN = {
    "an array of one element": ("weights", np.array([30.0])),
    "whole numbers of one element": ("counts", np.array([30])),
    "bools of one element": ("marks", np.array([True])),
    "an array without a dimension": ("weights", np.array(30.0)),
    "bools for whole numbers": ("counts", np.array([True, True, True])),
    "a whole number for a real one": ("speed", -5),
    "a bool for a real number": ("speed", True),
    "a whole number in a tuple": ("pair", (1, 2.0)),
    "a whole number in a list": ("history", [1, 2.0, 3.0]),
    "a longer list": ("history", [1.0, 2.0, 3.0, 4.0]),
}


@pytest.mark.parametrize(("name", "value"), GIVEN.values(), ids=GIVEN)
def test_what_c_would_compute_otherwise_gives_the_laws_to_python(name: str, value: Any) -> None:
    value = copy.copy(value)
    with run() as compiled:
        setattr(compiled.m, name, value)
        compiled.step()
        assert compiled.laws.state == "python"
        assert f"Mixer.{name} is set to" in compiled.events
        assert getattr(compiled.m, name) is value


@pytest.mark.parametrize(("name", "value"), GIVEN.values(), ids=GIVEN)
def test_what_c_would_compute_otherwise_ends_the_comparison(name: str, value: Any) -> None:
    with run() as compiled:
        compiled.laws.give_up("a new comparison")
    setattr(compiled.m, name, copy.copy(value))
    memory = next(each for each in compiled.laws._memories if each.label == "Mixer")
    with pytest.raises(ValueError, match=f"Mixer.{name} is set to"):
        memory.push()


def test_a_whole_number_for_a_real_one_is_told_with_what_to_write() -> None:
    with run() as compiled:
        compiled.m.speed = 3
        assert "Mixer.speed is set to 3, where the laws have a real number; 3.0" in compiled.events


def test_a_number_of_two_classes_may_be_set_to_either_and_is_told() -> None:
    with run() as compiled:
        assert "numbers whose class varies in Python are read as one class: Mixer" in compiled.events
        for value in (0, -4, 2.5):
            compiled.m.either = value
            compiled.step()
            assert compiled.m.either == value
        assert compiled.laws.state == "compiled"


def test_none_that_the_class_annotates_as_a_number_or_none_is_set_to_both() -> None:
    with run() as compiled:
        for value in (4.0, None, 6.0):
            compiled.m.manual = value
            compiled.step()
            assert compiled.m.manual == value
            assert value is None or compiled.m.motor.pending == value
        assert compiled.laws.state == "compiled"


USES: dict[str, Callable[[Any], Any]] = {
    "list and list": lambda h: h + [1.0],  # noqa: RUF005
    "list before it": lambda h: [1.0] + h,  # noqa: RUF005
    "several times": lambda h: (h * 2, 2 * h),
    "json": json.dumps,
    "isinstance": lambda h: isinstance(h, list),
    "sorted": sorted,
    "equal": lambda h: (h == [*h], [*h] == h, h != [1.0], h < [1e9]),
    "search": lambda h: (h.index(2.0), h.count(1.0), 2.0 in h, len(h), h[-1], h[1:]),
    "text": lambda h: f"{h} {h!r}",
    "copies": lambda h: [type(each(h)) for each in (copy.copy, copy.deepcopy, list.copy, lambda x: x.copy())],
    "pickle": lambda h: pickle.loads(pickle.dumps(h)),
    "array": lambda h: np.array(h).tolist(),
    "backwards": lambda h: [*reversed(h)],
    "first and others": lambda h: (lambda first, *others: (first, others))(*h),
}


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_a_list_is_used_as_any_list_also_periods_after_it_was_read(use: Callable[[Any], Any]) -> None:
    with run() as compiled:
        held = compiled.m.history
        compiled.step(3)
        now = [float(compiled.m.periods), 1.0, 2.0]
        assert repr(use(held)) == repr(use(compiled.m.history)) == repr(use(now))
        assert compiled.laws.state == "compiled"


CHANGES: dict[str, Callable[[Any], Any]] = {
    "an element": lambda h: h.__setitem__(1, 7.0),
    "a slice": lambda h: h.__setitem__(slice(1, 3), [7.0, 8.0]),
    "sort": lambda h: h.sort(reverse=True),
    "reverse": lambda h: h.reverse(),
    "taken and put": lambda h: h.__setitem__(slice(None), [*h[1:], 9.0]),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_list_that_keeps_its_length_is_changed_for_the_laws_too(change: Callable[[Any], Any]) -> None:
    with run() as compiled:
        expected = [*compiled.m.history]
        change(compiled.m.history)
        change(expected)
        assert compiled.m.history == expected
        compiled.step()
        assert compiled.m.history == [float(compiled.m.periods), *expected[1:]]
        assert compiled.laws.state == "compiled"


LONGER: dict[str, Callable[[Any], Any]] = {
    "append": lambda h: h.append(4.0),
    "pop": lambda h: h.pop(),
    "clear": lambda h: h.clear(),
    "extend": lambda h: h.extend([1.0]),
    "a whole number": lambda h: h.__setitem__(1, 7),
}


@pytest.mark.parametrize("change", LONGER.values(), ids=LONGER)
def test_another_length_or_class_gives_the_list_to_python(change: Callable[[Any], Any]) -> None:
    with run() as compiled:
        held, expected = compiled.m.history, [*compiled.m.history]
        change(held)
        change(expected)
        assert compiled.laws.state == "python"
        assert held == compiled.m.history == expected
        assert type(compiled.m.history) is list


def test_an_error_of_a_change_leaves_the_list_as_it_was() -> None:
    with run() as compiled:
        with pytest.raises(ValueError, match="not in list"):
            compiled.m.history.remove(99.0)
        assert compiled.laws.state == "compiled"


def test_whole_numbers_of_an_array_have_64_bits_as_in_numpy() -> None:
    with run() as compiled:
        found = compiled.m.counts
        assert found.dtype == np.int64 and (found * 2_000_000_000).tolist() == [
            2_000_000_000,
            4_000_000_000,
            6_000_000_000,
        ]
        compiled.m.counts = np.array([4, 5, 6])
        compiled.step()
        assert compiled.m.counts.dtype == np.int64 and compiled.laws.state == "compiled"
        compiled.m.pair = (1, 2.0)
        compiled.step()
        compiled.m.counts[0] = 7
        assert compiled.laws.state == "python" and compiled.m.counts.tolist() == [7, 5, 6]


def test_what_setup_declares_to_be_none_may_be_set() -> None:
    with run(AskedMixer) as compiled:
        compiled.m.asked = 4.5
        compiled.step(2)
        assert compiled.laws.state == "compiled" and compiled.m.motor.read() == 4.5
        compiled.m.asked = None
        compiled.step(2)
        assert compiled.laws.state == "compiled" and compiled.m.motor.read() != 4.5

"""What a public function is given by mistake is refused in one sentence; what is empty has a meaning, or none."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import umo
from helpers.cycling import Cycle
from helpers.machines import actuator, bench, sensor, timer
from helpers.slide import servo
from umo import Compound, DigitalActuator, DigitalSensor, Interlock, Number, Polynomial, Range, Thermocouple, Vector
from umo.control import PID, Profile, first, move_together, state_of, timeout, together, unless, until, value_of, wait
from umo.errors import DeclarationError, UmoError

WRONG: dict[str, Any] = {
    "None": None,
    "True": True,
    "text": "x",
    "empty text": "",
    "nan": float("nan"),
    "infinite": float("inf"),
    "below 0": -1,
    "empty list": [],
    "too large": 10**309,
    "object": object(),
    "array": np.array([1.0, 2.0]),
    "bytes": b"1 s",
    "complex": 1j,
}
PYTHONS = re.compile(
    r"has no attribute|not iterable|not callable|unpack|has no len|unhashable|expected str|ambiguous|an empty sequence"
    r"|bytes-like|to convert to float|argument should be|integer string conversion"
)
"""What Python says where nobody has looked at an argument."""


class Small(Compound):
    timer: DigitalSensor
    motor: DigitalActuator


def small() -> Small:
    return Small(timer=timer(), motor=actuator())


def in_a_sequence(call: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """The function as a sequence awaits it."""

    def tried(given: Any) -> Any:
        with Cycle() as cycle:
            task = cycle.start(_awaiting(call, given))
            cycle.steps(8)
            assert task.done
            return task.result

    return tried


async def _awaiting(call: Callable[[Any], Any], given: Any) -> Any:
    return await call(given)


async def within(given: Any) -> None:
    async with timeout(given):
        pass


def started(given: Any) -> None:
    with Cycle() as cycle:
        cycle.m.cycle.start(given)


def digital(name: str) -> Callable[[Any], Any]:
    fitting = {"default": 0, "minimum": -10, "maximum": 10, "resolution": 0.01}
    return lambda given: DigitalActuator(**{"units": "V", **fitting, name: given})


FUNCTIONS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "wait": (in_a_sequence(wait), ""),
    "timeout": (in_a_sequence(within), ""),
    "until": (in_a_sequence(until), ""),
    "until, timeout": (in_a_sequence(lambda given: until(lambda: True, given)), "None"),
    "until, stays": (in_a_sequence(lambda given: until(lambda: True, 1.0, stays=given)), ""),
    "together": (in_a_sequence(together), ""),
    "first": (in_a_sequence(first), ""),
    "unless": (in_a_sequence(lambda given: unless(lambda: False, given)), ""),
    "unless, condition": (in_a_sequence(lambda given: unless(given, wait(0))), ""),
    "move_together": (in_a_sequence(move_together), ""),
    "cycle.start": (started, ""),
    "run": (umo.run, ""),
    "run, wiring": (lambda given: umo.run(small(), given, lambda m: wait(0)), "None"),
    "run, application": (lambda given: umo.run(small(), None, 5 if given is None else given), ""),
    "run, observers": (
        lambda given: umo.run(small(), None, lambda m: wait(0), observers=given),
        "empty list, empty text",
    ),
    "connect": (lambda given: umo.connect(given).__enter__(), ""),
    "drive": (umo.drive, ""),
    "check": (umo.check, ""),
    "Vector": (Vector, ""),
    "value_of": (value_of, ""),
    "state_of": (state_of, ""),
    "action": (umo.action, "None"),
    "PID, gain": (lambda given: PID(gain=given), "below 0"),
    "Profile, velocity": (lambda given: Profile(velocity=given, acceleration=1.0, jerk=1.0), "infinite"),
    "Range, minimum": (lambda given: Range("V", given, 5), "below 0"),
    "Range, unit": (lambda given: Range(given, 0, 1), "empty text"),
    "Number, minimum": (lambda given: Number("V", given, 5), "below 0"),
    "Polynomial": (Polynomial, "array, bytes"),
    "Thermocouple": (Thermocouple, ""),
    "Interlock, condition": (lambda given: Interlock(given, [actuator()], "why"), ""),
    "Interlock, objects": (lambda given: Interlock(lambda: True, given, "why"), ""),
    "Interlock, reason": (lambda given: Interlock(lambda: True, [actuator()], given), "text"),
    "DigitalActuator, units": (digital("units"), "empty text"),
    "DigitalActuator, default": (digital("default"), "below 0"),
    "DigitalActuator, minimum": (digital("minimum"), "below 0"),
    "DigitalActuator, maximum": (digital("maximum"), ""),
    "DigitalActuator, resolution": (digital("resolution"), "below 0"),
    "DigitalActuator, zero_offset": (digital("zero_offset"), "below 0"),
    "DigitalActuator, synchronous": (digital("synchronous"), "True"),
    "DigitalActuator, slew_rate": (digital("slew_rate"), "None"),
    "DigitalActuator, expires": (digital("expires"), "None"),
}
"""Each function of one argument, and the names of those among `WRONG` that have a meaning for it."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_given_by_mistake_is_refused_in_one_sentence(name: str) -> None:
    function, allowed = FUNCTIONS[name]
    for kind, given in WRONG.items():
        if kind in allowed.split(", "):
            function(given)
            continue
        with pytest.raises((UmoError, TypeError, ValueError)) as caught:
            function(given)
        text = str(caught.value).removesuffix("\nat 0.001 s")
        assert not PYTHONS.search(text), f"{name}({kind}): {text}"
        assert len(text) < 600, f"{name}({kind}): {text}"


def test_nothing_in_parallel_ends_at_once_and_the_first_of_nothing_is_an_error() -> None:
    async def main(m: Any) -> tuple[Any, Any]:
        await move_together()
        return await together(), m.now

    assert umo.run(small(), None, main)[0] == ()
    with pytest.raises(TypeError, match="needs at least one sequence"):
        in_a_sequence(lambda given: first())(None)
    with pytest.raises(DeclarationError, match="at least one object"):
        Vector([])


def test_axes_that_are_to_move_together_are_looked_at_before_one_moves() -> None:
    axis = servo()
    for moves, message in (
        ([(axis, 1.0), (axis, 2.0)], "twice"),
        ([(axis,)], r"pairs such as `\(axis, 80\.0\)`, not \(<"),
        ([axis], "pairs such as"),
        ([(1.0, axis)], "pairs such as"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            in_a_sequence(lambda given: move_together(*given))(moves)
    assert not axis.enabled


def test_what_stays_true_for_longer_than_the_time_limit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"cannot stay true for 0\.02 s within 0\.01 s"):
        in_a_sequence(lambda given: until(lambda: True, "10 ms", stays="20 ms"))(None)


@pytest.mark.parametrize("wrong", [1, 0, 1.0, np.bool_(True), np.array([True]), "Manual"])
def test_equipment_is_true_false_or_manual(wrong: Any) -> None:
    """1 was taken, and was no equipment for the states of a part."""
    with pytest.raises(DeclarationError, match='equipment is True, False or "manual"'):
        type("Cell", (Compound,), {}, equipment=wrong)


@pytest.mark.parametrize("wrong", [["hold"], 1, {}, np.array(["hold"])])
def test_a_reaction_is_one_of_three_texts(wrong: Any) -> None:
    with pytest.raises(DeclarationError, match="when_suspended is"):
        type("Cell", (Compound,), {}, when_suspended=wrong)


def test_a_machine_that_was_not_made_is_told_from_one_that_was() -> None:
    with pytest.raises(
        DeclarationError, match=r"run\(\) takes a machine, a Compound, not <class .*; call it: run\(Small"
    ):
        umo.run(Small)  # type: ignore[type-var]
    with pytest.raises(DeclarationError, match=r"connect\(\) takes a machine, a Compound, not <function small"):
        umo.connect(small)  # type: ignore[type-var]
    assert bench() is not None
    assert sensor() is not None

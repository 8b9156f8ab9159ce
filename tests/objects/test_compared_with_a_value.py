"""A state that is compared with a state of another type, a number or a text, and an object that is compared with a
value, raise, with what to write instead (docs/decisions/0083)."""

from __future__ import annotations

from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest

from helpers.machines import bench
from umo import Vector
from umo.objects import Quality
from umo.states import OnOff, OpenClosed, PassFail, TwoState


class Lamp(TwoState):
    ON = "on"
    OFF = "off"


OTHERS = [1, 0, True, 1.0, 1j, "on", "ON", "open", b"on", Lamp.ON, PassFail.PASS, Quality.GOOD, np.float64(1), np.True_]


def _in(one: Any, other: Any) -> None:
    assert one in [other]


def _match(one: Any, other: Any) -> None:
    class Given:
        value = other

    match one:
        case Given.value:
            pass


COMPARED = {
    "==": lambda one, other: one == other,
    "!=": lambda one, other: one != other,
    "the other way": lambda one, other: other == one,
    "in": _in,
    "match": _match,
    "<": lambda one, other: one < other,
    ">=": lambda one, other: other >= one,
}


@pytest.mark.parametrize("other", OTHERS, ids=repr)
@pytest.mark.parametrize("way", COMPARED)
def test_a_state_is_not_compared_with_anything_else(way: str, other: Any) -> None:
    with pytest.raises(TypeError, match=r"compare it: .*`is OnOff\.ON`"):
        COMPARED[way](OnOff.ON, other)


@pytest.mark.parametrize(
    ("other", "meant"),
    [
        ("open", "`is OpenClosed.OPEN`"),
        ("CLOSED", "`is OpenClosed.CLOSED`"),
        (1, "`is OpenClosed.OPEN` or `is OpenClosed.CLOSED`"),
        (PassFail.FAIL, "`is OpenClosed.OPEN` or `is OpenClosed.CLOSED`, or `is PassFail.PASS` or `is PassFail.FAIL`"),
    ],
)
def test_the_nearest_comparison_is_named(other: Any, meant: str) -> None:
    with pytest.raises(TypeError) as raised:
        COMPARED["=="](OpenClosed.OPEN, other)
    assert str(raised.value).endswith(f"is never equal to {_shown(other)}; compare it: {meant}")


def _shown(other: Any) -> str:
    return f"{type(other).__name__}.{other.name}" if isinstance(other, TwoState) else repr(other)


def test_states_of_one_type_are_compared_and_a_state_with_none() -> None:
    nothing: Any = None
    assert OnOff.ON == OnOff.ON
    assert OnOff.ON != OnOff.OFF
    assert nothing != OnOff.ON
    assert nothing != OnOff.ON
    assert OnOff.ON not in (None, OnOff.OFF)
    assert OnOff.ON == ANY
    match OnOff.ON:
        case OnOff.OFF:
            raise AssertionError
        case OnOff.ON:
            pass


def test_states_are_keys_beside_others_of_the_same_name() -> None:
    colours: dict[Any, str] = {OnOff.ON: "green", Lamp.ON: "yellow", "ON": "text"}
    assert [colours[OnOff.ON], colours[Lamp.ON], colours["ON"]] == ["green", "yellow", "text"]
    assert len({OnOff.ON, Lamp.ON, "ON", OnOff.ON}) == 3


OBJECTS = {
    "valve": "`valve.read() is OnOff.ON`",
    "limit": "`limit.read() is PassFail.",
    "motor": "`motor.read() == ",
    "encoder": "`encoder.read() == ",
}


@pytest.mark.parametrize("path", OBJECTS)
@pytest.mark.parametrize("other", [1, 2.5, "on", OnOff.ON, np.float64(3)], ids=repr)
def test_an_object_is_not_compared_in_place_of_its_value(path: str, other: Any) -> None:
    item: Any = getattr(bench(), path)
    for compare in (lambda: item == other, lambda: item != other, lambda: other == item, lambda: item in [other]):
        with pytest.raises(TypeError) as raised:
            compare()
        assert f"`{path} == " in str(raised.value)
        assert f"compares an object, not a value; write {OBJECTS[path]}" in str(raised.value)


@pytest.mark.parametrize(
    ("compare", "text"),
    [
        (lambda m: m.encoder > 3, "write `encoder.read() > 3`"),
        (lambda m: m.encoder > 3, "write `encoder.read() > 3`"),
        (lambda m: m.encoder <= 2.5, "write `encoder.read() <= 2.5`"),
        (lambda m: m.motor == PassFail.PASS, "write `motor.read() == ...`"),
        (lambda m: m.valve == 0, "write `valve.read() is OnOff.OFF`"),
        (lambda m: m.valve > 0, "write `valve.read() is OnOff.OFF`"),
        (lambda m: m > 3, "a Bench has no value: compare the value of an object in it (timer, motor and 3 others)"),
        (lambda m: sorted([m.motor, m.encoder]), "compares an object, not a value"),
    ],
)
def test_an_order_of_objects_too(compare: Any, text: str) -> None:
    with pytest.raises(TypeError) as raised:
        compare(bench())
    assert text in str(raised.value)


def test_an_object_is_equal_to_itself_only_and_can_be_a_key() -> None:
    m, other = bench(), bench()
    assert m.valve == m.valve
    assert m.valve != other.valve
    assert m.valve is not None and m.valve != None  # noqa: E711
    assert m.valve in [other.valve, m.valve]
    assert {m.valve: 1, other.valve: 2}[m.valve] == 1
    assert m == ANY


@pytest.mark.parametrize("other", [1.0, OnOff.ON, "on"])
def test_nor_is_a_vector_compared_in_place_of_its_values(other: Any) -> None:
    vector: Any = Vector([bench().valve])
    with pytest.raises(TypeError, match=r"compares a Vector, not its values; write `vector\.read\(\) =="):
        assert vector == other
    assert vector != Vector([bench().valve])
    assert vector == vector

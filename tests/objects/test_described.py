"""What a value means is told once, from an object and from the plain data of frames and recordings alike."""

from __future__ import annotations

import json
from math import nan
from typing import Any

import pytest

from helpers.machines import bench, wired
from umo import BinaryActuator, BinarySensor, DigitalActuator, DigitalSensor, Polynomial, connect
from umo.errors import RangeError, StateError
from umo.objects import Atomic, described
from umo.objects.presentation.described import Described
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer
from umo_command.device.get_set import _remark

SPAN: Any = {"minimum": 0.0, "maximum": 10.0, "resolution": 0.5}
OBJECTS: dict[str, Atomic] = {
    "valve": BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF, when_suspended="hold"),
    "limit": BinarySensor(PassFail, one=PassFail.FAIL),
    "heater": DigitalActuator("V", default=2.0, expires="50 ms", **SPAN),
    "level": DigitalSensor("mm", **SPAN),
    "probe": DigitalSensor("degC", minimum=0.0, maximum=10.0, resolution=0.5, linearization=Polynomial([0.0, 1.0])),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_plain_data_that_has_been_json_means_the_same_as_the_object(name: str) -> None:
    mine = described(OBJECTS[name])
    read = Described(json.loads(json.dumps(mine.plain)))
    for what in (name for name in dir(Described) if not name.startswith("_")):
        if not callable(getattr(mine, what)):
            assert getattr(read, what) == getattr(mine, what), what
    assert (read.is_object, read.kind) == (True, type(OBJECTS[name]).__name__)


@pytest.mark.parametrize(
    ("name", "given", "number", "text"),
    [
        ("valve", "ON", 1.0, "ON"),
        ("limit", "PASS", 0.0, "PASS"),
        ("heater", 2.5, 2.5, "2.5 V"),
        ("level", 3, 3.0, "3.0 mm"),
        ("probe", 1.5, 1.5, "1.5 °C"),
    ],
)
def test_a_value_as_plain_data_has_its_number_and_its_text(name: str, given: Any, number: float, text: str) -> None:
    assert OBJECTS[name]._from_plain(given) == number
    assert described(OBJECTS[name]).text(number) == text
    assert described(OBJECTS[name]).value(number) == (number if described(OBJECTS[name]).is_number else given)


@pytest.mark.parametrize(
    ("name", "given", "error"),
    [
        ("valve", "NO", StateError),
        ("valve", 1, StateError),
        ("limit", True, StateError),
        ("heater", 10.5, RangeError),
        ("heater", "2", RangeError),
        ("level", nan, RangeError),
    ],
)
def test_what_is_no_value_of_an_object_is_refused(name: str, given: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        OBJECTS[name]._from_plain(given)


def test_a_default_is_a_number_and_a_text() -> None:
    valve, heater, level = (described(OBJECTS[name]) for name in ("valve", "heater", "level"))
    assert (valve.default, valve.default_text) == (0.0, "OFF")
    assert (heater.default, heater.default_text) == (2.0, "2 V")
    assert (level.default, level.default_text) == (None, "")
    assert (valve.is_held, heater.is_held, heater.expires) == (True, False, 0.05)


STATES = [
    ({"one": "ON", "zero": "OFF"}, {0: "OFF", 1: "ON"}),
    ({"states": {"7": "filling", "-1": "no commands"}}, {7: "filling", -1: "no commands"}),
    ({"states": ["normal", "fault"]}, {0: "normal", 1: "fault"}),
    ({"unit": "mm"}, {}),
]


@pytest.mark.parametrize(("plain", "states"), STATES)
def test_states_have_their_numbers_in_every_form(plain: dict[str, Any], states: dict[int, str]) -> None:
    value = Described(plain)
    assert (value.states, value.is_number) == (states, not states)
    assert [value.number_of(name) for name in states.values()] == [float(number) for number in states]
    assert value.number_of("none of these") is None


def test_a_value_without_a_name_and_one_that_was_not_read_are_told_as_they_are() -> None:
    named = Described({"states": {"7": "filling"}})
    assert (named.value(7.0), named.value(8.0), named.text(nan)) == ("filling", "8", "-")
    assert str(named.value(nan)) == str(Described({"one": "ON", "zero": "OFF"}).value(nan)) == "nan"


def test_the_heading_of_a_column_tells_the_unit_or_the_numbers_of_its_states() -> None:
    step = Described({"path": "mixer.step", "states": {"0": "FILL", "4": "STIR"}})
    headings = [each.heading for each in (described(OBJECTS["level"]), described(OBJECTS["limit"]), step)]
    assert headings == ["[mm]", "[FAIL=1]", "mixer.step[FILL=0 STIR=4]"]


def test_a_state_that_is_not_confirmed_yet_is_told_as_one() -> None:
    m = bench()
    with connect(m, wired(m, Scripted(), clock=VirtualTimer())):
        m.valve.write(OnOff.ON)
        assert _remark(m.valve, True) == "  (on its way to ON: its device has not confirmed it yet)"

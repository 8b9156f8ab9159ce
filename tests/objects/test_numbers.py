"""The numbers of a machine: one declaration, one table, for the wiring, for tuning and for what is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite
from operator import attrgetter
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, sensor, stations, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, Number, Range, check, connect
from umo.control import PID, Servo
from umo.errors import DeclarationError, RangeError, UmoError
from umo.objects import numbers_of
from umo.states import TwoState, UpDown
from umo.testing import Scripted


class Shape(Enum):
    ROUND = "round"
    FLAT = "flat"


@dataclass
class Blend:
    share: Annotated[float, Number("", 0.0, 1.0, tunable=True)] = 0.5
    steps: int = 4


@dataclass(frozen=True)
class Fixed:
    share: float = 0.5


class Mill(
    Compound,
    numbers={
        "servo.gain": Number("V/mm", 0.0, 3.0, tunable=True),
        "laws.1.gain": Number("", 0.0, 2.0),
        "load": Number("N", shown=True),
        "feed": Number("mm/s", 0.0, 50.0, tunable=True, shown=True),
        "turns": Number("", 0.0, inf, tunable=True),
        "note": Number(),
    },
):
    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor
    gain: Annotated[float, Range("V/mm", 0.0, 3.0)] = 0.3
    speed: float = 5
    teeth: Annotated[int, Number("", 1, 99, kept=True)] = 12
    label: str = "a"
    cooled: bool = False
    shape: Annotated[Shape, Number(kept=True)] = Shape.ROUND
    limit: float | None = None
    either: int | float = 3

    def setup(self) -> None:
        self.servo = Servo(self.encoder, self.motor, gain=self.gain)
        self.laws = [PID(gain=1.0), PID(gain=1.5)]
        self.named = {"blend": Blend()}
        self.fixed = Fixed()
        self.turns = 2
        self.note = "x"
        self._feed = 1.0

    @property
    def load(self) -> float:
        return self.motor.read() * 2.0

    @property
    def feed(self) -> float:
        return self._feed

    @feed.setter
    def feed(self, feed: float) -> None:
        self._feed = feed


def mill(kind: type[Mill] = Mill, **changes: Any) -> Mill:
    return kind(timer=timer(), motor=actuator(), encoder=sensor(), **changes)


def wiring(m: Compound, **parameters: Any) -> dict[str, Any]:
    return wired(m, Scripted()) | {"parameters": {key.replace("__", "."): each for key, each in parameters.items()}}


def faults(**parameters: Any) -> list[str]:
    m = mill()
    return [f"{fault.key}: {fault.message}" for fault in check(m, wiring(m, **parameters))]


def test_a_machine_has_one_table_of_its_numbers() -> None:
    found = numbers_of(mill())
    assert list(found) == [
        "servo.gain", "laws.1.gain", "load", "feed", "turns", "note",
        "gain", "speed", "teeth", "label", "cooled", "shape", "either",
        "servo.setpoint", "servo.error", "servo.integral_time", "servo.derivative_time", "servo.filter_time",
        "servo.feed_forward", "servo.inertia", "servo.friction", "servo.limit",
        "laws.0.setpoint", "laws.0.error", "laws.0.integral_time", "laws.0.derivative_time", "laws.0.filter_time",
        "laws.0.gain", "laws.1.setpoint", "laws.1.error", "laws.1.integral_time", "laws.1.derivative_time",
        "laws.1.filter_time", "named.blend.share", "named.blend.steps",
    ]  # fmt: skip
    kinds = {path: each.kind for path, each in found.items()}
    assert [kinds[name] for name in ("speed", "teeth", "label", "cooled", "shape", "either", "feed", "turns")] == [
        float, int, str, bool, Shape, None, float, None,
    ]  # fmt: skip
    assert found["gain"].declared == Number("V/mm", 0.0, 3.0)
    assert [path for path, each in found.items() if each.declared.tunable] == [
        "servo.gain", "feed", "turns", "named.blend.share",
    ]  # fmt: skip
    assert [path for path, each in found.items() if each.declared.kept] == ["teeth", "shape"]
    assert {path for path, each in found.items() if not each.settable} == {
        "load", "servo.setpoint", "servo.error", "laws.0.setpoint", "laws.0.error", "laws.1.setpoint", "laws.1.error",
    }  # fmt: skip


def test_a_wiring_sets_numbers_of_every_type() -> None:
    m = mill()
    before = (m.speed, m.teeth, m.label, m.cooled, m.shape, m.feed, m.turns, m.note, m.named["blend"].share)
    given = {"speed": 7, "teeth": 20, "label": "b", "cooled": True, "shape": "FLAT", "feed": 4, "turns": 2**60 + 1}
    parameters = wiring(m, **given, note="y", named__blend__share=0.25, laws__0__gain=2.5, laws__1__gain=1.75, gain=1.0)
    assert check(m, parameters) == []
    assert (m.gain, m.servo.gain) == (0.3, 0.3)  # tried, and taken back
    with connect(m, parameters):
        after = (m.speed, m.teeth, m.label, m.cooled, m.shape, m.feed, m.turns, m.note, m.named["blend"].share)
        assert after == (7.0, 20, "b", True, Shape.FLAT, 4.0, 2**60 + 1, "y", 0.25)
        assert [type(each) for each in after[:2]] == [float, int]
        assert ([law.gain for law in m.laws], m.servo.gain) == ([2.5, 1.75], 1.0)
    assert (m.speed, m.teeth, m.label, m.cooled, m.shape, m.feed, m.turns, m.note, m.named["blend"].share) == before


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("gain", 3.5, "3.5 V/mm is outside 0 to 3"),
        ("gain", "high", "'high' is not a number in V/mm"),
        ("speed", True, "True is not a number"),
        ("speed", inf, "inf is not a number"),
        ("teeth", 2.5, "2.5 is not a whole number"),
        ("teeth", 0, "0 is outside 1 to 99"),
        ("label", 3, "3 is not a string"),
        ("cooled", "on", "'on' is not true or false"),
        ("cooled", 1, "1 is not true or false"),
        ("shape", "FLATT", "'FLATT' is not one of ROUND, FLAT (did you mean 'FLAT'?)"),
        ("shape", 1, "1 is not one of ROUND, FLAT"),
        ("load", 1.0, "there is no such parameter"),
        ("servo.error", 1.0, "there is no such parameter (did you mean 'servo."),
        ("limit", 1.0, "there is no such parameter"),
        ("fixed.share", 1.0, "there is no such parameter"),
        ("servo.gain", 3.5, "the wiring's parameter servo.gain: 3.5 V/mm is outside 0 to 3"),
        ("servo.gain", "on", "'on' is not a number"),
        ("feed", 51.0, "the wiring's parameter feed: 51 mm/s is outside 0 to 50"),
        ("laws.1.gain", 2.5, "the wiring's parameter laws.1.gain: 2.5 is outside 0 to 2"),
        ("servo.integral_time", 0, "Servo.integral_time must be above 0, not 0.0"),
        ("servo.derivative_time", -1.0, "the wiring's parameter servo.derivative_time: -1 s is below 0"),
    ],
)
def test_check_refuses_a_parameter_out_of_its_range_or_of_another_type(name: str, value: Any, said: str) -> None:
    found = faults(**{name: value})
    assert len(found) == 1
    assert said in found[0]
    m = mill()
    with pytest.raises(UmoError), connect(m, wiring(m, **{name: value})):
        pytest.fail("it was connected")


def test_a_range_that_depends_on_a_field_is_that_of_the_field_as_wired() -> None:
    class Wide(Mill, numbers=lambda mill: {"servo.gain": Number("V/mm", 0.0, 2 * mill.gain)}):
        pass

    m = mill(Wide)
    assert check(m, wiring(m, gain=2.0, servo__gain=3.9)) == []
    assert "outside 0 to 0.6" in check(m, wiring(m, servo__gain=3.9))[0].message
    assert (m.gain, m.servo.gain, m._parametrised) == (0.3, 0.3, False)


def test_check_of_a_connected_machine_changes_nothing_of_it() -> None:
    m = mill()
    with connect(m, wiring(m)):
        servo = m.servo
        assert check(m, wiring(m, gain=2.0)) == []
        assert m.servo is servo


@given(st.integers(-(2**80), 2**80))
def test_a_tuned_integer_stays_one_of_any_size(number: int) -> None:
    turns = numbers_of(mill())["turns"]
    if number < 0:
        with pytest.raises(RangeError, match=r"turns: .* is below 0"):
            turns.set(number)
    else:
        turns.set(number)
        assert turns.value == number
        assert type(turns.value) is int


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"servo.gian": Number()}, "number servo.gian: Servo has no attribute 'gian' (did you mean 'gain'?)"),
        ({"laws.2.gain": Number()}, "number laws.2.gain: list has no attribute '2'"),
        ({"load": Number("N", tunable=True)}, "number load: the property load cannot be set; it can be shown"),
        ({"label": Number(tunable=True)}, "number label: 'a' is not a number; only numbers are tuned"),
        ({"cooled": Number(tunable=True)}, "number cooled: False is not a number; only numbers are tuned"),
        ({"label": Number(shown=True)}, "number label: 'a' is a string; only numbers and Enums are shown"),
        ({"servo": Number()}, "number servo: Servo("),
        ({"gain": "V/mm"}, "number gain: 'V/mm' is not a Number"),
        (lambda m: 3, "numbers of Wrong: must be a mapping of names to Numbers, not 3"),
        (lambda m: {"gain": Number("furlong/x")}, "numbers of Wrong: 'furlong/x' is not a unit"),
    ],
)
def test_a_declaration_of_numbers_that_fits_nothing_is_refused(declared: Any, said: str) -> None:
    class Wrong(Mill, numbers=declared):
        @property
        def load(self) -> float:
            return 1.0

    with pytest.raises(DeclarationError) as caught:
        numbers_of(mill(Wrong))
    assert said in str(caught.value)


def test_what_is_called_numbers_and_declares_none_is_let_alone() -> None:
    class Table:
        numbers: Mapping[str, int] = {"a": 1}

    class Other(Mill):
        def setup(self) -> None:
            super().setup()
            self.table, self.lines = Table(), [[1.0, 2.0]]

    assert list(numbers_of(mill(Other))) == list(numbers_of(mill()))


def test_an_annotation_with_a_range_that_cannot_be_evaluated_is_refused() -> None:
    unit = "mm"

    class Local(Mill):
        depth: Annotated[float, Number(unit, 0.0, 1.0)] = 0.5

    with pytest.raises(DeclarationError, match=r"number depth: its annotation .* cannot be evaluated"):
        numbers_of(mill(Local))


@pytest.mark.parametrize("name", stations())
def test_every_number_of_a_station_that_ships_can_be_read_and_has_its_own_value_as_a_parameter(name: str) -> None:
    m = stations()[name]()
    for number in numbers_of(m).values():
        given = number.value
        if number.settable and (not isinstance(given, float) or isfinite(given)):
            value = getattr(given, "name", given)
            assert number.checked(value) == number.value, number.path


def test_a_number_in_a_list_or_dict_is_none_of_its_attributes() -> None:
    class Oven(Compound, numbers={"gains.0": Number("V", 0.0, 3.0, tunable=True)}):
        motor: DigitalActuator

        def setup(self) -> None:
            self.gains = [1.0]

    with pytest.raises(DeclarationError, match=r"number gains\.0: list has no attribute '0'"):
        numbers_of(Oven(motor=actuator()))


def test_a_property_without_annotations_is_a_number_too() -> None:
    class Oven(Compound, numbers={"gain": Number("", 0.0, 3.0, tunable=True)}):
        motor: DigitalActuator
        gain = property(attrgetter("_gain"), lambda self, value: setattr(self, "_gain", value))

        def setup(self) -> None:
            self._gain = 1.0

    oven = Oven(motor=actuator())
    numbers_of(oven)["gain"].set(2.0)
    assert oven.gain == 2.0


def test_a_law_with_a_field_that_cannot_be_read_is_no_reason_not_to_connect() -> None:
    @dataclass
    class Law:
        share: float = 0.5

        def __getattribute__(self, name: str) -> Any:
            return 1 / 0 if name == "share" else object.__getattribute__(self, name)

    class Oven(Compound):
        motor: DigitalActuator

        def setup(self) -> None:
            self.law = Law()

    assert numbers_of(Oven(motor=actuator())) == {}


def test_a_value_that_is_not_in_its_declared_range_is_refused_where_it_is_declared() -> None:
    class Filler(Compound):
        volume: Annotated[float, Number("ml", 50.0, 950.0, tunable=True)] = 5000.0

    with pytest.raises(DeclarationError, match=r"number volume: 5000 ml is outside 50 to 950"):
        numbers_of(Filler())


def test_a_value_of_another_type_than_its_annotation_is_refused() -> None:
    class Filler(Compound):
        volume: Annotated[float, Number("ml", 50.0, 950.0)] = "5"  # type: ignore[assignment]

    with pytest.raises(DeclarationError, match=r"number volume: '5' is not a number in ml"):
        numbers_of(Filler())


def test_a_field_that_is_annotated_with_the_base_of_enums_has_the_type_of_its_value() -> None:
    class Gate(Compound):
        idle: TwoState = UpDown.DOWN

    (number,) = numbers_of(Gate()).values()
    assert number.checked("UP") is UpDown.UP

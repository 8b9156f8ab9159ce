"""The settings of a compound's class: class keywords, inherited, and refused where they would have no effect."""

from __future__ import annotations

from enum import Enum
from typing import Any, ClassVar

import pytest

from helpers.machines import actuator, relay
from umo import BinaryActuator, Compound, DigitalActuator, Range
from umo.errors import DeclarationError, PathError
from umo.objects.stop_order import stop_sequence
from umo.states import OnOff


@pytest.mark.parametrize(
    ("keyword", "near"),
    [
        ("stop_ordr", " (did you mean 'stop_order'?)"),
        ("stopping", " (did you mean 'stop_order'?)"),
        ("longest_period", " (did you mean 'max_period'?)"),
        ("colour", ""),
    ],
)
def test_a_keyword_that_there_is_not_is_refused_with_the_nearest(keyword: str, near: str) -> None:
    with pytest.raises(DeclarationError) as caught:
        type("Press", (Compound,), {}, **{keyword: ("motor",)})
    assert f"class Press: there is no class keyword {keyword!r}{near}; there are: stop_order, max_period" in str(
        caught.value
    )


@pytest.mark.parametrize(
    ("keyword", "value"),
    [
        ("stop_order", "z.motor"),
        ("stop_order", ("a", ["b"])),
        ("max_period", "soon"),
        ("max_period", 0),
        ("max_period", True),
    ],
)
def test_a_keyword_of_another_type_is_refused(keyword: str, value: Any) -> None:
    with pytest.raises(DeclarationError, match=f"class Press: {keyword} is a .*, not "):
        type("Press", (Compound,), {}, **{keyword: value})


@pytest.mark.parametrize(
    ("name", "value", "meant"),
    [
        ("stop_order", ("motor",), "stop_order"),
        ("stop_order", None, "stop_order"),
        ("stop_ordr", ["motor"], "stop_order"),
        ("stopping", ("motor",), "stop_order"),
        ("stoping", ("motor",), "stop_order"),
        ("max_period", "10 ms", "max_period"),
        ("longest_period", 0.01, "max_period"),
        ("maxperiod", 0.01, "max_period"),
    ],
)
def test_a_setting_in_the_body_of_a_class_is_refused_and_says_that_it_is_a_keyword(
    name: str, value: Any, meant: str
) -> None:
    with pytest.raises(DeclarationError, match=rf"Press\.{name}: give `{meant}` as a class keyword: class Press\("):
        type("Press", (Compound,), {name: value})


def test_a_setting_annotated_as_a_class_variable_is_refused_too() -> None:
    with pytest.raises(DeclarationError, match="as a class keyword"):

        class Press(Compound):
            stop_order: ClassVar = ("motor",)


def test_what_only_resembles_a_setting_is_the_classs_own() -> None:
    class Press(Compound):
        stopping: BinaryActuator[OnOff]
        """A part may have a name of a setting."""
        longest_period: float = 3.0
        periods = 7
        max_periods = ("a",)  # no duration

        class Stopping(Enum):
            FAST = 1

        def stop_order(self) -> str:
            return "by hand"

    press = Press(stopping=relay())
    assert (press.longest_period, press.periods, press.stop_order()) == (3.0, 7, "by hand")


class Pair(Compound, stop_order=("b",), max_period="2 ms"):
    a: BinaryActuator[OnOff]
    b: BinaryActuator[OnOff]


class Line(Compound, stop_order=("pairs.*.b", "lamps", "motor", "racks")):
    motor: DigitalActuator
    racks: dict[str, Pair]
    pairs: list[Pair]
    lamps: list[BinaryActuator[OnOff]]


def pair() -> Pair:
    return Pair(a=relay(), b=relay())


def test_a_subclass_has_the_settings_that_it_does_not_give() -> None:
    class Slow(Pair, max_period="5 ms"):
        pass

    class Other(Slow, stop_order=()):
        pass

    assert Slow._settings[:2] == (("b",), "5 ms")
    assert Other._settings[:2] == ((), "5 ms")
    assert Pair._settings[:2] == (("b",), "2 ms")


def test_a_class_of_two_bases_has_the_settings_of_both() -> None:
    class Ordered(Compound, stop_order=("a",), numbers={"x": Range("", 0, 1)}):
        a: BinaryActuator[OnOff]

    class Quick(Compound, max_period="1 ms", numbers={"y": Range("", 0, 1)}):
        pass

    class Both(Ordered, Quick, numbers={"z": Range("", 0, 1)}):
        pass

    assert Both._settings[:2] == (("a",), "1 ms")
    assert [list(each) for each in Both._settings.numbers if isinstance(each, dict)] == [["z"], ["x"], ["y"]]


def test_a_stop_order_names_patterns_and_lists_and_dicts() -> None:
    line = Line(motor=actuator(), racks={"x": pair()}, pairs=[pair(), pair()], lamps=[relay(), relay()])
    assert [item.path for item in stop_sequence(line)] == [
        "pairs.0.b", "pairs.1.b", "lamps.0", "lamps.1", "motor", "racks.x.b", "racks.x.a", "pairs.0.a", "pairs.1.a",
    ]  # fmt: skip


def test_a_stop_order_may_name_a_list_that_is_empty() -> None:
    line = Line(motor=actuator(), racks={}, pairs=[], lamps=[])
    assert [item.path for item in stop_sequence(line)] == ["motor"]


@pytest.mark.parametrize("path", ["moter", "pairs.*.c", "pairs.*.b.*", "lamp", "*.*.*.*", ""])
def test_a_stop_order_that_names_nothing_is_refused_when_the_object_is_made(path: str) -> None:
    class Wrong(Line, stop_order=("motor", path)):
        pass

    with pytest.raises(PathError, match=r"no object .* in Wrong"):
        Wrong(motor=actuator(), racks={}, pairs=[pair()], lamps=[relay()])


def test_a_mixin_cannot_hide_what_the_cycle_offers() -> None:
    class Clocked:
        now = 3.0

    with pytest.raises(DeclarationError, match="now"):
        type("Press", (Clocked, Compound), {})


def test_a_constant_with_a_name_like_a_setting_is_the_classs_own() -> None:
    press = type("Press", (Compound,), {"number": {"one": 1}, "signal": {}})
    assert press.number == {"one": 1}

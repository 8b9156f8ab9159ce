"""Kept numbers: declared, shown in frames, and taken over from the last run, each if it is still valid."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import KW_ONLY
from enum import Enum, IntEnum
from math import inf, nan
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from helpers.machines import timer
from umo import Compound, DigitalSensor, Number, connect, published
from umo.cycle.frame import Frame
from umo.cycle.restoring import MAX_EXACT
from umo.errors import DeclarationError
from umo.objects import numbers_of
from umo.operation.alarms import AlarmState
from umo.operation.alarms.alarming import engine_of
from umo.process import kept_values
from umo.process.frames import Reader
from umo.process.frames.layout import Layout
from umo.process.kept_sections import sections_of, value_of
from umo.process.station import find
from umo.testing import periods


class Speed(Enum):
    SLOW = "slow"
    FAST = "fast"


class Colour(IntEnum):
    RED = 7
    BLUE = 3


class Law:
    numbers = {"integral": Number("mm", -10.0, 10.0, kept=True), "limit": Number("mm", 0.0, 10.0)}

    def __init__(self, top: float) -> None:
        self.integral, self.limit, self.top = 0.0, 5.0, top

    def check_settings(self) -> None:
        if self.integral == 9.0:
            raise ValueError("9 is not possible")


class Press(Compound):
    timer: DigitalSensor
    _: KW_ONLY
    count: Annotated[int, Number("", 0, inf, kept=True)] = 1
    length: Annotated[float, Number("mm", 0.0, 100.0, kept=True, tunable=True)] = 2.0
    on: Annotated[bool, Number(kept=True)] = False
    speed: Annotated[Speed, Number(kept=True)] = Speed.SLOW
    colour: Annotated[Colour, Number(kept=True)] = Colour.RED
    gone: float = 3.0

    def setup(self) -> None:
        if self.length == 66.0:
            raise ValueError("66 mm are not possible")
        self.law = Law(self.length)


DEFAULTS = {"count": 1, "length": 2.0, "on": False, "speed": Speed.SLOW, "colour": Colour.RED, "law.integral": 0.0}
UNITS = {"length": "mm", "law.integral": "mm"}


def press() -> Press:
    return Press(timer=timer())


def entries(**values: Any) -> dict[str, Any]:
    given = {name.replace("__", "."): value for name, value in values.items()}
    return {path: {"value": value, "unit": UNITS.get(path, ""), "type": ""} for path, value in given.items()}


def restored(kept: Mapping[str, Any], wiring: Any = None) -> tuple[dict[str, Any], dict[str, str]]:
    """What the machine has then, and what was not taken."""
    connection = connect(press(), wiring)
    connection.kept = kept
    with connection as m:
        have = {path: number.value for path, number in numbers_of(m).items() if path in DEFAULTS}
        return have, connection.not_restored


def test_what_was_kept_counts_before_the_first_period() -> None:
    kept = entries(count=MAX_EXACT - 1, length=50.25, on=True, speed="FAST", colour="BLUE", law__integral=-3.5)
    have, refused = restored(kept)
    assert refused == {}
    wanted = [MAX_EXACT - 1, 50.25, True, Speed.FAST, Colour.BLUE, -3.5]
    assert have == dict(zip(DEFAULTS, wanted, strict=True))


def test_setup_finds_the_kept_value_of_a_field() -> None:
    connection = connect(press())
    connection.kept = entries(length=50.0)
    with connection as m:
        assert m.law.top == 50.0
    assert (m.length, m.count) == (2.0, 1)  # as the declaration has it


class Mill(Compound, numbers=lambda mill: {"speed": Number("", 0.0, mill.fastest, tunable=True, kept=True)}):
    timer: DigitalSensor
    fastest: Annotated[float, Number("", 50.0, 300.0, kept=True)] = 100.0
    speed: float = 10.0


@pytest.mark.parametrize(
    ("fastest", "kept", "speed", "refused"),
    [
        (200.0, {"speed": 150.0}, 150.0, []),
        (200.0, {"speed": 250.0}, 10.0, ["speed"]),
        (100.0, {"speed": 150.0, "fastest": 200.0}, 150.0, []),
        (100.0, {"speed": 90.0, "fastest": 400.0}, 90.0, ["fastest"]),
        (100.0, {"speed": 90.0, "fastest": 60.0}, 10.0, ["fastest", "speed"]),
    ],
)
def test_the_range_of_a_kept_value_may_depend_on_a_parameter_or_on_another_kept_value(
    fastest: float, kept: dict[str, float], speed: float, refused: list[str]
) -> None:
    wire = {"timer": {"driver": "simulated", "period": "1 ms"}}
    connection = connect(Mill(timer=timer()), {"parameters": {"fastest": fastest}, "wire": wire})
    connection.kept = entries(**kept)
    with connection as m:
        assert (m.speed, sorted(connection.not_restored)) == (speed, refused)


def test_a_kept_value_counts_after_the_parameter_of_the_wiring() -> None:
    wiring = {
        "parameters": {"length": 10.0, "count": 5, "law.integral": 1.0},
        "wire": {"timer": {"driver": "simulated", "period": "1 ms"}},
    }
    have, refused = restored(entries(length=20.0, law__integral=2.0), wiring)
    assert (have["length"], have["count"], have["law.integral"], refused) == (20.0, 5, 2.0, {})
    have, refused = restored(entries(length=200.0, law__integral=20.0), wiring)
    assert (have["length"], have["law.integral"], sorted(refused)) == (10.0, 1.0, ["law.integral", "length"])


WRONG = {
    "out of the range": (entries(length=100.5), "length", "100.5 mm is outside"),
    "below": (entries(count=-1), "count", "-1 is below 0"),
    "not whole": (entries(count=1.5), "count", "1.5 is not a whole number"),
    "a text": (entries(length="2"), "length", "'2' is not a number in mm"),
    "a number for a bool": (entries(on=1), "on", "1 is not true or false"),
    "a bool for a number": (entries(count=True), "count", "True is not a number"),
    "no member": (entries(speed="FASTER"), "speed", "'FASTER' is not one of SLOW, FAST (did you mean 'FAST'?)"),
    "a number for a member": (entries(colour=3), "colour", "3 is not one of"),
    "renamed": (entries(lenght=3.0), "lenght", "there is no kept number with this name (did you mean 'length'?)"),
    "kept no longer": (entries(gone=4.0), "gone", "there is no kept number with this name"),
    "none": (entries(count=None), "count", "it had no value"),
    "a list": (entries(law__integral=[1]), "law.integral", "[1] is not a number"),
    "not accepted by its law": (entries(law__integral=9.0), "law.integral", "9 is not possible"),
    "not accepted by setup": (entries(length=66.0), "length", "the machine does not accept the kept values"),
    "another unit": (
        {"length": {"value": 2.5, "unit": "m", "type": "float"}}, "length", "it was kept in m, and is declared in mm",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_value_that_is_not_valid_any_more_costs_this_value(case: str) -> None:
    kept, path, why = WRONG[case]
    have, refused = restored(kept | entries(on=True) if path not in ("on", "length") else kept)
    assert list(refused) == [path]
    assert why in refused[path]
    assert have == DEFAULTS | ({"on": True} if path not in ("on", "length") else {})


def test_each_value_that_is_not_taken_is_an_event_and_the_first_ones_are_said() -> None:
    connection = connect(press())
    connection.kept = entries(**{f"old_{number}": 1 for number in range(7)})
    with connection:
        said = list(kept_values.tell(connection))
        events = [event for event in connection.machine.events if "the kept value is not used" in event.text]
    assert [event.path for event in events] == [f"old_{number}" for number in range(7)]
    assert said[0].startswith("the kept value of old_0 is not used: there is no kept number with this name")
    assert (len(said), said[-1]) == (6, "2 more kept values are not used: the events of the run name them")


def test_the_values_that_a_run_begins_with_are_said() -> None:
    connection = connect(press())
    connection.kept = entries(count=7, gone=1.0)
    with connection:
        said = list(kept_values.tell(connection))
    assert said[0] == "kept from the last run: count = 7 (--fresh starts without them)"
    assert len(said) == 2


VALUES = some.none() | some.booleans() | some.integers() | some.floats() | some.text(max_size=5)


@given(some.dictionaries(some.sampled_from([*DEFAULTS, "gone", "other"]), VALUES))
def test_whatever_stands_in_the_file_the_machine_starts_with_valid_numbers(values: dict[str, Any]) -> None:
    kept = {path: {"value": value, "unit": UNITS.get(path, ""), "type": ""} for path, value in values.items()}
    have, refused = restored(kept)
    for path in DEFAULTS:
        if path in refused or path not in values:
            assert have[path] == DEFAULTS[path]
    assert 0.0 <= have["length"] <= 100.0
    assert {type(have[path]) for path in ("count", "on", "speed")} == {int, bool, Speed}


def test_kept_numbers_are_shown_as_numbers() -> None:
    seen: list[dict[str, float]] = []

    def look(frame: Frame) -> None:
        seen.append(dict(zip((each.path for each in frame.signals), frame.signal_values, strict=True)))

    connection = connect(press())
    with connection as m:
        connection.machine.observers.append(look)
        m.on, m.speed, m.colour, m.count = True, Speed.FAST, Colour.RED, MAX_EXACT
        periods(m, 1)
    assert seen[0] == {
        "count": float(MAX_EXACT), "length": 2.0, "on": 1.0, "speed": 1.0, "colour": 7.0, "law.integral": 0.0,
    }  # fmt: skip


def test_a_text_and_what_cannot_be_set_are_refused_where_they_are_declared() -> None:
    class Named(Compound):
        timer: DigitalSensor
        name: Annotated[str, Number(kept=True)] = "x"

    class Read(Compound, numbers={"speed": Number("mm/s", kept=True)}):
        timer: DigitalSensor

        @property
        def speed(self) -> float:
            return 1.0

    with pytest.raises(DeclarationError, match="number name: 'x' cannot be kept; only numbers, true or false"):
        numbers_of(Named(timer=timer()))
    with pytest.raises(DeclarationError, match="the property speed cannot be set; it can be shown"):
        numbers_of(Read(timer=timer()))


INT, BOOL, ENUM = {"type": "int"}, {"type": "bool"}, {"type": "Enum", "members": {"0": "A", "1": "B"}}
NAMED = {"type": "name", "members": {"0": "none", "2": "soap"}}
PLAIN = [
    ({"type": "float"}, 0.1, 0.1), ({"type": "float"}, nan, None), ({"type": "float"}, inf, None),
    ({"type": "float"}, sys.float_info.max, sys.float_info.max),
    (INT, 3.0, 3), (INT, float(MAX_EXACT - 1), MAX_EXACT - 1), (INT, float(MAX_EXACT), None), (INT, -1e300, None),
    (INT, nan, None), (BOOL, 1.0, True), (BOOL, 0.0, False), (ENUM, 1.0, "B"), (ENUM, nan, None),
    (NAMED, 2.0, "soap"), (NAMED, 3.0, None),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "number", "value"), PLAIN)
def test_a_number_of_a_frame_is_kept_as_what_it_is_or_not_at_all(kind: Any, number: float, value: Any) -> None:
    found = value_of(kind, number)
    assert (found, type(found)) == (value, type(value))


# Alarms and states --------------------------------------------------------------------------------------


def test_alarms_and_states_are_kept_with_the_numbers_of_the_same_frame() -> None:
    machine = find("batch").machine()
    connection = connect(machine, find("batch").wirings["simulated"])
    with connection as m, published(connection, "kept") as ring, Reader(ring.path) as reader:
        periods(m)
        m.reactors[1].unit.abort()
        m.reactors[0].unit.produced = 7
        periods(m, 3)
        kept = {name: section(reader.latest()) for name, section in sections_of(reader.layout).items()}
    assert kept["alarms"] == {"reactors.1.fault": int(AlarmState.UNACKNOWLEDGED)}
    assert kept["states"] == {"reactors.0.unit": "idle", "reactors.1.unit": "aborted"}
    assert kept["numbers"]["reactors.0.unit.produced"]["value"] == 7


def test_an_alarm_that_nobody_has_acknowledged_is_still_to_be_acknowledged_in_the_next_run() -> None:
    machine = find("batch").machine()
    connection = connect(machine, find("batch").wirings["simulated"])
    connection.states = {"alarms": {"reactors.1.fault": int(AlarmState.UNACKNOWLEDGED), "reactors.9.fault": 1}}
    with connection as m:
        periods(m, 3)
        engine = engine_of(connection.machine)
        assert engine is not None
        states = dict(zip(engine.paths, map(AlarmState, engine.states.tolist()), strict=True))
    assert {path for path, state in states.items() if state} == {"reactors.1.fault"}
    assert states["reactors.1.fault"] is AlarmState.RETURNED  # its condition is over


def test_a_unit_whose_state_is_not_shown_keeps_no_state() -> None:
    layout = Layout((), (), {}, units=({"path": "filler.unit"},))
    assert sections_of(layout) == {}

"""Who asks seeks: the nearest name in a refusal is the client's work, not the loop's (docs/decisions/0061)."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.operator import Operator
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Number, Range, action, connect
from umo.clients.remote.suggestions import with_nearest
from umo.cycle.events import CommandState, Event
from umo.operation.alarms import Alarm, High
from umo.operation.commands.client_commands import Mode
from umo.process.frames import Reader, published
from umo.process.frames.layout import Layout
from umo.states import OnOff
from umo.testing import Scripted
from umo.text import did_you_mean, without_search


class Zone(
    Compound,
    numbers={"gain": Number(tunable=True, minimum=0.0, maximum=5.0)},
    alarms={"hot": Alarm(High("level", 50.0), "too hot")},
):
    heater: DigitalActuator
    valve: BinaryActuator[OnOff]
    level: DigitalSensor
    gain = 1.0

    @action(speed=Range("m/s", 0.0, 5.0))
    def warm(self, speed: float = 1.0) -> None:
        """Something."""


class Plant(Compound):
    timer: DigitalSensor
    zones: list[Zone]


CASES: Mapping[str, tuple[str, str, dict[str, Any], str, str]] = {
    "write": ("write", "zones.0.heatr", {"value": 1.0}, "no actuator 'zones.0.heatr'", "zones.0.heater"),
    "a state": ("write", "zones.0.valve", {"value": "ONN"}, "has no state 'ONN'", "ON"),
    "tune": ("tune", "zones.0.gian", {"value": 1.0}, "no tunable number 'zones.0.gian'", "zones.0.gain"),
    "call": ("call", "zones.0.wram", {}, "no action 'zones.0.wram'", "zones.0.warm"),
    "an argument": ("call", "zones.0.warm", {"arguments": {"sped": 1.0}}, "no argument 'sped'", "speed"),
    "clear": ("clear", "zone.0", {}, "no object 'zone.0'", "zones.0"),
    "acknowledge": ("acknowledge", "zones.0.heter", {}, "no object 'zones.0.heter'", "zones.0.heater"),
    "an alarm": ("shelve", "zones.0.hott", {"value": 60.0}, "no alarm 'zones.0.hott'", "zones.0.hot"),
    "a command": ("wirte", "zones.0.heater", {"value": 1.0}, "there is no command 'wirte'", "write"),
}


@pytest.fixture(scope="module")
def answered() -> dict[str, tuple[Event, Event]]:
    """The answers of the machine, and what a client makes of them."""
    m = Plant(timer=timer(), zones=[Zone(heater=actuator(), valve=relay(), level=sensor()) for _ in range(2)])
    connection = connect(m, wired(m, Scripted()))
    found = {}
    searched: list[object] = []
    with pytest.MonkeyPatch.context() as patch, connection, published(connection, "plant") as ring:
        ann = Operator(m, Mode.MANUAL)
        ann.do("lease")
        seek = difflib.get_close_matches
        patch.setattr(difflib, "get_close_matches", lambda *given, **more: searched.append(given))
        events = {name: ann.do(do, path, **more) for name, (do, path, more, *_) in CASES.items()}
        patch.setattr(difflib, "get_close_matches", seek)
        with Reader(ring.path) as reader:
            for name, event in events.items():
                found[name] = event, with_nearest(event, reader.layout)
    assert searched == []
    return found


@pytest.mark.parametrize("name", CASES)
def test_the_machine_refuses_what_it_does_not_know_and_the_client_names_the_nearest(
    name: str, answered: dict[str, tuple[Event, Event]]
) -> None:
    *_, said, near = CASES[name]
    event, shown = answered[name]
    assert event.state is CommandState.REFUSED
    assert said in event.text and "did you mean" not in event.text
    assert f"{said} (did you mean {near!r}?)" in shown.text


def test_other_answers_stay_as_they_are(answered: dict[str, tuple[Event, Event]]) -> None:
    event = answered["write"][0]
    others = [
        event._replace(state=CommandState.FAILED),
        event._replace(text="CommandRefused: nobody has the lease; take it first"),
        event._replace(text="RangeError: zones.0.heater: 'x' is not a number", path="zones.0.heater"),
        event._replace(text="PathError: zones.0.heater is not held"),
    ]
    layout = Layout(({"path": "zones.0.heater", "actuator": True},), (), {})
    for each in others:
        assert with_nearest(each, layout) == each


@pytest.mark.parametrize(
    ("pattern", "near"), [("*.hot", "reactors.*.temperature.hot"), ("reactor.*.full", "reactors.*.full")]
)
def test_for_a_pattern_that_names_nothing_the_nearest_pattern_is_named(
    pattern: str, near: str, answered: dict[str, tuple[Event, Event]]
) -> None:
    paths = [f"reactors.{number}.{name}" for number in range(2) for name in ("full", "temperature.hot")]
    layout = replace(Layout((), (), {}), alarms=tuple({"path": path} for path in paths))
    text = f"PathError: there is no alarm {pattern!r}; * stands for one part of a path"
    event = answered["write"][0]._replace(asked="shelve", path=pattern, text=text)
    told = f"PathError: there is no alarm {pattern!r} (did you mean {near!r}?); * stands for one part of a path"
    assert with_nearest(event, layout).text == told


def test_within_a_period_no_message_seeks() -> None:
    assert did_you_mean("heatr", ["heater"]) == " (did you mean 'heater'?)"
    with without_search():
        assert did_you_mean("heatr", ["heater"]) == ""
    assert did_you_mean("heatr", ["heater"]) != ""

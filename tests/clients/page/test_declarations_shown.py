"""Whatever a declaration accepts, the page and the faces can show: every setting of every declaration, with values that
nobody meant."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import timer, wired
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Number,
    action,
    connect,
    published,
)
from umo.clients.faces.mqtt.home_assistant_discovery import discovery
from umo.clients.page.feed import Feed
from umo.errors import DeclarationError, UmoError, WiringError
from umo.objects import Range
from umo.operation.alarms import Alarm, High, Priority
from umo.process.frames.machine_items import declaration_of
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods

from .conftest import search

ODD: Mapping[str, Any] = {
    "None": None, "True": True, "False": False, "0": 0, "1": 1, "-1.5": -1.5, "inf": inf, "-inf": -inf, "nan": nan,
    "10**400": 10**400, "2**70": 2**70, "1e308": 1e308, "5e-324": 5e-324, "''": "", "'x'": "x", "'mm'": "mm",
    "lines": "a\nb", "'\\x00'": "\x00", "surrogate": "\udc80", "long": "m" * 5000, "right to left": "\u202em",
    "bytes": b"mm", "list": [1], "dict": {1: "a"}, "names": {1: "a", 2: "a"}, "odd names": {"a": None}, "set": {1},
    "class": int, "object": object(), "function": len, "complex": 1j, "enum": Priority.LOW, "state": PassFail.PASS,
    "'10 s'": "10 s", "tuple": (1, 2),
}  # fmt: skip

TUNED = {"unit": "mm", "minimum": 0.0, "maximum": 10.0, "tunable": True, "shown": True, "kept": False, "names": {}}
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "tuned": TUNED,
    "shown": TUNED | {"tunable": False},
    "argument": {"unit": "mm", "minimum": 0.0, "maximum": 10.0},
    "action": {"harmless": False, "apart": False, "release": None},
    "help": {"text": "Do it."},
    "default": {"value": 1.0},
    "alarm": {
        "condition": High("level", 5.0), "text": "too full", "priority": Priority.LOW, "on_delay": 0.0,
        "off_delay": "1 s", "latch": False, "acknowledge": True,
    },
    "limit": {"of": "level", "limit": 5.0, "deadband": 0.0},
    "name": {"alarm": "full"},
    "level": {
        "units": "mm", "minimum": 0.0, "maximum": 10.0, "resolution": 0.5, "zero_offset": 0.0, "synchronous": True,
        "incremental": False, "linearization": None, "invalid_raws": (), "on_error": "raise", "max_age": None,
        "rollover": False,
    },
    "valve": {
        "units": "%", "default": 0.0, "minimum": 0.0, "maximum": 10.0, "resolution": 0.5, "zero_offset": 0.0,
        "linearization": None, "limits": "raise", "synchronous": True, "expires": None, "slew_rate": None,
        "on_error": "raise", "max_age": None, "when_suspended": None,
    },
    "limit switch": {
        "states": PassFail, "one": PassFail.FAIL, "synchronous": True, "on_error": "raise", "max_age": None,
        "debounce": None,
    },
    "lamp": {
        "states": OnOff, "one": OnOff.ON, "default": OnOff.OFF, "synchronous": True, "expires": None,
        "on_error": "raise", "max_age": None, "when_suspended": None,
    },
}  # fmt: skip
PLACES = [(what, name) for what, names in SETTINGS.items() for name in names]


def with_states(kind: Any, about: dict[str, Any]) -> Any:
    return kind(about.pop("states"), **about)


def machine(**changes: Mapping[str, Any]) -> Any:
    """A machine that declares one of everything; with other settings."""
    about = {what: {**names, **changes.get(what, {})} for what, names in SETTINGS.items()}

    def number(what: str) -> Number:
        told = about[what]
        return Number(told.pop("unit"), told.pop("minimum"), told.pop("maximum"), **told)

    limit = about["limit"]
    alarm = about["alarm"]
    if "condition" not in changes.get("alarm", {}):
        alarm["condition"] = High(limit["of"], limit["limit"], deadband=limit["deadband"])

    class Cell(
        Compound,
        numbers={"gain": number("tuned"), "load": number("shown")},
        alarms={about["name"]["alarm"]: Alarm(alarm.pop("condition"), alarm.pop("text"), **alarm)},
    ):
        level: DigitalSensor
        valve: DigitalActuator
        limit: BinarySensor[PassFail]
        lamp: BinaryActuator[OnOff]
        gain: float = 1.0
        load: float = 2.0

        @action(
            amount=Range(**about["argument"]),
            **about["action"],  # type: ignore[arg-type]
        )
        def fill(self, amount: float = about["default"]["value"]) -> None: ...

        fill.__doc__ = about["help"]["text"]

    class Plant(Compound):
        timer: DigitalSensor
        cell: Cell

    return Plant(
        timer=timer(),
        cell=Cell(
            level=DigitalSensor(about["level"].pop("units"), **about["level"]),
            valve=DigitalActuator(about["valve"].pop("units"), **about["valve"]),
            limit=with_states(BinarySensor, about["limit switch"]),
            lamp=with_states(BinaryActuator, about["lamp"]),
        ),
    )


TEXTS = {"path", "unit", "text", "help", "name", "priority", "kind"}
NUMBERS = {"minimum", "maximum"}
TRUTHS = {"harmless", "apart", "dead_man", "required"}


def wrong_in(told: Any, place: str = "") -> Iterator[str]:
    """What a page, which is typed (types.d.ts), does not expect."""
    if isinstance(told, dict):
        for key, value in told.items():
            where = f"{place}.{key}"
            if key in TEXTS and not isinstance(value, str):
                yield f"{where} is not a text: {value!r}"
            if key in NUMBERS and (isinstance(value, bool) or not isinstance(value, int | float | None)):
                yield f"{where} is not a number: {value!r}"
            if key in TRUTHS and not isinstance(value, bool):
                yield f"{where} is neither true nor false: {value!r}"
            if key == "states":
                names = value.values() if isinstance(value, dict) else value
                if not all(isinstance(each, str) for each in names):
                    yield f"{where} are not texts: {value!r}"
            yield from wrong_in(value, where)
    elif isinstance(told, list):
        for number, each in enumerate(told):
            yield from wrong_in(each, f"{place}.{number}")


def shown(m: Any) -> None:
    """Show a machine on the page and to the faces. UmoError if it is refused before."""
    wiring = wired(m, Scripted({}), clock=VirtualTimer())
    connection = connect(m, wiring)
    with connection, published(connection, "plant", "rig"):
        periods(m, 3)
        feed = Feed()
        try:
            search(feed)
            (watched,) = feed.watched.values()
            watched.read()
            texts = json.dumps(watched.description(), allow_nan=False), watched.state(True), json.dumps(watched.line())
            for text in texts:
                text.encode()  # as a websocket sends it
                json.loads(text, parse_constant=_no_constant)
                assert [*wrong_in(json.loads(text))] == []
            declared = declaration_of(watched.reader)
            json.dumps(dict(discovery(declared, "umo/plant", "homeassistant")), allow_nan=False).encode()
        finally:
            feed.close()


def _no_constant(text: str) -> Any:
    raise AssertionError(f"{text} is not JSON")


def refused_or_shown(make: Callable[[], Any]) -> None:
    try:
        shown(make())
    except (DeclarationError, WiringError) as error:
        assert str(error).isprintable() or "\n" in str(error)
    except UmoError as error:
        raise AssertionError(f"{type(error).__name__}: {error}") from error
    except TypeError as error:
        if "unhashable" not in str(error):  # the name of an alarm, which is a key
            raise


def test_the_machine_of_this_test_is_shown_as_it_is() -> None:
    shown(machine())


@pytest.mark.full
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("what", "name"), PLACES, ids=[f"{what}.{name}" for what, name in PLACES])
def test_every_setting_with_every_odd_value_is_refused_or_shown(what: str, name: str) -> None:
    wrong = []
    for label, odd in ODD.items():
        try:
            refused_or_shown(lambda odd=odd: machine(**{what: {name: odd}}))  # type: ignore[misc]
        except Exception as error:
            wrong.append(f"{what}.{name}={label}: {type(error).__name__}: {error}"[:300])
    assert wrong == []


@settings(max_examples=25)
@given(place=st.sampled_from(PLACES), odd=st.sampled_from([*ODD.values()]))
def test_what_a_declaration_accepts_is_shown(place: tuple[str, str], odd: Any) -> None:
    what, name = place
    refused_or_shown(lambda: machine(**{what: {name: odd}}))

"""A kind of atomic object that umo has not: its class says all that wiring, period, frames, recording, faces, page,
clients and the command line ask."""

from __future__ import annotations

import json
from enum import IntEnum
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import sensor, timer, wired
from helpers.operator import Operator
from umo import Compound, DigitalSensor, connect, published
from umo.errors import BadInput, DeclarationError, DriverError, StateError, WiringError
from umo.generate.controller_model import model_of
from umo.objects import Actuator, Atomic, Quality, Sensor, described
from umo.objects.atomic import Calibration
from umo.objects.presentation.rows import value_of
from umo.process.frames import Reader
from umo.process.frames.machine_items import ItemKind, items_of
from umo.recording.message_tree import leaves_of
from umo.testing import Scripted, VirtualTimer, periods, put
from umo.text import shown_place
from umo.user_code import class_place
from umo.wiring import resolve
from umo_command.show.part_tree import _declared


class Gear(IntEnum):
    REVERSE = -1
    NEUTRAL = 0
    LOW = 1
    HIGH = 4


class States(Atomic):
    """A group of bits with one named state for each of some numbers."""

    _word, _has_states = "multi-state", True
    _states: type[IntEnum]
    _raws: tuple[int, ...]

    def __init__(self, states: type[IntEnum], synchronous: bool = True) -> None:
        super().__init__(synchronous)
        self._states, self._raws = states, tuple(sorted(map(int, states)))

    @property
    def calibration(self) -> Calibration:
        low, high = self._raws[0], self._raws[-1]
        between = sorted({*range(low, high)} - {*self._raws})
        return Calibration(float(low), float(high), 1.0, 0.0, invalid_raws=tuple(between))

    def _calibrate(self, calibration: Calibration) -> None:
        pass

    def _about(self) -> dict[str, Any]:
        return {"states": {str(int(state)): state.name for state in self._states}}

    def _number(self, value: Any) -> float:
        if type(value) is not self._states:
            raise StateError(f"{self.path}: {value!r} is not a {self._states.__name__}")
        return float(value)

    def _plain(self, value: Any) -> str:
        return str(value.name)

    def _from_plain(self, value: Any) -> float:
        if value not in self._states.__members__:
            raise StateError(f"{self.path} has no state {value!r}")
        return self._number(self._states[value])

    def _state(self, value: float) -> IntEnum:
        if value != value:
            raise BadInput(self.path, Quality.BAD, why="it was never read")
        return self._states(int(value))

    def describe(self) -> str:
        return " ".join(f"{state.name}={int(state)}" for state in self._states)


class MultiStateSensor(Sensor, States):
    _max_age, _marks = None, False

    def read(self) -> IntEnum:
        return self._state(self._image.values[self._slot])


class MultiStateActuator(Actuator, States):
    _expires = _max_age = _when_suspended = None

    def __init__(self, states: type[IntEnum], default: IntEnum) -> None:
        super().__init__(states)
        self._default = default

    @property
    def default(self) -> IntEnum:
        return self._default

    def write(self, value: IntEnum) -> bool:
        return self._image.command(self._slot, self._number(value))

    def read(self) -> IntEnum:
        return self._state(self._image.values[self._slot])


class Gearbox(Compound):
    timer: DigitalSensor
    lever: MultiStateSensor
    gear: MultiStateActuator
    speed: DigitalSensor

    def control(self) -> None:
        self.gear.write(self.lever.read())


def gearbox() -> Gearbox:
    return Gearbox(
        timer=timer(), lever=MultiStateSensor(Gear), gear=MultiStateActuator(Gear, Gear.NEUTRAL), speed=sensor()
    )


def test_its_values_pass_a_period_and_what_is_none_of_its_states_is_no_reading() -> None:
    m, device = gearbox(), Scripted({"lever": [4, -1, 2]})
    with connect(m, wired(m, device, clock=VirtualTimer())):
        assert (m.lever.read(), m.gear.read()) == (Gear.HIGH, Gear.NEUTRAL)
        m.control()
        m.update()
        assert (m.gear.read(), m.gear.raw) == (Gear.HIGH, 4)
        periods(m)
        assert (m.lever.read(), m.gear.raw, m.lever.quality) == (Gear.REVERSE, -1, Quality.GOOD)
        with pytest.raises(DriverError, match="read 2, but a multi-state channel reads -1 or 0 or 1 or 4"):
            m.sample()
        with pytest.raises(StateError):
            m.gear.write(1)  # type: ignore[arg-type]
        put(m.lever, Gear.LOW)
        m.sample()
        assert m.lever.read() is Gear.LOW
    assert m.gear.describe() == "REVERSE=-1 NEUTRAL=0 LOW=1 HIGH=4"


def test_frames_recording_faces_and_page_have_its_states() -> None:
    m = gearbox()
    connection = connect(m, wired(m, Scripted({"lever": [4]}), clock=VirtualTimer()))
    with connection, published(connection, "gearbox") as ring, Reader(ring.path) as reader:
        periods(m)
        frame, layout = reader.latest(), reader.layout
        assert reader.values(frame) == {"lever": "HIGH", "gear": "HIGH", "speed": 0.0, "timer": 0.0}
        place = reader.index("gear")
        (row,) = reader.rows(frame, [place])
        assert (value_of([row]), row.about.range_text, row.about.default_text) == (
            "HIGH", "REVERSE or NEUTRAL or LOW or HIGH", "NEUTRAL",
        )  # fmt: skip
        states = {-1: "REVERSE", 0: "NEUTRAL", 1: "LOW", 4: "HIGH"}
        gear = next(item for item in items_of(layout) if item.path == "gear")
        assert (gear.kind, gear.states, gear.state_of(4.0)) == (ItemKind.ACTUATOR, states, "HIGH")
        assert dict(leaves_of(layout))["lever"].column == "values"
        assert json.loads(json.dumps(row.about.shown))["states"] == {str(n): name for n, name in states.items()}


def test_a_client_writes_it_by_the_names_of_its_states() -> None:
    m = gearbox()
    with connect(m, wired(m, Scripted({"lever": [0]}), clock=VirtualTimer())):
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.mode("manual")
        ann.do("write", "gear", value="LOW")
        periods(m)
        assert (m.gear.read(), ann.driven) == (Gear.LOW, "gear LOW (client ann)")
        assert "has no state 'LOWEST'" in ann.do("write", "gear", value="LOWEST").text


def test_its_declaration_has_words_and_what_it_cannot_do_is_refused(tmp_path: Path) -> None:
    m = gearbox()
    assert _declared(m.gear) == "multi-state actuator, REVERSE=-1 NEUTRAL=0 LOW=1 HIGH=4, default NEUTRAL"
    assert described(m.lever).kind_text == "multi state sensor"
    file = tmp_path / "scaled.toml"
    file.write_text(
        '[drivers.box]\ntype = "simulated"\n[wire]\ntimer = { driver = "box", period = "1 ms" }\n'
        'lever = { driver = "box", resolution = 2.0 }\ngear = { driver = "box" }\nspeed = { driver = "box" }\n'
    )
    with pytest.raises(WiringError, match="is for digital objects; this one is multi-state"):
        resolve(m, file)


def test_a_controller_has_none_of_it() -> None:
    m = gearbox()
    connection = connect(m, wired(m, Scripted({"lever": [0]}), clock=VirtualTimer()))
    with connection:
        problems = [str(each) for each in model_of(connection.machine, connection.wired).problems]
    assert any("lever" in each and "a controller has no MultiStateSensor" in each for each in problems)


class Without(Atomic):
    """What a kind of object has to say, but for `describe`."""

    calibration = _about = _calibrate = _number = _plain = _from_plain = None


class Half(Sensor, Without):
    def describ(self) -> str:
        return ""


def test_a_kind_that_lacks_a_function_is_refused_as_it_is_made_with_the_nearest_one_and_the_place() -> None:
    place = shown_place(class_place(Half))
    assert place.startswith("tests/objects/test_new_kind.py:")
    with pytest.raises(DeclarationError) as refused:
        Half(True)
    assert (
        str(refused.value) == f"Half has no `describe` (did you mean 'describ'?), which each Atomic must have ({place})"
    )

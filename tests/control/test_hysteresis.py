"""On/off regulation with hysteresis."""

from __future__ import annotations

import pytest

from umo import BinaryActuator, Compound, DigitalSensor, connect
from umo.control import Hysteresis
from umo.errors import BadInput
from umo.states import OnOff, OpenClosed
from umo.testing import Scripted, put


class Tank(Compound):
    valve: BinaryActuator[OnOff]
    drain: BinaryActuator[OpenClosed]
    level: DigitalSensor


def tank() -> Tank:
    return Tank(
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        drain=BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED),
        level=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=1.0),
    )


def test_it_switches_at_the_bounds_and_holds_between_them() -> None:
    with connect(tank()) as m:
        law = Hysteresis(m.level, m.valve, OnOff.ON, low=40.0, high=60.0)
        shown = []
        for level in (30, 39, 40, 50, 60, 61, 50, 40, 39):
            put(m.level, level)
            m.sample()
            law.control()
            m.update()
            shown.append(m.valve.read() is OnOff.ON)
        assert shown == [True, True, True, True, True, False, False, False, True]


def test_the_raising_state_may_be_the_zero_state() -> None:
    with connect(tank()) as m:
        law = Hysteresis(m.level, m.drain, OpenClosed.CLOSED, low=40.0, high=60.0)
        put(m.level, 90)
        m.sample()
        assert law.control() is OpenClosed.OPEN
        put(m.level, 10)
        m.sample()
        assert law.control() is OpenClosed.CLOSED


def test_settled_says_whether_the_value_is_within_the_band() -> None:
    with connect(tank()) as m:
        law = Hysteresis(m.level, m.valve, OnOff.ON, low=40.0, high=60.0)
        for level, settled in ((39, False), (40, True), (60, True), (61, False)):
            put(m.level, level)
            m.sample()
            assert law.settled is settled


def test_settled_does_not_judge_a_value_that_the_law_would_refuse() -> None:
    with connect(tank()) as m:
        law = Hysteresis(m.level, m.valve, OnOff.ON, low=40.0, high=200.0)
        put(m.level, 150)
        m.sample()
        with pytest.raises(BadInput, match="level is OUT_OF_RANGE"):
            law.settled  # noqa: B018


def test_a_bad_input_changes_nothing() -> None:
    box = Scripted({"level": [30, 130]})
    wiring = {"drivers": {"box": box}, "wire": {name: {"driver": "box"} for name in ("valve", "drain", "level")}}
    with connect(tank(), wiring) as m:
        law = Hysteresis(m.level, m.valve, OnOff.ON, low=40.0, high=60.0)
        law.control()
        m.sample()
        with pytest.raises(BadInput, match="level is OUT_OF_RANGE"):
            law.control()
        assert m.valve.pending is OnOff.ON

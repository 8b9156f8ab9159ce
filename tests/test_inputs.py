"""What control laws may be fed with, and one motion at a time."""

from __future__ import annotations

import pytest

from umo import BadInput, BinarySensor, Busy, Compound, DigitalSensor, PassFail, Quality, connect
from umo.control import Claim, state_of, value_of
from umo.testing import Scripted, put


class Sensors(Compound):
    switch: BinarySensor[PassFail]
    level: DigitalSensor
    gauge: DigitalSensor


def sensors() -> Sensors:
    return Sensors(
        switch=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age=1e9),
        level=DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=1.0),
        gauge=DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=1.0, synchronous=False),
    )


def test_good_values_pass() -> None:
    with connect(sensors()) as m:
        put(m.level, 3.0)
        put(m.switch, PassFail.FAIL)
        m.sample()
        assert value_of(m.level) == 3.0
        assert state_of(m.switch) is PassFail.FAIL


def test_an_asynchronous_sensor_is_read_before_its_quality_is_judged() -> None:
    with connect(sensors()) as m:
        put(m.gauge, 99.0)
        with pytest.raises(BadInput, match="gauge is OUT_OF_RANGE"):
            value_of(m.gauge)
        assert value_of(m.gauge, accept={Quality.OUT_OF_RANGE}) == 99.0


def test_a_stale_state_is_refused_unless_accepted() -> None:
    box = Scripted()
    wiring = {"drivers": {"box": box}, "wire": {name: {"driver": "box"} for name in ("switch",)}}
    wiring["wire"] |= {name: {"driver": "simulated"} for name in ("level", "gauge")}
    with connect(sensors(), wiring) as m:
        box.at(len(box.calls), OSError("cut"))
        assert m.sample() is False
        with pytest.raises(BadInput) as caught:
            state_of(m.switch)
        assert (caught.value.path, caught.value.quality) == ("switch", Quality.STALE)
        assert state_of(m.switch, accept={Quality.STALE}) is PassFail.PASS


def test_a_second_motion_on_a_busy_axis_is_refused_and_the_claim_ends_with_the_motion() -> None:
    m = sensors()
    claim = Claim(m)
    with claim.of("home"):
        with pytest.raises(Busy, match="busy with home; move_to has to wait"), claim.of("move_to"):
            pass
        assert claim.holder == "home"
    with pytest.raises(ZeroDivisionError), claim.of("move_to"):
        raise ZeroDivisionError
    assert claim.holder is None

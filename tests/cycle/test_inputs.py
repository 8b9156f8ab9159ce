"""What control laws may be fed with, and one motion at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from helpers.machines import bench, wired
from umo import BinarySensor, Compound, DigitalSensor, Quality, Vector, connect
from umo.control import HOMING, state_of, value_of
from umo.errors import BadInput, DriverError
from umo.states import PassFail
from umo.testing import Scripted, put


class Sensors(Compound):
    switch: BinarySensor[PassFail]
    level: DigitalSensor
    gauge: DigitalSensor


def sensors(**level: Any) -> Sensors:
    return Sensors(
        switch=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age=1e9),
        level=DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=1.0, **level),
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


@pytest.mark.parametrize("accept", [(), Quality.OUT_OF_RANGE, {Quality.UNREFERENCED}])
def test_a_value_held_within_its_declared_age_is_accepted_by_every_call(accept: Any) -> None:
    box = Scripted({"level": 3, "switch": 1})
    machine = sensors(on_error="hold", max_age=1e9)
    with connect(machine, wired(machine, box)) as m:
        box.at(len(box.calls), OSError("cut"))
        assert m.sample() is False
        assert (m.switch.quality, m.level.quality) == (Quality.STALE, Quality.STALE)
        assert state_of(m.switch, accept) is PassFail.FAIL
        assert value_of(m.level, accept) == 3.0


@pytest.mark.parametrize("accept", [(), Quality.OUT_OF_RANGE, HOMING])
def test_a_bad_value_is_refused_unless_the_call_accepts_just_that(accept: Any) -> None:
    box = Scripted({"level": 3})
    machine = sensors()
    with connect(machine, wired(machine, box)) as m:
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(DriverError):
            m.sample()
        with pytest.raises(BadInput, match="level is BAD") as caught:
            value_of(m.level, accept)
        assert (caught.value.path, caught.value.quality) == ("level", Quality.BAD)
        assert value_of(m.level, Quality.BAD) == 3.0


def test_a_bad_state_is_refused_too() -> None:
    box, machine = Scripted({"limit": [1, 2]}), bench()  # a switch that reads 2 is broken
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(DriverError):
            m.sample()
        with pytest.raises(BadInput, match="limit is BAD"):
            state_of(m.limit, HOMING)
        assert state_of(m.limit, Quality.BAD) is PassFail.FAIL


@pytest.mark.parametrize(
    ("accept", "accepted"),
    [
        (Quality.UNREFERENCED, True),
        ({Quality.UNREFERENCED}, True),
        ([Quality.BAD, Quality.UNREFERENCED], True),
        (HOMING, True),
        (Quality.OUT_OF_RANGE, False),
        ((), False),
    ],
)
def test_a_call_says_which_quality_or_qualities_it_accepts(accept: Any, accepted: bool) -> None:
    with connect(sensors(incremental=True)) as m:
        m.sample()
        if accepted:
            assert value_of(m.level, accept) == 0.0
        else:
            with pytest.raises(BadInput, match="level is UNREFERENCED"):
                value_of(m.level, accept)
        m.level.referenced()
        assert value_of(m.level, accept) == 0.0


class Row(Compound):
    levels: list[DigitalSensor]


def row(**changes: Any) -> Row:
    scale = {"minimum": 0.0, "maximum": 10.0, "resolution": 1.0} | changes
    return Row(levels=[DigitalSensor("mm", **scale) for _ in range(4)])


@pytest.mark.usefixtures("each_way")
def test_the_values_of_a_vector_are_refused_where_one_by_one_they_would_be() -> None:
    with connect(row()) as m:
        vector = Vector(m.levels[1:])
        assert value_of(vector).tolist() == [0.0, 0.0, 0.0]
        put(m.levels[0], 99.0)  # stands beside the vector
        m.sample()
        assert value_of(vector).tolist() == [0.0, 0.0, 0.0]
        put(m.levels[2], 20.0)
        m.sample()
        with pytest.raises(BadInput, match=r"^levels\.2 is OUT_OF_RANGE$") as caught:
            value_of(vector)
        assert (caught.value.path, caught.value.quality) == ("levels.2", Quality.OUT_OF_RANGE)
        put(m.levels[3], 20.0)
        m.sample()
        with pytest.raises(BadInput, match=r"^levels\.2 is OUT_OF_RANGE, and 1 more of the Vector is not accepted$"):
            value_of(vector, accept=Quality.UNREFERENCED)
        for accept in (Quality.OUT_OF_RANGE, HOMING):
            assert value_of(vector, accept).tolist() == [0.0, 20.0, 20.0]


@pytest.mark.usefixtures("each_way")
def test_a_vector_names_the_first_that_is_refused_and_not_the_first_that_is_not_good() -> None:
    machine = Row(
        levels=[
            DigitalSensor("mm", minimum=0.0, maximum=10.0, resolution=1.0, incremental=incremental)
            for incremental in (True, False, True)
        ]
    )
    with connect(machine) as m:
        put(m.levels[1], 20.0)
        m.sample()
        with pytest.raises(BadInput, match=r"^levels\.1 is OUT_OF_RANGE$"):
            value_of(Vector(m.levels), accept=Quality.UNREFERENCED)


@pytest.mark.usefixtures("each_way")
def test_held_values_of_a_vector_are_accepted() -> None:
    machine, box = row(on_error="hold", max_age=1e9), Scripted({"levels.1": 7})
    with connect(machine, wired(machine, box)) as m:
        box.at(len(box.calls), OSError("cut"))
        assert m.sample() is False
        assert np.all(Vector(m.levels).quality == Quality.STALE)
        assert value_of(Vector(m.levels)).tolist() == [0.0, 7.0, 0.0, 0.0]

"""Many like objects moved at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, bench, failed, relay, sensor, switch, timer, wired
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Quality, Vector, connect
from umo.errors import DeclarationError, DriverError, NotConnected, RangeError, StateError
from umo.objects import atoms
from umo.states import OnOff, PassFail
from umo.testing import Scripted

pytestmark = pytest.mark.usefixtures("each_way")


class Lane(Compound):
    motor: DigitalActuator
    lamp: BinaryActuator[OnOff]
    encoder: DigitalSensor


class Field(Compound):
    lanes: list[Lane]


@pytest.fixture
def box():
    return Scripted()


def field(count=4, motor=None, lamp=None, encoder=None):
    return Field(
        lanes=[
            Lane(motor=actuator(**(motor or {})), lamp=relay(**(lamp or {})), encoder=sensor(**(encoder or {})))
            for _ in range(count)
        ]
    )


def motors(m):
    return Vector(lane.motor for lane in m.lanes)


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3), st.permutations([0, 1, 2]))
def test_a_vector_does_what_its_objects_would_one_by_one_in_any_order(values, order):
    scales = [{"resolution": 0.1}, {"resolution": -0.3, "zero_offset": 1.0}, {"resolution": 10 / 2047}]
    runs = []
    for together in (True, False):
        machine, box = (
            Field(lanes=[Lane(motor=actuator(**s), lamp=relay(), encoder=sensor()) for s in scales]),
            Scripted(),
        )
        with connect(machine, wired(machine, box)) as m:
            picked = [m.lanes[i].motor for i in order]
            if together:
                assert Vector(picked).write(values) is True
            else:
                for item, value in zip(picked, values, strict=True):
                    assert item.write(value) is True
            m.update()
            runs.append(([a.read() for a in atoms(m) if a in picked], [a.raw for a in picked], box.calls[:]))
    assert runs[0] == runs[1]


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.array(2.0), [2, 2, 2, 2], (2.0,) * 4, np.full(4, 2)])
def test_one_value_for_all_or_one_for_each(box, value):
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        assert motors(m).write(value) is True
        assert [lane.motor.pending for lane in m.lanes] == [2.0] * 4


@pytest.mark.parametrize("bad", [10.1, -11.0, math.nan, math.inf])
def test_all_or_nothing_under_limits_raise(box, bad):
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        motors(m).write(1.0)
        with pytest.raises(RangeError, match=r"lanes\.2\.motor: .* 1 of 4 values are refused, and none is used"):
            motors(m).write([5.0, 5.0, bad, 5.0])
        assert [lane.motor.pending for lane in m.lanes] == [1.0] * 4


def test_clamping_takes_the_bounds_and_returns_false_but_never_what_is_not_finite(box):
    machine = field(motor={"limits": "clamp"})
    with connect(machine, wired(machine, box)) as m:
        assert motors(m).write([5.0, 11.0, -99.0, 10.0]) is False
        assert [lane.motor.pending for lane in m.lanes] == [5.0, 10.0, -10.0, 10.0]
        with pytest.raises(RangeError):
            motors(m).write([0.0, 0.0, math.nan, 0.0])
        with pytest.raises(RangeError):
            motors(m).write(math.inf)
        assert m.lanes[0].motor.pending == 5.0


def test_clamping_leaves_a_value_within_the_range_as_it_is_also_the_negative_zero_of_a_bound(box):
    machine = field(motor={"limits": "clamp", "minimum": 0.0})
    with connect(machine, wired(machine, box)) as m:
        motors(m).write([-0.0, 11.0, -0.0, 1.0])
        assert [math.copysign(1.0, lane.motor.pending) for lane in m.lanes] == [-1.0, 1.0, -1.0, 1.0]


@pytest.mark.parametrize(
    "wrong", [[1.0] * 3, [1.0] * 5, [[1.0] * 4], "1234", [True] * 4, [None] * 4, [1j] * 4, [10**400] * 4]
)
def test_what_is_no_array_of_so_many_numbers_is_an_error(box, wrong):
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises((RangeError, ValueError)):
            motors(m).write(wrong)
        assert [lane.motor.pending for lane in m.lanes] == [0.0] * 4


def test_the_callers_array_is_not_kept(box):
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        values = np.ones(4)
        motors(m).write(values)
        values[:] = 7.0
        assert [lane.motor.pending for lane in m.lanes] == [1.0] * 4
        read = motors(m).read()
        read[:] = 5.0
        assert motors(m).read().tolist() == [0.0] * 4


def test_states_one_for_all_or_one_for_each(box):
    machine = field()
    entries = {"lanes.1.lamp": {"inverted": True}}
    with connect(machine, wired(machine, box, entries=entries)) as m:
        lamps = Vector(lane.lamp for lane in m.lanes)
        lamps.write(OnOff.ON)
        m.update()
        assert lamps.read().tolist() == [1.0] * 4
        assert [box.get(f"lanes.{i}.lamp") for i in range(4)] == [1, 0, 1, 1]
        lamps.write([OnOff.ON, OnOff.OFF, OnOff.OFF, OnOff.ON])
        assert [lane.lamp.pending for lane in m.lanes] == [OnOff.ON, OnOff.OFF, OnOff.OFF, OnOff.ON]
        for wrong in (PassFail.PASS, [OnOff.ON] * 3, [OnOff.ON, OnOff.ON, 1, OnOff.ON], [PassFail.PASS] * 4):
            with pytest.raises(StateError):
                lamps.write(wrong)


def test_lamps_that_count_one_differently_take_states_all_the_same(box):
    machine = Field(lanes=[Lane(motor=actuator(), lamp=relay(one=one), encoder=sensor()) for one in OnOff])
    with connect(machine, wired(machine, box)) as m:
        lamps = Vector(lane.lamp for lane in m.lanes)
        lamps.write(OnOff.ON)
        m.update()
        assert [lane.lamp.read() for lane in m.lanes] == [OnOff.ON, OnOff.ON]
        assert lamps.read().tolist() == [1.0, 0.0]


def test_asynchronous_actuators_are_sent_at_once_in_one_transfer(box):
    machine = field(motor={"synchronous": False})
    with connect(machine, wired(machine, box)) as m:
        start = len(box.calls)
        motors(m).write([1.0, 2.0, 3.0, 4.0])
        assert [(call.segment, call.raws) for call in box.calls[start:]] == [("write_many", (2, 4, 6, 8))]
        assert motors(m).read().tolist() == [1.0, 2.0, 3.0, 4.0]
        assert motors(m).update() is True
        assert len(box.calls) == start + 1


def test_sensors_are_sampled_these_alone_or_read_now_when_asynchronous(box):
    machine = field(encoder={"synchronous": False})
    with connect(machine, wired(machine, box)) as m:
        encoders = Vector(lane.encoder for lane in m.lanes)
        for i in range(4):
            box.set(f"lanes.{i}.encoder", 2 * i)
        start = len(box.calls)
        assert encoders.read().tolist() == [0.0, 1.0, 2.0, 3.0]
        assert [call.segment for call in box.calls[start:]] == ["read_many"]
        assert encoders.sample() is True
        assert len(box.calls) == start + 1
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        encoders = Vector(lane.encoder for lane in m.lanes[1:3])
        box.set("lanes.1.encoder", 1000)
        assert encoders.sample() is False
        assert box.calls[-1].channels == ("lanes.1.encoder", "lanes.2.encoder")
        assert encoders.read().tolist() == [500.0, 2.0]
        with pytest.raises(DeclarationError, match="contains sensors"):
            encoders.write(1.0)


def test_the_quality_of_a_vector_is_a_new_array_in_its_order_and_read_gives_plain_numbers(box):
    machine = field(encoder={"incremental": True})
    with connect(machine, wired(machine, box)) as m:
        encoders = Vector(m.lanes[i].encoder for i in (3, 0, 1))
        for i in (1, 3):
            m.lanes[i].encoder.referenced()
        box.set("lanes.3.encoder", 1000)
        m.sample()
        expected = [Quality.OUT_OF_RANGE, Quality.UNREFERENCED, Quality.GOOD]
        assert encoders.quality.tolist() == expected
        assert encoders.quality.dtype == np.uint8
        assert encoders.read().tolist() == [500.0, 0.0, 0.0]
        for vector in (encoders, Vector(lane.encoder for lane in m.lanes)):
            vector.quality[:] = Quality.BAD
            assert Quality.BAD not in vector.quality
        assert Vector(lane.motor for lane in m.lanes).quality.tolist() == [Quality.GOOD] * 4


def test_update_of_a_vector_moves_these_alone_and_failures_list_them(box):
    machine = field()
    with connect(machine, wired(machine, box)) as m:
        vector = Vector([m.lanes[2].motor, m.lanes[0].motor])
        vector.write([1.0, 2.0])
        assert vector.update() is True
        assert (box.calls[-1].channels, box.calls[-1].raws) == (("lanes.2.motor", "lanes.0.motor"), (2, 4))
        box.at(len(box.calls), OSError("cut"))
        with pytest.raises(DriverError) as caught:
            vector.update()
        assert failed(caught.value) == ["lanes.2.motor", "lanes.0.motor"]


def test_a_vector_outlives_a_connection_and_learns_the_new_calibration():
    machine, box = field(), Scripted()
    vector = motors(machine)
    with pytest.raises(NotConnected):
        vector.write(1.0)
    with connect(machine, wired(machine, box)):
        vector.write(1.0)
    with pytest.raises(NotConnected):
        vector.read()
    with connect(machine, wired(machine, box, entries={"lanes.0.motor": {"resolution": 0.25, "maximum": 2.0}})) as m:
        vector.write(1.0)
        m.update()
        assert [box.get(f"lanes.{i}.motor") for i in range(4)] == [4, 2, 2, 2]
        with pytest.raises(RangeError):
            vector.write(3.0)


@pytest.mark.parametrize(
    "objects",
    [
        list,
        lambda: [actuator(), sensor()],
        lambda: [actuator(), actuator(synchronous=False)],
        lambda: [relay(), switch()],
        lambda: [actuator(), relay()],
        lambda: [Field(lanes=[])],
        lambda: [1],
        lambda: [actuator()] * 2,
        lambda: [actuator(), DigitalActuator("A", default=0, minimum=0, maximum=1, resolution=1)],
    ],
)
def test_a_vector_holds_like_objects_each_once(objects):
    with pytest.raises(DeclarationError):
        Vector(objects())


def test_a_vector_across_two_machines_is_refused_not_misdirected(box):
    one, other = field(2), field(2)
    with connect(one, wired(one, box)), connect(other, wired(other, Scripted())):
        with pytest.raises(DeclarationError, match="one machine"):
            Vector([one.lanes[0].motor, other.lanes[1].motor]).write(5.0)
        assert all(lane.motor.pending == 0.0 for lane in (*one.lanes, *other.lanes))


def test_it_is_a_sequence_of_its_objects():
    machine = field()
    vector = motors(machine)
    assert (len(vector), vector[1], list(vector)) == (4, machine.lanes[1].motor, [lane.motor for lane in machine.lanes])
    assert repr(vector) == "<Vector of 4: lanes.0.motor ... lanes.3.motor>"


def test_binary_objects_take_the_levels_that_read_returns():
    class Valves(Compound):
        valves: list[BinaryActuator[OnOff]]

    machine = Valves(valves=[BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(4)])
    with connect(machine) as m:
        vector = Vector(m.valves)
        assert vector.write(np.array([1.0, 0.0, 0.0, 1.0]))
        m.update()
        assert [valve.read() for valve in m.valves] == [OnOff.ON, OnOff.OFF, OnOff.OFF, OnOff.ON]
        assert vector.read().tolist() == [1.0, 0.0, 0.0, 1.0]
        for wrong in ([1.0, 0.0, 0.5, 0.0], [1.0, 0.0], [np.nan] * 4):
            with pytest.raises(StateError):
                vector.write(np.array(wrong))
        assert m.valves[0].pending is OnOff.ON


def test_some_of_a_vector_are_written(box):
    some = np.array([True, False, True])
    motors = [actuator(**extra) for extra in ({}, {"limits": "clamp"}, {"synchronous": True})]
    machine = Motors(timer=timer(), motors=motors)
    with connect(machine, wired(machine, box)) as m:
        vector = Vector(m.motors)
        assert vector.write([1.0, 99.0, 3.0], where=some) is True
        assert vector.write(5.0, where=~some) is True
        assert vector.pending.tolist() == [1.0, 5.0, 3.0]
        with pytest.raises(RangeError, match=r"motors.2: 11 V is outside"):
            vector.write([2.0, 2.0, 11.0], where=some)
        with pytest.raises(RangeError, match="is not an array of 3 numbers"):
            vector.write([2.0, 2.0], where=some)
        with pytest.raises(RangeError, match="is not an array of 3 booleans"):
            vector.write(2.0, where=[True, False, True])
        assert vector.write(99.0, where=~some) is False
        assert vector.write(2.0, where=np.zeros(3, np.bool_)) is True
        assert vector.pending.tolist() == [1.0, 10.0, 3.0]


def test_some_states_of_a_vector_are_written_at_once_where_they_are_asynchronous(box):
    machine = Valves(timer=timer(), valves=[relay(synchronous=False) for _ in range(3)])
    with connect(machine, wired(machine, box)) as m:
        assert Vector(m.valves).write(OnOff.ON, where=np.array([False, True, True])) is True
        assert [box.get(f"valves.{i}") for i in range(3)] == [0, 1, 1]


class Motors(Compound):
    timer: DigitalSensor
    motors: list[DigitalActuator]


class Valves(Compound):
    timer: DigitalSensor
    valves: list[BinaryActuator[OnOff]]


@pytest.mark.parametrize("wrong", [1.0, True, None, OnOff, "ON"])
def test_what_is_no_state_is_a_state_error(wrong: Any) -> None:
    machine = bench()
    with connect(machine, wired(machine, Scripted())) as m, pytest.raises(StateError):
        Vector([m.valve]).write(wrong)


def test_lists_of_different_lengths_are_a_range_error() -> None:
    machine = bench()
    with connect(machine, wired(machine, Scripted())) as m, pytest.raises(RangeError):
        Vector([m.motor]).write([1.0, [2.0]])  # type: ignore[list-item]

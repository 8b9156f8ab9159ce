"""Experiments on loops of a connected machine, in virtual time: what they do, and that they always end at the old
output, with the law in control."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import nan
from typing import Any

import numpy as np
import pytest

from helpers.operator import Operator
from helpers.tiers import first
from umo import BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Vector, connect
from umo.control import PID, Cascade, Servo, VectorServo
from umo.control.excitation import Baseline, RelaySwitching
from umo.cycle.events import CommandState, Event
from umo.errors import BadInput
from umo.operation.commands.client_commands import Mode
from umo.states import OnOff
from umo.testing import put

PERIOD = 0.1
GOAL, REST = 50.0, 20.0
"""The setpoint, and what is measured without heating."""


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor


class Oven(Compound):
    """A first order with 0.3 s of dead time, under a Servo; two zones under one VectorServo; a PID of its own."""

    heater: DigitalActuator
    temperature: DigitalSensor
    door: BinarySensor[OnOff]
    zones: tuple[Zone, ...]
    timer: DigitalSensor
    acts = True
    later: Any = None
    outer: Any = None

    def setup(self) -> None:
        self.servo = Servo(self.temperature, self.heater, gain=2.0, integral_time=10.0)
        temperatures = Vector(zone.temperature for zone in self.zones)
        self.heating = VectorServo(
            temperatures, Vector(zone.heater for zone in self.zones), gain=2.0, integral_time=10.0
        )
        self.level = PID(gain=1.0)

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.door.read() is OnOff.ON, [self.heater], "the door is open")

    def control(self) -> None:
        if self.acts:
            self.servo.control(GOAL, dt=self.dt)
            self.heating.control(GOAL, dt=self.dt)


class Rig:
    """The oven with its plant, at rest at the setpoint, in manual mode, under an operator who has the lease."""

    def __init__(self, m: Oven) -> None:
        self.m, self.operator = m, Operator(m, Mode.MANUAL)
        self.levels = {
            item.path: [GOAL, *[GOAL - REST] * 3] for item in (m.temperature, *(zone.temperature for zone in m.zones))
        }
        """Of each sensor what it measures, then the outputs on their way to it."""
        put(m.door, OnOff.OFF)
        m.servo.integral, m.heating.integral = GOAL - REST, np.full(2, GOAL - REST)
        for sensor in (m.temperature, *(zone.temperature for zone in m.zones)):
            put(sensor, GOAL)
        self.run(400)
        self.operator.do("lease")
        self.old = m.heater.read()
        assert self.old == pytest.approx(GOAL - REST, abs=0.1)

    def run(self, count: int = 1) -> None:
        for _ in range(count):
            pairs = ((self.m.heater, self.m.temperature), *((zone.heater, zone.temperature) for zone in self.m.zones))
            for heater, sensor in pairs:
                state = self.levels[sensor.path]
                state.append(heater.read())
                state[0] += PERIOD / 5.0 * (REST + 1.0 * state.pop(1) - state[0])
                put(sensor, state[0])
            self.operator.run()

    def begin(self, path: str = "servo", kind: str = "relay", **more: Any) -> int:
        arguments = {"kind": kind, "amplitude": 10.0, **more}
        number = self.operator.send("call", f"{path}.experiment", arguments=arguments)
        self.run()
        return number

    def last(self, number: int) -> Event:
        return [event for event in self.operator.events if event.command == number][-1]

    def assert_back(self) -> None:
        """The law is in control, and comes back to where it was."""
        assert "step" not in vars(self.m.servo)
        self.run(600)
        assert self.m.temperature.read() == pytest.approx(GOAL, abs=0.5)
        assert self.m.heater.read() == pytest.approx(self.old, abs=1.0)


def parts() -> dict[str, Any]:
    return {
        "heater": DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.001),
        "temperature": DigitalSensor("degC", minimum=0.0, maximum=200.0, resolution=0.001),
    }


@contextmanager
def rig() -> Iterator[Rig]:
    oven = Oven(
        **parts(),
        door=BinarySensor(OnOff, one=OnOff.ON),
        zones=(Zone(**parts()), Zone(**parts())),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
    wires: dict[str, Any] = {path: {"driver": "simulated"} for path in ("heater", "temperature", "door")}
    wires |= {f"zones.{n}.{name}": {"driver": "simulated"} for n in (0, 1) for name in ("heater", "temperature")}
    wires["timer"] = {"driver": "simulated", "period": PERIOD}
    with connect(oven, {"wire": wires}) as m:
        yield Rig(m)


def result_of(event: Event) -> dict[str, Any]:
    assert event.state is CommandState.DONE, event.text
    found: dict[str, Any] = json.loads(event.text)
    return found


def test_a_relay_swings_around_the_old_output_and_ends_at_it() -> None:
    with rig() as each:
        number = each.begin(cycles=3)
        seen = []
        while each.last(number).state is CommandState.BEGUN:
            each.run()
            seen.append(each.m.heater.read())
        found = result_of(each.last(number))
        assert found["output"] == pytest.approx(each.old, abs=0.5)
        assert max(seen) == pytest.approx(found["output"] + 10.0, abs=0.01)
        assert min(seen) == pytest.approx(found["output"] - 10.0, abs=0.01)
        assert seen[-1] == pytest.approx(found["output"], abs=0.01)
        rises = [b - a for a, b in pairwise(seen) if b - a > 12.0]
        assert rises == pytest.approx([20.0, 20.0, 15.0], abs=0.01)  # the last cycle goes up by half
        each.assert_back()


def test_a_relay_goes_up_by_the_whole_amplitude_again_where_half_of_it_does_not_turn_the_measurement() -> None:
    base = Baseline()
    base.add(50.0, 0.0, 1.0)
    relay, value, seen = RelaySwitching(base, 10.0, True, 4.0, 3), 0.0, list[float]()
    while (output := relay.next(value, 1.0)) is not None:
        value += 0.1 * ((output - 50.0) * 0.6 - value)  # half of the amplitude moves it by 3, the hysteresis is 4
        seen.append(output)
        assert len(seen) < 300
    assert set(seen) == {40.0, 55.0, 60.0}
    assert seen[seen.index(55.0) :].count(60.0) > 0


def test_a_step_goes_half_of_the_way_back_when_the_measurement_has_settled() -> None:
    with rig() as each:
        number = each.begin(kind="step")
        seen = []
        while each.last(number).state is CommandState.BEGUN:
            each.run()
            seen.append(each.m.heater.read())
        found = result_of(each.last(number))
        up, half = (sum(value == pytest.approx(found["output"] + by, abs=0.01) for value in seen) for by in (10.0, 5.0))
        assert up == pytest.approx(half, abs=2)
        assert 80 < up < 450
        each.assert_back()


def test_a_step_ends_where_the_measurement_leaves_its_bound() -> None:
    with rig() as each:
        number = each.begin(kind="step", within=4.0)
        each.run(100)
        assert result_of(each.last(number))["ended"].startswith("the measurement has moved by 4.")
        each.assert_back()


def test_an_element_of_a_vector_is_excited_and_the_others_are_not() -> None:
    with rig() as each:
        number = each.begin("zones.1", cycles=2)
        seen: list[tuple[float, float]] = []
        while each.last(number).state is CommandState.BEGUN:
            each.run()
            seen.append((each.m.zones[0].heater.read(), each.m.zones[1].heater.read()))
        assert max(b for _, b in seen) - min(b for _, b in seen) == pytest.approx(20.0, abs=0.1)
        assert max(a for a, _ in seen) - min(a for a, _ in seen) < 1.0
        assert "step" not in vars(each.m.heating)
        each.assert_back()


@pytest.mark.parametrize("path", ["servo", "heater", "temperature"])
def test_a_loop_is_found_by_its_law_its_sensor_or_its_actuator(path: str) -> None:
    with rig() as each:
        found = json.loads(each.operator.call(f"{path}.law").text)
        assert (found["law"], found["sensor"], found["actuator"]) == ("servo", "temperature", "heater")
        assert (found["gain"], found["integral_time"], found["dt"]) == (2.0, 10.0, PERIOD)


@pytest.mark.parametrize("path", ["servo", "heater", "later"])
def test_a_law_that_was_made_after_connecting_is_the_one_that_is_found(path: str) -> None:
    with rig() as each:
        assert json.loads(each.operator.call("servo.law").text)["gain"] == 2.0
        each.m.servo = each.m.later = Servo(each.m.temperature, each.m.heater, gain=7.0, integral_time=10.0)
        assert json.loads(each.operator.call(f"{path}.law").text)["gain"] == 7.0


def test_an_outer_law_that_was_made_after_connecting_is_held_too() -> None:
    with rig() as each:
        outer = each.m.outer = Cascade(each.m.temperature, each.m.servo, gain=1.0, low=0.0, high=100.0)
        number = each.begin()
        assert each.last(number).state is CommandState.BEGUN
        assert "step" in vars(outer)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("sevro", "no law 'sevro'; there are: servo, "),
        ("door", "door has no law; there are: "),
        ("heating", "no law 'heating'; there are: servo, "),
        ("heating.7", "no law 'heating.7'"),
    ],
)
def test_a_path_that_names_no_loop_is_refused(path: str, message: str) -> None:
    with rig() as each:
        assert message in each.operator.call(f"{path}.experiment", kind="relay", amplitude=1.0).text


def test_what_cannot_be_done_is_refused_before_anything_is_written() -> None:
    with rig() as each:
        assert "amplitude" in each.last(each.begin(amplitude=-10.0)).text
        number = each.begin(amplitude=40.0)
        each.run(40)
        assert re.search(
            r": at most a relay of [\d.]+% or a step of [\d.]+% or a step of -[\d.]+% fits", each.last(number).text
        )
        assert each.m.heater.read() == pytest.approx(each.old, abs=0.5)
        first = each.begin()
        assert "in progress" in each.last(each.begin("heater")).text
        assert each.last(first).state is CommandState.BEGUN
        each.operator.mode("automatic")
        assert "manual mode" in each.last(each.begin()).text


# However it ends -------------------------------------------------------------------------------------------


def client_died(each: Rig) -> None:
    each.operator.alive = False


def lease_given_back(each: Rig) -> None:
    each.operator.send("give back")


def cancelled(each: Rig) -> None:
    each.operator.send("cancel", "servo.experiment")


def let_go(each: Rig) -> None:
    each.operator.send("let go", "servo.experiment")


def mode_changed(each: Rig) -> None:
    each.operator.send("mode", value="automatic")


def door_opened(each: Rig) -> None:
    put(each.m.door, OnOff.ON)


def program_wrote(each: Rig) -> None:
    """Some other code writes the actuator after the law."""
    law = each.m.servo.control
    vars(each.m.servo)["control"] = lambda *a, **k: (
        law(*a, **k),
        each.m.heater.write(33.0),
        vars(each.m.servo).pop("control"),
    )


def out_of_band(each: Rig) -> None:
    each.levels["temperature"][0] += 30.0


ENDS = [client_died, lease_given_back, cancelled, let_go, mode_changed, door_opened, program_wrote, out_of_band]


@pytest.mark.parametrize("kind", first(1, ["relay", "step"]))
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("after", first(1, [25, 5, 47]))
def test_however_it_ends_the_old_output_comes_back_and_the_law_is_in_control(end: Any, kind: str, after: int) -> None:
    with rig() as each:
        number = each.begin(kind=kind)
        each.run(after)
        assert each.last(number).state is CommandState.BEGUN
        excited = abs(each.m.heater.read() - each.old) > 5.0
        assert excited is (after > 20)
        end(each)
        seen = []
        for _ in range(20):
            each.run()
            seen.append(each.m.heater.read())
        if excited:
            assert each.last(number).state in (CommandState.CANCELLED, CommandState.FAILED, CommandState.DONE)
        if end is door_opened:
            assert seen[-1] == 0.0
            put(each.m.door, OnOff.OFF)
        elif excited:
            assert any(value == pytest.approx(each.old, abs=0.5) for value in seen[:8])
        if excited:
            each.operator.alive = True
            each.assert_back()


def test_a_law_that_no_longer_acts_ends_it_at_the_old_output() -> None:
    with rig() as each:
        number = each.begin()
        each.run(30)
        each.m.acts = False
        each.run(10)
        assert "the law does not act" in each.last(number).text
        assert each.m.heater.read() == pytest.approx(each.old, abs=0.5)
        each.m.acts = True
        each.assert_back()


def test_a_bad_sensor_ends_the_run_with_the_default_and_the_law_as_it_was() -> None:
    with rig() as each:
        each.begin()
        each.run(30)
        integral = each.m.servo.integral
        put(each.m.temperature, 500.0)
        with pytest.raises(BadInput):
            each.operator.run()
        each.operator.clients.cancel()
        assert each.m.heater.pending == pytest.approx(each.old, abs=0.5)
        assert each.m.servo.integral == integral
        heater = each.m.heater
    assert heater.connected is False


def test_a_pid_without_objects_is_excited_by_its_caller() -> None:
    with rig() as each:
        each.m.level.integral = 5.0
        seen = []
        number = each.begin("level", kind="step", amplitude=1.0, duration=5.0)
        for _ in range(200):
            each.run()
            seen.append(each.m.level.step(0.0, 0.0, PERIOD, low=0.0, high=10.0))
        assert each.last(number).state is CommandState.DONE
        assert max(seen) == 6.0
        assert seen[-1] == 5.0


def test_measurements_that_are_not_finite_end_it() -> None:
    with rig() as each:
        number = each.begin("level", kind="step", amplitude=1.0)
        for _ in range(50):
            each.run()
            each.m.level.step(0.0, 0.0, PERIOD)
        for _ in range(10):
            each.run()
            with pytest.raises(Exception, match="not finite"):
                each.m.level.step(0.0, nan, PERIOD)
        assert "the law does not act" in each.last(number).text
        assert "step" not in vars(each.m.level) or each.m.level.step(0.0, 0.0, PERIOD) == 0.0


# Parts with rates of their own, and equipment --------------------------------------------------------------


class Boiler(Compound, every="0.3 s", equipment=True):
    heater: DigitalActuator
    temperature: DigitalSensor

    def setup(self) -> None:
        self.servo = Servo(self.temperature, self.heater, gain=2.0, integral_time=10.0)
        self.servo.integral = 30.0

    def control(self) -> None:
        self.servo.control(GOAL, dt=self.dt)


class House(Compound):
    boiler: Boiler
    timer: DigitalSensor


def test_a_part_with_a_rate_is_excited_at_its_rate_and_its_fault_ends_it() -> None:
    timer = DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    wires: dict[str, Any] = {f"boiler.{name}": {"driver": "simulated"} for name in ("heater", "temperature")}
    wires["timer"] = {"driver": "simulated", "period": PERIOD}
    with connect(House(boiler=Boiler(**parts()), timer=timer), {"wire": wires}) as m:
        operator = Operator(m, Mode.MANUAL)
        put(m.boiler.temperature, GOAL)
        operator.run()
        operator.do("lease")
        operator.run(9)
        assert json.loads(operator.call("boiler.law").text)["dt"] == pytest.approx(0.3)
        number = operator.send("call", "boiler.experiment", arguments={"kind": "step", "amplitude": 10.0})
        operator.run(3 * 20 - 3)
        assert m.boiler.heater.read() == pytest.approx(30.0)
        operator.run(12)
        assert m.boiler.heater.read() == pytest.approx(40.0)
        put(m.boiler.temperature, 500.0)
        operator.run(6)
        event = [each for each in operator.events if each.command == number][-1]
        assert event.state is CommandState.CANCELLED
        assert "OUT_OF_RANGE" in event.text or "boiler is in fault" in event.text
        assert m.boiler.heater.read() == 0.0
        put(m.boiler.temperature, GOAL)
        operator.do("clear", "boiler")
        operator.run(12)
        assert m.boiler.heater.read() == pytest.approx(30.0)
        assert "step" not in vars(m.boiler.servo)


class SlowOven(Compound, every=10):
    """A first order under a Servo, in every tenth period."""

    heater: DigitalActuator
    temperature: DigitalSensor
    acts = True

    def setup(self) -> None:
        self.servo = Servo(self.temperature, self.heater, gain=2.0, integral_time=10.0)

    def control(self) -> None:
        if self.acts:
            self.servo.control(GOAL, dt=self.dt)


class Hall(Compound):
    oven: SlowOven
    timer: DigitalSensor


@pytest.mark.parametrize("acts", [True, False])
def test_a_law_at_a_rate_of_its_own_is_waited_for(acts: bool) -> None:
    timer = DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    wires: dict[str, Any] = {f"oven.{name}": {"driver": "simulated"} for name in parts()}
    wires["timer"] = {"driver": "simulated", "period": PERIOD}
    with connect(Hall(oven=SlowOven(**parts()), timer=timer), {"wire": wires}) as m:
        m.oven.servo.integral = GOAL - REST
        put(m.oven.temperature, GOAL)
        operator = Operator(m, Mode.MANUAL)
        operator.do("lease")
        m.oven.acts = acts
        assert json.loads(operator.call("oven.servo.law").text)["dt"] == 10 * PERIOD
        arguments = {"kind": "step", "amplitude": 10.0, "duration": 30.0}
        number = operator.send("call", "oven.servo.experiment", arguments=arguments)
        operator.run(700)
        events = [event for event in operator.events if event.command == number]
        told = events[-1].text
        assert ("the time limit was reached" in told) if acts else ("the law does not act" in told), told

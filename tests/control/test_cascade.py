"""The cascade of two laws: how it calculates, and that experiments on it always end at the old setpoint."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from helpers.operator import Operator
from umo import BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.control import Cascade, Servo
from umo.cycle.events import CommandState, Event
from umo.errors import BadInput, DeclarationError
from umo.operation.commands.client_commands import Mode
from umo.states import OnOff
from umo.testing import put

PERIOD = 0.1
GOAL, OLD = 40.0, 50.0
"""What the outer law is to keep, and the inner setpoint that keeps it."""


class Reactor(Compound):
    heater: DigitalActuator
    jacket: DigitalSensor
    vessel: DigitalSensor
    door: BinarySensor[OnOff]
    timer: DigitalSensor
    target: float = GOAL

    def setup(self) -> None:
        self.inner = Servo(self.jacket, self.heater, gain=1.0, integral_time=0.5)
        self.outer = Cascade(self.vessel, self.inner, low=10.0, high=90.0, gain=2.0, integral_time=8.0)

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.door.read() is OnOff.ON, [self.heater], "the door is open")

    def control(self) -> None:
        self.outer.control(self.target, dt=self.dt)


class Rig:
    """The reactor with its plant, at rest, in manual mode, under an operator who has the lease."""

    def __init__(self, m: Reactor) -> None:
        self.m, self.operator = m, Operator(m, Mode.MANUAL)
        self.jacket, self.vessel = OLD, GOAL
        m.inner.integral, m.outer.integral = OLD / 2.0, OLD
        put(m.door, OnOff.OFF)
        self.run(20)
        self.operator.do("lease")
        assert m.inner.setpoint == pytest.approx(OLD, abs=0.2)

    def run(self, count: int = 1) -> None:
        for _ in range(count):
            self.vessel += PERIOD / 6.0 * (0.8 * self.jacket - self.vessel)
            self.jacket += PERIOD / 0.5 * (2.0 * self.m.heater.read() - self.jacket)
            put(self.m.jacket, self.jacket)
            put(self.m.vessel, self.vessel)
            self.operator.run()

    def begin(self, path: str = "outer", kind: str = "relay", **more: Any) -> int:
        number = self.operator.send("call", f"{path}.experiment", arguments={"kind": kind, "amplitude": 10.0, **more})
        self.run()
        return number

    def last(self, number: int) -> Event:
        return [event for event in self.operator.events if event.command == number][-1]

    @property
    def setpoint(self) -> float:
        """Of the inner law."""
        return self.m.inner.setpoint


@contextmanager
def rig() -> Iterator[Rig]:
    def sensor() -> DigitalSensor:
        return DigitalSensor("degC", minimum=0.0, maximum=200.0, resolution=0.001)

    reactor = Reactor(
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.001),
        jacket=sensor(),
        vessel=sensor(),
        door=BinarySensor(OnOff, one=OnOff.ON),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
    wires: dict[str, Any] = {path: {"driver": "simulated"} for path in ("heater", "jacket", "vessel", "door")}
    with connect(reactor, {"wire": wires | {"timer": {"driver": "simulated", "period": PERIOD}}}) as m:
        yield Rig(m)


# The law ---------------------------------------------------------------------------------------------------


def test_the_inner_setpoint_stays_within_the_limits_of_the_outer_law() -> None:
    with rig() as each:
        each.m.target = 150.0
        each.run(5)
        assert each.setpoint == 90.0
        each.m.target = 0.0
        each.run(5)
        assert each.setpoint == 10.0


def test_the_outer_integral_does_not_grow_while_the_inner_law_is_limited() -> None:
    with rig() as each:
        each.m.inner.limit = 26.0
        each.m.target = 50.0
        each.run(100)
        stood = each.m.outer.integral
        each.run(300)
        assert each.m.heater.read() == 26.0
        assert each.m.outer.integral == stood
        each.m.target = 30.0
        each.run(10)
        assert each.m.outer.integral < stood


def test_an_inner_sensor_that_is_bad_leaves_the_integrals_as_they_were() -> None:
    with rig() as each:
        each.m.target = 50.0
        before = each.m.outer.integral, each.m.inner.integral
        put(each.m.jacket, 500.0)
        with pytest.raises(BadInput, match="jacket"):
            each.operator.run()
        assert (each.m.outer.integral, each.m.inner.integral) == before


def test_limits_in_the_wrong_order_are_refused() -> None:
    with rig() as each, pytest.raises(DeclarationError, match=r"Cascade: low 5\.0 must be below high 5\.0"):
        Cascade(each.m.vessel, each.m.inner, low=5.0, high=5.0, gain=1.0)


# Experiments -----------------------------------------------------------------------------------------------


def test_the_law_tells_its_inner_law_as_its_output() -> None:
    with rig() as each:
        told = json.loads(each.operator.call("outer.law").text)
        assert (told["sensor"], told["actuator"]) == ("vessel", "inner.setpoint")
        assert (told["low"], told["high"]) == (10.0, 90.0)
        assert (told["inner"], told["inner_sensor"]) == ("inner", "jacket")
        assert json.loads(each.operator.call("heater.law").text)["law"] == "inner"
        assert json.loads(each.operator.call("vessel.law").text)["law"] == "outer"


def test_a_relay_swings_the_inner_setpoint_and_ends_at_the_old_one() -> None:
    with rig() as each:
        number, seen = each.begin(cycles=3), []
        while each.last(number).state is CommandState.BEGUN:
            each.run()
            seen.append(each.setpoint)
        assert each.last(number).state is CommandState.DONE, each.last(number).text
        assert max(seen) == pytest.approx(OLD + 10.0, abs=0.2)
        assert min(seen) == pytest.approx(OLD - 10.0, abs=0.2)
        assert seen[-1] == pytest.approx(OLD, abs=0.2)
        assert "step" not in vars(each.m.outer)


def test_the_limits_of_the_outer_law_bound_the_experiment() -> None:
    with rig() as each:
        number = each.begin(amplitude=45.0)
        each.run(40)
        assert "in a range of 10 to 90" in each.last(number).text
        assert "at most a relay of 49% or" in each.last(number).text


def client_died(each: Rig) -> None:
    each.operator.alive = False


def lease_given_back(each: Rig) -> None:
    each.operator.send("give back")


def cancelled(each: Rig) -> None:
    each.operator.send("cancel", "outer.experiment")


def mode_changed(each: Rig) -> None:
    each.operator.send("mode", value="automatic")


def door_opened(each: Rig) -> None:
    put(each.m.door, OnOff.ON)


def program_wrote(each: Rig) -> None:
    """Some other code calls the inner law after the outer one."""
    law = each.m.outer.control

    def control(*given: Any, **more: Any) -> None:
        law(*given, **more)
        each.m.inner.control(33.0, dt=PERIOD)
        vars(each.m.outer).pop("control")

    vars(each.m.outer)["control"] = control


def out_of_band(each: Rig) -> None:
    each.vessel += 30.0


@pytest.mark.parametrize("kind", ["relay", "step"])
@pytest.mark.parametrize(
    "end", [client_died, lease_given_back, cancelled, mode_changed, door_opened, program_wrote, out_of_band]
)
def test_however_it_ends_the_old_setpoint_comes_back_and_the_laws_are_in_control(end: Any, kind: str) -> None:
    with rig() as each:
        number = each.begin(kind=kind)
        each.run(25)
        assert abs(each.setpoint - OLD) > 8.0
        end(each)
        seen = []
        for _ in range(20):
            each.run()
            seen.append(each.setpoint)
        assert each.last(number).state in (CommandState.CANCELLED, CommandState.FAILED, CommandState.DONE)
        assert any(value == pytest.approx(OLD, abs=0.2) for value in seen)
        assert "step" not in vars(each.m.outer)
        put(each.m.door, OnOff.OFF)
        each.operator.alive = True
        each.run(900)
        assert each.vessel == pytest.approx(GOAL, abs=0.5)
        assert each.setpoint == pytest.approx(OLD, abs=1.0)


def test_the_outer_law_holds_the_inner_setpoint_while_the_inner_law_is_in_an_experiment() -> None:
    with rig() as each:
        number = each.begin("inner", kind="step")
        seen, integral = [], each.m.outer.integral
        while each.last(number).state is CommandState.BEGUN:
            each.run()
            seen.append(each.setpoint)
        assert each.last(number).state is CommandState.DONE, each.last(number).text
        assert max(seen[:-1]) - min(seen[:-1]) < 0.01
        assert each.m.outer.integral == pytest.approx(integral, abs=0.3)  # the last period is its own
        assert "step" not in vars(each.m.outer)
        assert not (each.m.inner.limited or each.m.outer.limited)


@pytest.mark.parametrize(("first", "second"), [("outer", "inner"), ("inner", "outer")])
def test_one_law_of_a_cascade_is_excited_at_a_time(first: str, second: str) -> None:
    with rig() as each:
        running = each.begin(first)
        assert "in progress" in each.last(each.begin(second)).text
        each.run(5)
        assert each.last(running).state is CommandState.BEGUN

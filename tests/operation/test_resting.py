"""What becomes of the outputs of a part while it is held, suspended or paused."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.machines import actuator, relay, timer, wired
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, connect
from umo.control import next_period
from umo.errors import TaskFailed
from umo.operation import PackML, Procedure
from umo.states import OnOff
from umo.testing import Scripted, periods


async def work(states: Any) -> None:
    part = states.part
    part.motor.write(5.0)
    part.grip.write(OnOff.ON)
    part.inner.fan.write(2.0)
    while True:
        await next_period()


class Runs(PackML):
    async def execute(self) -> None:
        await work(self)


class Makes(Procedure):
    async def execute(self) -> None:
        await work(self)


class Brakes(Makes):
    """It has a sequence for a hold, and none for a pause."""

    async def holding(self) -> None:
        self.part.motor.write(1.0)

    async def restarting(self) -> None:
        self.part.motor.write(4.0)


class Starts(PackML):
    """It drives the motor while it starts."""

    async def starting(self) -> None:
        await work(self)


class Inner(Compound, equipment=True):
    fan: DigitalActuator
    own: bool = False

    def setup(self) -> None:
        if self.own:
            self.unit = PackML(self)


class Part(Compound, equipment=True):
    motor: DigitalActuator
    grip: BinaryActuator[OnOff]
    law: DigitalActuator
    inner: Inner
    states: Any = Runs

    def setup(self) -> None:
        self.unit = self.states(self)

    def control(self) -> None:
        self.law.write(3.0)


class Plant(Compound):
    part: Part
    timer: DigitalSensor


class Rig:
    def __init__(self, states: Any, own: bool = False, synchronous: bool = True) -> None:
        parts: dict[str, Any] = {"motor": actuator(synchronous=synchronous), "law": actuator()}
        inner = Inner(fan=actuator(), own=own)
        part = Part(grip=relay(when_suspended="hold"), inner=inner, states=states, **parts)
        self.m = Plant(part=part, timer=timer())
        self.connection = connect(self.m, wired(self.m, Scripted()))
        self.connection.__enter__()
        periods(self.m)
        if isinstance(self.unit, PackML):
            self.do("reset")
        self.do("start")

    @property
    def unit(self) -> Any:
        return self.m.part.unit

    @property
    def driven(self) -> tuple[float, str, float, float]:
        """Motor, grip, the output of the law, the fan."""
        part = self.m.part
        return part.motor.read(), str(part.grip.read()), part.law.read(), part.inner.fan.read()

    def do(self, command: str) -> None:
        getattr(self.unit, command)()
        periods(self.m, 3)


@pytest.fixture
def rig() -> Any:
    made: list[Rig] = []

    def make(*given: Any, **more: Any) -> Rig:
        made.append(Rig(*given, **more))
        return made[-1]

    yield make
    for each in made:
        each.connection.__exit__(None, None, None)


WORKING, RESTING = (5.0, "ON", 3.0, 2.0), (0.0, "ON", 3.0, 0.0)


@pytest.mark.parametrize("synchronous", [True, False])
@pytest.mark.parametrize(
    ("states", "wait", "go_on"),
    [(Runs, "hold", "unhold"), (Runs, "suspend", "unsuspend"), (Makes, "pause", "resume"), (Makes, "hold", "restart")],
)
def test_what_the_work_drives_is_at_its_default_while_it_waits_and_is_restored(
    rig: Any, states: Any, wait: str, go_on: str, synchronous: bool
) -> None:
    it = rig(states, synchronous=synchronous)
    assert it.driven == WORKING
    it.do(wait)
    assert it.driven == RESTING
    it.do(go_on)
    assert it.driven == WORKING


def test_a_part_that_says_what_is_done_in_a_hold_is_not_touched_then_but_in_a_pause(rig: Any) -> None:
    it = rig(Brakes)
    it.do("hold")
    assert it.driven == (1.0, "ON", 3.0, 2.0)
    it.do("restart")
    assert it.driven == (4.0, "ON", 3.0, 2.0)
    it.do("pause")
    assert it.driven == RESTING
    it.do("resume")
    assert it.driven == (4.0, "ON", 3.0, 2.0)


def test_a_hold_while_it_is_paused_restores_what_the_pause_has_found_as_far_as_nothing_else_was_written(
    rig: Any,
) -> None:
    it = rig(Brakes)
    it.do("pause")
    it.do("hold")
    assert it.driven == (1.0, "ON", 3.0, 0.0)
    it.do("restart")
    assert it.driven == (4.0, "ON", 3.0, 2.0)


def test_what_was_driven_while_it_was_starting_rests_too(rig: Any) -> None:
    it = rig(Starts)
    assert it.driven == WORKING
    it.do("hold")
    assert it.driven == RESTING
    it.do("unhold")
    assert it.driven == WORKING


def test_what_is_stopped_while_it_waits_is_not_restored(rig: Any) -> None:
    it = rig(Runs)
    it.do("hold")
    it.do("stop")
    it.do("reset")
    assert it.driven == RESTING


def test_what_a_fault_has_ended_is_not_restored_when_the_work_goes_on(rig: Any) -> None:
    it = rig(Runs)
    it.do("hold")
    it.connection.machine.equipment.contain(it.m.part.inner, TaskFailed("the fan"))
    it.m.cycle.clear()
    it.do("unhold")
    assert it.driven == (5.0, "ON", 3.0, 0.0)


def test_a_part_within_that_has_states_of_its_own_is_not_touched(rig: Any) -> None:
    it = rig(Runs, own=True)
    it.do("hold")
    assert it.driven == (0.0, "ON", 3.0, 2.0)

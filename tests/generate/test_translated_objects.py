"""What control code asks of objects and does with them, in C beside Python; what has no C is refused in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, wired
from helpers.machines import actuator, relay, sensor, timer
from tools.compiled_machine import CompiledMachine
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, LookupTable
from umo.errors import RangeError
from umo.generate.controller_folder import TARGETS
from umo.generate.controller_model import laid_out
from umo.generate.translator import translate
from umo.objects import Vector
from umo.states import OnOff
from umo.testing import VirtualTimer


class Asking(Compound):
    """Control code that asks for times, raw integers and offsets, and homes its encoder."""

    timer: DigitalSensor
    level: DigitalSensor
    encoder: DigitalSensor
    motor: DigitalActuator
    pump: BinaryActuator[OnOff]
    valve: BinaryActuator[OnOff]

    def setup(self) -> None:
        self.age = self.offset = self.accepted = 0.0
        self.raw = 0
        self.refused = 0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.level.read() > 60.0, [self.motor], "too far")
        yield Interlock(lambda: self.motor.inhibited is not None, [self.valve], "the motor stands")
        yield Interlock(lambda: self.now - self.level.time > 0.002, [self.pump], "not read for 2 ms", latched=True)

    def control(self) -> None:
        level = self.level.read()
        self.age = self.now - self.level.time
        self.accepted = self.motor.time
        self.motor.write(level * 0.1)
        self.pump.write(OnOff.ON if level > 30.0 else OnOff.OFF)
        self.raw = self.pump.raw
        self.valve.write(OnOff.ON)
        if level > 55.0:
            self.encoder.referenced(at=level)
        elif level < 5.0:
            self.encoder.referenced(known=False)
        elif level < 10.0:
            self.encoder.referenced()
        self.offset = self.encoder.zero_offset
        try:
            self.motor.write(level > 50.0)
        except RangeError:
            self.refused += 1


def asking() -> Asking:
    encoder = sensor(incremental=True, on_error="mark", velocity=0.0)
    valve = relay(synchronous=False)
    level = sensor(on_error="mark", resolution=0.3)
    return Asking(timer=timer(), level=level, encoder=encoder, motor=actuator(), pump=relay(), valve=valve)


@needs_a_compiler
def test_what_control_code_asks_of_objects_is_the_same(tmp_path: Path) -> None:
    def act(m: Asking, controller: CompiledMachine) -> None:
        if m.level.read() < 20.0:
            m.acknowledge()
            controller.acknowledge()

    assert Beside.play(asking(), tmp_path, 300, act)[None] > 100


class Bench(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    slow: DigitalSensor
    bent: DigitalSensor
    motor: DigitalActuator

    def setup(self) -> None:
        self.slows = Vector([self.slow])


def refusals(law: Callable[[Any], object] | None = None, condition: Callable[[Any], object] | None = None) -> str:
    """What is told of a machine with this law, or this condition."""

    class Tried(Bench):
        def interlocks(self) -> Iterator[Interlock]:
            if condition is not None:
                yield Interlock(lambda: condition(self), [self.motor], "why")  # type: ignore[arg-type, return-value]

        def control(self) -> None:
            if law is not None:
                law(self)

    bent = sensor(maximum=9.0, incremental=True, linearization=LookupTable([0, 5, 200], [0.0, 2.0, 9.0]))
    parts: dict[str, Any] = {"level": sensor(), "slow": sensor(synchronous=False), "bent": bent, "motor": actuator()}
    machine = Tried(timer=timer(), **parts)
    with laid_out(machine, wired(machine, Fragile(), VirtualTimer())) as model:
        found = translate(machine, model.conditions, model.steps, TARGETS["host"])
        return "\n".join(map(str, [*found.problems, *found.on_host]))


LAWS: dict[str, Callable[[Any], object]] = {
    "slow is asynchronous: it is not read": lambda m: m.slow.read(),
    "timer is asynchronous: it is not read": lambda m: m.timer.read(),
    "slow is asynchronous": lambda m: m.slows.read(),
    "level is not declared incremental": lambda m: m.level.referenced(),
    "without a linearization": lambda m: m.bent.referenced(at=3.0),
    "homing changes it": lambda m: m.bent.calibration,
    "`acknowledge` of a part is carried out by the host": lambda m: m.acknowledge(),
    "`reset` of a part is carried out by the host": lambda m: m.reset(),
    "`sample` of a part is carried out by the host": lambda m: m.sample(),
}


@pytest.mark.parametrize("told", LAWS)
def test_what_a_controller_does_not_do_with_objects_is_refused(told: str) -> None:
    assert told in refusals(law=LAWS[told])


@pytest.mark.parametrize(
    "condition",
    [
        lambda m: m.level.read(),
        lambda m: m.level.read() and m.level.read() > 5.0,
        lambda m: m.level.quality,
        lambda m: True if m.level.read() > 3.0 else None,
    ],
)
def test_a_condition_that_is_not_always_true_or_false_is_refused(condition: Callable[[Any], object]) -> None:
    assert "other than True or False" in refusals(condition=condition)


def test_a_condition_with_a_comparison_translates() -> None:
    assert refusals(condition=lambda m: m.level.read() > 5.0 and not m.motor.read()) == ""

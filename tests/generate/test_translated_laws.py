"""The control laws in C beside Python: raw integers and every number of the laws, equal to the bit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Annotated, Any

import pytest

from helpers.generating import Beside, Fragile, needs_a_compiler, random_inputs, set_inputs, wiring_of
from helpers.machines import timer
from helpers.tiers import some
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Number
from umo.control import PID, Hysteresis, Profile, Servo, Stepping, state_of, value_of
from umo.cycle.connect import connect
from umo.errors import BadInput, RangeError
from umo.generate.code_world import translate
from umo.generate.compiled_machine import CompiledMachine, compiled
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import model_of
from umo.states import OnOff, PassFail, Rotation, UpDown
from umo.testing import VirtualTimer

pytestmark = needs_a_compiler


class Fan(Compound):
    speed: DigitalActuator
    least: Annotated[float, Number("V", 0.0, 5.0, tunable=True)] = 1.0

    def control(self) -> None:
        self.speed.write(max(self.least, self.speed.default))


class Oven(Compound):
    timer: DigitalSensor
    temperature: DigitalSensor
    pressure: DigitalSensor
    level: DigitalSensor
    door: BinarySensor[PassFail]
    heater: DigitalActuator
    motor: DigitalActuator
    valve: BinaryActuator[OnOff]
    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    fans: list[Fan]
    warm: float = 40.0

    def setup(self) -> None:
        self.servo = Servo(
            self.temperature,
            self.heater,
            gain=2.0,
            integral_time=0.5,
            derivative_time=0.01,
            filter_time=0.005,
            feed_forward=0.1,
            friction=0.2,
            limit=60.0,
        )
        self.outer = PID(gain=0.3, integral_time=2.0)
        self.inner = Servo(self.level, self.motor, gain=-0.4)
        self.regulator = Hysteresis(self.pressure, self.valve, OnOff.ON, low=30.0, high=55.0)
        self.stepping = Stepping(self.step, self.direction)
        self.profile = Profile(velocity=50.0, acceleration=500.0, jerk=5000.0)
        self.profile.to(70.0)
        self.started, self.soft, self.refused = 0.0, 0.0, 0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.heater, self.valve], "the door is open")

    @property
    def is_warm(self) -> bool:
        return value_of(self.temperature) >= self.warm

    def control(self) -> None:
        self.started = min(self.started + self.dt, 5.0)
        self.soft = self.started / 5.0
        position, velocity, acceleration = self.profile.step(self.dt)
        if not self.servo.control(position * self.soft, velocity, acceleration, dt=self.dt):
            self.refused += 1
        try:
            wanted = self.outer.step(50.0, value_of(self.pressure), self.dt, low=0.0, high=90.0)
            self.inner.control(wanted, dt=self.dt)
        except BadInput:
            self.motor.write(self.motor.default)
            self.outer.reset()
        self.regulator.control()
        self.stepping.control(self.soft * 300.0)
        for number, fan in enumerate(self.fans):
            fan.least = 1.0 + (number + self.refused) % 3 if self.is_warm else 0.5
        if self.refused > 100_000:
            raise RangeError("the heater is refused for too long")


def oven() -> Oven:
    def sensor(**changes: Any) -> DigitalSensor:
        given: dict[str, Any] = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.3, "zero_offset": 0.1}
        return DigitalSensor("mm", **given | changes)

    def actuator(**changes: Any) -> DigitalActuator:
        given: dict[str, Any] = {"default": 0.0, "minimum": 0.0, "maximum": 100.0, "resolution": 0.01}
        return DigitalActuator("V", **given | {"limits": "clamp"} | changes)

    return Oven(
        timer=timer(),
        temperature=sensor(on_error="hold", max_age="3 ms"),
        pressure=sensor(on_error="mark"),
        level=sensor(on_error="mark"),
        door=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age="5 ms"),
        heater=actuator(slew_rate=4000.0),
        motor=actuator(default=5.0, minimum=-20.0),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        fans=[Fan(speed=actuator(maximum=10.0)) for _ in range(3)],
    )


@pytest.mark.parametrize("seed", some(lambda seed: seed < 1, range(6)))
def test_laws_are_equal_to_the_bit_whatever_is_missed_fails_or_is_inhibited(seed: int, tmp_path: Path) -> None:
    random, machine, box, steps = Random(seed), oven(), Fragile(), 10_000 if seed else 2_000
    missed = [random.choice((0, 0, 0, 0, 0, 0, 2, 5)) for _ in range(steps)]
    running = connect(machine, wiring(machine, box, VirtualTimer(missed)))
    set_inputs(box, ["temperature", "pressure", "level", "door"], [0] * 4, [False] * 4)
    with running as m:
        model = model_of(running.machine, running.wired)
        translation = translate(m, model.functions, TARGETS["host"])
        write_folder(files_of(model, translation, TARGETS["host"]), tmp_path)
        c = CompiledMachine(compiled(tmp_path), model.inputs, len(model.outputs))
        both, following = Beside(running, box, c, model, translation.faults), random_inputs(model, random)
        structs = [c.struct(number, each) for number, each in enumerate(translation.structs)]
        assert c.begin([0] * model.inputs) == 0
        for number in range(steps):
            raws, failed = following()
            both.step(max(missed[number], 1), raws, failed, [False] * len(model.outputs))
            assert (number, both.difference()) == (number, "")
            assert (number, [line for each in structs for line in each.differences()]) == (number, [])
            if random.random() < 0.002:
                m.profile.to(random.uniform(20.0, 80.0))
                m.servo.gain = random.uniform(-3.0, 3.0)
                for each in structs:
                    each.push()
        assert both.told.keys() >= {None, "BadInput"}
        assert both.told[None] > steps / 4


def wiring(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    found = wiring_of(machine, box, clock)
    return found | {"wire": {path: each for path, each in found["wire"].items() if not path.startswith("fans")}
                    | {f"fans.{n}.speed": {"driver": "box"} for n in range(3)}}  # fmt: skip

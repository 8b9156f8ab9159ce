"""An oven with every control law, a profile, interlocks, parts and errors that are caught."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from helpers.generating import Fragile, wiring_of
from helpers.machines import timer
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Number
from umo.control import PID, Hysteresis, Profile, Servo, Stepping, state_of, value_of
from umo.errors import BadInput, RangeError
from umo.states import OnOff, PassFail, Rotation, UpDown
from umo.testing import VirtualTimer


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
        for number, (fan, _) in enumerate(zip(self.fans, self.fans, strict=True)):
            fan.least = 1.0 + (number + self.refused) % 3 if self.is_warm else 0.5
        if self.refused > 100_000:
            raise RangeError("the heater is refused for too long")


def oven(beyond: float = 0.0) -> Oven:
    """`beyond`: time in ms by which the ages that are allowed are longer than whole periods."""

    def sensor(**changes: Any) -> DigitalSensor:
        given: dict[str, Any] = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.3, "zero_offset": 0.1}
        return DigitalSensor("mm", **given | changes)

    def actuator(**changes: Any) -> DigitalActuator:
        given: dict[str, Any] = {"default": 0.0, "minimum": 0.0, "maximum": 100.0, "resolution": 0.01}
        return DigitalActuator("V", **given | {"limits": "clamp"} | changes)

    return Oven(
        timer=timer(),
        temperature=sensor(on_error="hold", max_age=f"{3 + beyond} ms"),
        pressure=sensor(on_error="mark"),
        level=sensor(on_error="mark"),
        door=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age=f"{5 + beyond} ms"),
        heater=actuator(slew_rate=4000.0),
        motor=actuator(default=5.0, minimum=-20.0),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        fans=[Fan(speed=actuator(maximum=10.0)) for _ in range(3)],
    )


def oven_wiring(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    found = wiring_of(machine, box, clock)
    return found | {"wire": {path: each for path, each in found["wire"].items() if not path.startswith("fans")}
                    | {f"fans.{n}.speed": {"driver": "box"} for n in range(3)}}  # fmt: skip

"""A slide between two end stops, driven by a motor or a stepper, and the axes of it."""

from __future__ import annotations

import math
from typing import Any

from umo import BinaryActuator, DigitalActuator, DigitalSensor
from umo.control import ServoAxis, StepperAxis
from umo.drivers import Channel, Direction, Driver
from umo.states import Rotation, UpDown

DT = 0.001
COUNT = 0.01
"""mm of a count of the encoder."""
LOW, HIGH = -5.0, 105.0
"""The end stops, mm."""
INDEX = 90.0
"""Where the index pulse is, mm."""
SWITCH = 2.0
"""The home switch is active below, mm."""


class Slide(Driver[Channel]):
    """A motor (10 V: 500 mm/s, 10 ms) or a stepper (0.05 mm a step) moves a slide between two end stops. The counter is
    0 at power-up, and is loaded with 0 at the index while that is enabled."""

    OUTPUTS = {"motor": 12, "step": 1, "direction": 1, "enable": 1}
    INPUTS = {"counter": 32, "switch": 1, "door": 1, "tick": 31}

    def __init__(self, start: float = 40.0) -> None:
        self.position = start
        self.start = start
        self.rate = 0.0
        self.levels = dict.fromkeys(self.OUTPUTS, 0)
        self.counter = self.origin = 0
        self.door = 0
        self.stuck = self.dead = self.switch_broken = False
        self.power_up()

    def power_up(self) -> None:
        self.origin = self._line()

    def channel(self, text: str) -> Channel:
        output = text in self.OUTPUTS
        bits = (self.OUTPUTS | self.INPUTS)[text]
        return Channel(text, Direction.OUTPUT if output else Direction.INPUT, bits, text in ("motor", "counter"))

    def write(self, channel: Channel, raw: int) -> None:
        if channel.text == "step" and raw > self.levels["step"] and not self.stuck:
            self._go(self.position + (0.05 if self.levels["direction"] else -0.05))
        self.levels[channel.text] = raw

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.advance()
            return 0
        if channel.text == "counter":
            if not self.dead:
                self.counter = self._line() - self.origin
            return self.counter
        return self.door if channel.text == "door" else int(self.position < SWITCH and not self.switch_broken)

    def advance(self) -> None:
        self.rate += (self.levels["motor"] * 50.0 / 200 - self.rate) * DT / 0.01
        if not self.stuck:
            self._go(self.position + self.rate * DT)

    def _go(self, position: float) -> None:
        before, self.position = self._line(), min(max(position, LOW), HIGH)
        index = round(INDEX / COUNT)
        if self.levels["enable"] and (before < index <= self._line() or self._line() <= index < before):
            self.origin = index

    def _line(self) -> int:
        return math.floor(self.position / COUNT)


def encoder(**changes: Any) -> DigitalSensor:
    return DigitalSensor(
        "mm", **({"minimum": 0.0, "maximum": 100.0, "resolution": COUNT, "incremental": True} | changes)
    )


def servo(**changes: Any) -> ServoAxis:
    return ServoAxis(**SERVO | {"motor": motor(), "encoder": encoder()} | changes)


def motor() -> DigitalActuator:
    return DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=10 / 2000, limits="clamp")


SERVO: dict[str, Any] = {
    "gain": 1.0,
    "integral_time": 0.2,
    "feed_forward": 1 / 50,
    "velocity": 200.0,
    "acceleration": 2_000.0,
    "jerk": 50_000.0,
    "window": 0.05,
    "following_error": 5.0,
    "search_speed": 50.0,
    "search_output": 3.0,
    "stall": 3.0,
}


class Stepper(StepperAxis):
    velocity: float = 15.0
    acceleration: float = 200.0
    jerk: float = 5_000.0
    window: float = 0.03
    following_error: float = 1.0
    settling_time: float = 0.1
    search_speed: float = 15.0
    stall: float = 3.0
    step_size: float = 0.05


def stepper(**changes: Any) -> Stepper:
    return Stepper(**{"step": step_output(), "direction": direction_output(), "encoder": encoder()} | changes)


def step_output() -> BinaryActuator[UpDown]:
    return BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN)


def direction_output(default: Rotation = Rotation.CW) -> BinaryActuator[Rotation]:
    return BinaryActuator(Rotation, one=Rotation.CW, default=default)

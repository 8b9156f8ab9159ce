"""A station with one loop, on a process of a known model: a lag, an integrator, a dead time, a lag with noise."""

from __future__ import annotations

from pathlib import Path

from umo.commissioning.tuning.models import ProcessModel

PERIOD = 0.01
MODELS = {
    "lag": ProcessModel("first order", 5.0, 0.1, (2.0,)),
    "integrator": ProcessModel("integrator", 2.0, 0.2),
    "dead-time": ProcessModel("first order", 5.0, 1.0, (0.3,)),
    "noise": ProcessModel("first order", 5.0, 0.1, (2.0,)),
}
"""From the output in per cent to the level in mm, by the option `process` of the station."""

OBJECTS = '''
from typing import Annotated

from umo import Compound, DigitalActuator, DigitalSensor, Number, action
from umo.control import Servo


class Tank(
    Compound,
    numbers={
        "servo.gain": Number("percent/mm", 0.0, 50.0, tunable=True),
        "servo.integral_time": Number("s", 0.01, 1000.0, tunable=True),
    },
):
    valve: DigitalActuator
    level: DigitalSensor
    timer: DigitalSensor
    gain: float = 0.05
    """Gain of the servo, percent per mm."""
    target: float = 150.0

    def setup(self) -> None:
        self.servo = Servo(self.level, self.valve, gain=self.gain, integral_time=2.0)
        self.servo.integral = 30.0

    def control(self) -> None:
        self.servo.control(self.target, dt=self.dt)


def machine() -> Tank:
    return Tank(
        valve=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.01),
        level=DigitalSensor("mm", minimum=0.0, maximum=1000.0, resolution=0.01),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
'''

APPLICATION = '''
from umo.control import wait


async def main(m, lasts: float = 1000.0):
    """Keep the level.

    Options:
        lasts: s.
    """
    await wait(lasts)
'''

PLANT = '''
from collections import deque
from math import exp

import numpy as np

from umo.drivers.contract import Channel, Direction, Driver

LAG = (5.0, 0.1, 2.0)
MODELS = {"lag": LAG, "integrator": (2.0, 0.2, None), "dead-time": (5.0, 1.0, 0.3), "noise": LAG}
CHANNELS = {
    "tick": Channel("tick", Direction.INPUT, 31),
    "valve": Channel("valve", Direction.OUTPUT, 16),
    "level": Channel("level", Direction.INPUT, 31),
}


class Plant(Driver):
    """The process.

    Options:
        process: lag, integrator, dead-time or noise.
    """

    simulates_time = True

    def __init__(self, *, process: str = "lag"):
        self.gain, self.dead_time, self.lag = MODELS[process]
        self.noise = 0.4 if process == "noise" else 0.0
        self.random = np.random.default_rng(4)
        self.level, self.valve = 150.0, 30.0

    def channel(self, text):
        return CHANNELS[text]

    def open(self):
        self.waiting = deque([self.valve] * round(self.dead_time / (self.period or 0.01)))

    def close(self):
        pass

    def read(self, channel):
        if channel.text == "tick":
            self.advance(self.period or 0.01)
            return 0
        return max(round((self.level + self.noise * self.random.standard_normal()) * 100.0), 0)

    def advance(self, dt):
        self.waiting.append(self.valve)
        valve = self.waiting.popleft()
        if self.lag is None:
            self.level += self.gain * (valve - 30.0) * dt
        else:
            self.level += (1.0 - exp(-dt / self.lag)) * (self.gain * valve - self.level)

    def write(self, channel, raw):
        self.valve = raw / 100.0
'''

WIRING = """
[drivers.plant]
type = ".plant:Plant"

[wire]
"timer" = { driver = "plant", channel = "tick", period = "10 ms" }
"valve" = { driver = "plant", channel = "valve" }
"level" = { driver = "plant", channel = "level" }

[process]
hang_timeout = "5 s"
"""


def station(folder: Path, name: str = "tank") -> Path:
    """The folder of the station."""
    place = folder / name
    (place / "wiring").mkdir(parents=True)
    files = {"objects.py": OBJECTS, "application.py": APPLICATION, "plant.py": PLANT, "wiring/simulated.toml": WIRING}
    for file, text in files.items():
        (place / file).write_text(text.lstrip())
    return place

"""A station with a cascade of two laws, on a process of known models: a jacket and a vessel, or a flow and a level."""

from __future__ import annotations

from pathlib import Path

from umo.commissioning.tuning.models import ProcessModel

PERIOD = 0.02
INNER_LAG = 0.5
INNER_GAIN = 2.0
OUTER = {
    "vessel": ProcessModel("first order", 0.8, 0.2, (6.0,)),
    "level": ProcessModel("integrator", 0.25, 0.2),
    "near": ProcessModel("first order", 0.8, 0.2, (0.8,)),
}
"""From the inner measurement to the outer one, by the option `process` of the station."""
GAIN, INTEGRAL_TIME = 1.0, 0.5
"""Of the inner law."""

OBJECTS = f'''
from umo import Compound, DigitalActuator, DigitalSensor, Number
from umo.control import Cascade, Servo


class Reactor(
    Compound,
    numbers={{
        "jacket_law.gain": Number("percent/K", 0.0, 50.0, tunable=True),
        "jacket_law.integral_time": Number("s", 0.01, 1000.0, tunable=True),
        "vessel_law.gain": Number("", 0.0, 50.0, tunable=True),
        "vessel_law.integral_time": Number("s", 0.01, 1000.0, tunable=True),
    }},
):
    heater: DigitalActuator
    jacket: DigitalSensor
    vessel: DigitalSensor
    timer: DigitalSensor
    target: float = 40.0
    """degC."""
    gain: float = {GAIN}
    """Of the jacket's law."""

    def setup(self) -> None:
        self.jacket_law = Servo(self.jacket, self.heater, gain=self.gain, integral_time={INTEGRAL_TIME})
        self.jacket_law.integral = 25.0
        self.vessel_law = Cascade(self.vessel, self.jacket_law, low=0.0, high=150.0, gain=0.5, integral_time=8.0)
        self.vessel_law.integral = 50.0

    def control(self) -> None:
        self.vessel_law.control(self.target, dt=self.dt)


def machine() -> Reactor:
    def sensor() -> DigitalSensor:
        return DigitalSensor("degC", minimum=0.0, maximum=200.0, resolution=0.001)

    return Reactor(
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.001),
        jacket=sensor(),
        vessel=sensor(),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
'''

APPLICATION = '''
from umo.control import wait


async def main(m, lasts: float = 1000.0):
    """Keep the temperature.

    Options:
        lasts: s.
    """
    await wait(lasts)
'''

PLANT = f'''
from collections import deque
from math import exp

from umo.drivers.contract import Channel, Direction, Driver

MODELS = {{"vessel": (0.8, 6.0), "level": (0.25, None), "near": (0.8, 0.8)}}
CHANNELS = {{
    "tick": Channel("tick", Direction.INPUT, 31),
    "heater": Channel("heater", Direction.OUTPUT, 31),
    "jacket": Channel("jacket", Direction.INPUT, 31),
    "vessel": Channel("vessel", Direction.INPUT, 31),
}}


class Plant(Driver):
    """The process.

    Options:
        process: vessel, level or near.
    """

    simulates_time = True

    def __init__(self, *, process: str = "vessel"):
        self.gain, self.lag = MODELS[process]
        self.heater, self.jacket, self.vessel = 25.0, 50.0, 40.0

    def channel(self, text):
        return CHANNELS[text]

    def open(self):
        self.waiting = deque([self.jacket] * 10)

    def close(self):
        pass

    def read(self, channel):
        if channel.text == "tick":
            self.advance(self.period or {PERIOD})
            return 0
        return max(round(getattr(self, channel.text) * 1000.0), 0)

    def advance(self, dt):
        self.waiting.append(self.jacket)
        jacket = self.waiting.popleft()
        self.jacket += (1.0 - exp(-dt / {INNER_LAG})) * ({INNER_GAIN} * self.heater - self.jacket)
        if self.lag is None:
            self.vessel += self.gain * (jacket - 50.0) * dt
        else:
            self.vessel += (1.0 - exp(-dt / self.lag)) * (self.gain * jacket - self.vessel)

    def write(self, channel, raw):
        self.heater = raw / 1000.0
'''

WIRING = """
[drivers.plant]
type = ".plant:Plant"

[wire]
"timer" = { driver = "plant", channel = "tick", period = "20 ms" }
"heater" = { driver = "plant", channel = "heater" }
"jacket" = { driver = "plant", channel = "jacket" }
"vessel" = { driver = "plant", channel = "vessel" }

[process]
hang_timeout = "5 s"
"""


def station(folder: Path, name: str = "reactor") -> Path:
    """The folder of the station; in the wiring `slow` its inner law is slow, in `limited` soon at its limit."""
    place = folder / name
    (place / "wiring").mkdir(parents=True)
    files = {"objects.py": OBJECTS, "application.py": APPLICATION, "plant.py": PLANT, "wiring/simulated.toml": WIRING}
    files["wiring/slow.toml"] = f'{WIRING}\n[parameters]\n"gain" = 0.2\n'
    files["wiring/limited.toml"] = f'{WIRING}\n[parameters]\n"gain" = 20.0\n'
    for file, text in files.items():
        (place / file).write_text(text.lstrip())
    return place

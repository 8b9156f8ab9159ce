"""A zone whose control code reads a text, an upper-case number, an object and None: what a controller goes on with."""

from __future__ import annotations

from typing import Any

from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.states import OnOff


class Limits:
    def __init__(self, highest: float) -> None:
        self.highest = highest


class Zone(Compound):
    heater: DigitalActuator
    fan: BinaryActuator[OnOff]
    temperature: DigitalSensor

    def setup(self) -> None:
        self.mode_name = "heat"
        self.target: Any = None
        self.SP = 50.0
        self.limits = Limits(1000.0)
        self.gain = 1.0

    def control(self) -> None:
        duty = self.SP * self.gain if self.mode_name == "heat" else 0.0
        if self.target is not None:
            duty = self.target
        self.heater.write(duty if self.temperature.read() < self.limits.highest else 0.0)


class Oven(Compound):
    timer: DigitalSensor
    zone: Zone


def oven() -> Oven:
    return Oven(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        zone=Zone(
            heater=DigitalActuator("percent", default=0, minimum=0, maximum=100, resolution=0.1),
            fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON),
            temperature=DigitalSensor("degC", minimum=0.0, maximum=1300.0, resolution=1 / 20.5),
        ),
    )

"""A small part of a machine for the schedules of its link: what its laws and its application change tells which frame,
and which period, it is of."""

from __future__ import annotations

from typing import Any

from umo import Compound, DigitalActuator, DigitalSensor, TaskFailed

CONTROLLER_PERIOD, HOST_PERIOD = 0.005, 0.010
"""s"""
HOST_TIMEOUT, BRAKING_TIMEOUT = 0.100, 0.0
"""s"""
LOAD = 1000
"""The application sets loads of `LOAD - 1` and so many times LOAD as it has set before: so which one it is can be seen
while it is used up."""
HOT = 500
"""The zone fails alone above this raw integer of its temperature."""


class Zone(Compound, equipment=True):
    temperature: DigitalSensor
    heater: DigitalActuator

    def setup(self) -> None:
        self.highest = float(HOT)

    def control(self) -> None:
        if self.temperature.read() > self.highest:
            raise TaskFailed("too hot")
        self.heater.write(10.0)


class Drive(Compound):
    """The part. `counter` reads the period in which it was read."""

    counter: DigitalSensor
    valve: DigitalActuator
    zone: Zone

    def setup(self) -> None:
        self.target = 0
        """Set by the application: one more each time."""
        self.load = 0
        """Set by the application, and used up by the laws: one in a period."""
        self.seen = 0
        self.made = 0
        """How much of all loads was used up."""

    def control(self) -> None:
        self.seen = self.target
        if self.load % 1000 > 0:
            self.load -= 1
            self.made += 1
        self.valve.write(50.0)


class Plant(Compound):
    timer: DigitalSensor
    drive: Drive


def machine() -> Plant:
    def actuator() -> DigitalActuator:
        return DigitalActuator(
            "percent", default=0, minimum=0, maximum=100, resolution=1.0, on_error="retry", max_age="60 s"
        )

    def sensor(minimum: float, maximum: float) -> DigitalSensor:
        return DigitalSensor("degC", minimum=minimum, maximum=maximum, resolution=1.0, on_error="hold", max_age="60 s")

    zone = Zone(temperature=sensor(-100, 1000), heater=actuator())
    drive = Drive(counter=sensor(-100, 2_000_000_000), valve=actuator(), zone=zone)
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
    return Plant(timer=timer, drive=drive)


def wiring() -> dict[str, Any]:
    drive = {
        "type": "tools.message_orders.link_ends:LineController",
        "host_timeout": HOST_TIMEOUT,
        "braking_timeout": BRAKING_TIMEOUT,
        "cycle": CONTROLLER_PERIOD,
    }
    wire = {"timer": {"driver": "simulated", "period": HOST_PERIOD}, "drive": {"controller": "drive"}}
    return {"drivers": {"drive": drive}, "wire": wire}

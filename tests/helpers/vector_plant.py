"""Zones that are read, controlled and written at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from helpers.machines import timer
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, Vector
from umo.control import VectorPID, VectorServo, state_of, value_of
from umo.errors import BadInput, RangeError
from umo.objects import Quality
from umo.states import OnOff, PassFail


class Zone(Compound):
    temperature: DigitalSensor
    pressure: DigitalSensor
    heater: DigitalActuator
    pump: DigitalActuator
    fan: BinaryActuator[OnOff]
    lamp: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.heater], "the door is open")
        yield Interlock(lambda: value_of(self.pressure) > 92.0, [self.pump], "too much pressure", effect="stop")


class Zones(Compound):
    timer: DigitalSensor
    zones: list[Zone]

    def setup(self) -> None:
        self.temperatures = Vector(zone.temperature for zone in self.zones)
        self.pressures = Vector(zone.pressure for zone in self.zones)
        self.heaters = Vector(zone.heater for zone in self.zones)
        self.pumps = Vector(zone.pump for zone in self.zones)
        self.fans = Vector(zone.fan for zone in self.zones)
        self.lamps = Vector(zone.lamp for zone in self.zones)
        self.heating = VectorServo(
            self.temperatures,
            self.heaters,
            gain=np.array([0.2, -0.3, 0.4, 0.5])[: len(self.zones)],
            integral_time=0.5,
            derivative_time=0.013,
            filter_time=0.005,
        )
        self.pumping = VectorPID(gain=0.11, integral_time=np.array([0.4, 0.5, 0.6, 0.7])[: len(self.zones)])
        self.setpoints = np.linspace(40.3, 50.1, len(self.zones))
        self.broken = np.zeros(len(self.zones), np.bool_)
        self.seen = np.zeros(len(self.zones), np.int64)
        self.refused, self.unread = 0, 0

    def control(self) -> None:
        temperatures = self.temperatures.read()
        self.broken = (self.temperatures.quality == Quality.BAD) | (temperatures > 95.0)
        self.seen = np.where(self.broken, 0, self.seen + 1)
        accept = (Quality.OUT_OF_RANGE,)
        if not self.heating.control(self.setpoints, dt=self.dt, accept=accept, enabled=~self.broken):
            self.refused += 1
        try:
            pressures = value_of(self.pressures)
        except BadInput:
            self.unread += 1
            pressures = np.full(len(self.zones), 20.0)
        wanted = self.pumping.step(50.0, pressures, self.dt, low=-12.0, high=12.0, feed_forward=0.013 * temperatures)
        wanted[self.broken] = 0.0
        try:
            self.pumps.write(wanted)
        except RangeError:
            self.pumps.write(np.clip(wanted, -10.0, 10.0), where=self.temperatures.quality != Quality.BAD)
        self.fans.write((self.broken | (temperatures > 70.0)).astype(np.float64))
        self.lamps.write(OnOff.ON if self.pressures.all_good else OnOff.OFF)


def zones(beyond: float = 0.0, count: int = 4) -> Zones:
    """`count`: of zones, up to 4. `beyond`: time in ms by which ages that are allowed are longer than whole periods."""
    relay: Any = {"one": OnOff.ON, "default": OnOff.OFF}

    def sensor(**changes: Any) -> DigitalSensor:
        return DigitalSensor("K", minimum=0.0, maximum=100.0, resolution=0.3, zero_offset=0.1, **changes)

    def actuator(**changes: Any) -> DigitalActuator:
        given: dict[str, Any] = {"default": 0.0, "minimum": -10.0, "maximum": 10.0, "resolution": 0.03} | changes
        return DigitalActuator("V", **given)

    return Zones(
        timer=timer(),
        zones=[
            Zone(
                temperature=sensor(on_error="mark"),
                pressure=sensor(on_error="hold", max_age=f"{2 + beyond} ms"),
                heater=actuator(slew_rate=700.0, limits="clamp", expires=f"{4 + beyond} ms"),
                pump=actuator(),
                fan=BinaryActuator(OnOff, **relay),
                lamp=BinaryActuator(OnOff, **relay, synchronous=False),
                door=BinarySensor(PassFail, one=PassFail.FAIL, on_error="mark"),
            )
            for _ in range(count)
        ],
    )

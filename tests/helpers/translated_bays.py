"""A machine with every law of Vectors, and with laws of a user's own on arrays."""

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


class Bay(Compound):
    temperature: DigitalSensor
    pressure: DigitalSensor
    heater: DigitalActuator
    valve: DigitalActuator
    damper: DigitalActuator
    fan: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.heater], "the door is open")
        yield Interlock(lambda: value_of(self.pressure) > 80.0, [self.valve], "too high", latched=True)
        yield Interlock(lambda: self.temperature.read() > 102.0, [self.damper], "far too hot", effect="stop")


class Bays(Compound):
    timer: DigitalSensor
    bays: list[Bay]

    def setup(self) -> None:
        n = len(self.bays)
        self.temperatures = Vector(bay.temperature for bay in self.bays)
        self.pressures = Vector(bay.pressure for bay in self.bays)
        self.doors = Vector(bay.door for bay in self.bays)
        self.heaters = Vector(bay.heater for bay in self.bays)
        self.valves = Vector(bay.valve for bay in self.bays)
        self.dampers = Vector(bay.damper for bay in reversed(self.bays))
        self.fans = Vector(bay.fan for bay in self.bays)
        self.heating = VectorServo(
            self.temperatures, self.heaters, gain=2.0, integral_time=0.5, derivative_time=0.01, filter_time=0.005
        )
        self.filling = VectorServo(self.pressures, self.valves, gain=np.linspace(0.5, 1.5, n), integral_time=0.2)
        self.outer = VectorPID(gain=0.3, integral_time=2.0, derivative_time=0.02)
        self.setpoints, self.smooth = np.full(n, 40.0), np.zeros(n)
        self.warm = np.zeros(n, np.bool_)
        self.equal, self._last = np.zeros(n, np.int64), np.zeros(n)
        self.gain, self.refused, self.coldest, self.mean, self.worst = 0.4, 0, 0.0, 0.0, 0.0

    def control(self) -> None:
        temperatures, quality = self.temperatures.read(), self.temperatures.quality
        self.equal = np.where(temperatures == self._last, self.equal + 1, 0)
        self._last = temperatures
        able = (quality != Quality.BAD) & (self.equal < 40)
        if not self.heating.control(self.setpoints, dt=self.dt, accept=Quality.OUT_OF_RANGE, enabled=able):
            self.refused += 1
        self.smooth = self.smooth + np.clip(self.setpoints - self.smooth, -500.0 * self.dt, 500.0 * self.dt)
        self._fill()
        self._fan(temperatures)
        if self.refused > 100_000:
            raise RangeError("the heaters are refused for too long")

    def _fill(self) -> None:
        """The cascade; where a temperature is not to be used, the valves go to the middle."""
        try:
            wanted = self.outer.step(self.smooth, value_of(self.temperatures), self.dt, low=0.0, high=90.0)
            self.filling.control(wanted, dt=self.dt)
        except BadInput:
            self.valves.write(50.0)
            self.outer.reset()

    def _fan(self, temperatures: Any) -> None:
        """A user's own law: fans with a hysteresis, dampers by how far each is from the mean of all."""
        self.warm[temperatures > 60.0] = True
        self.warm[temperatures < 45.0] = False
        if self.doors.all_good:
            self.fans.write((self.warm | (self.doors.read() > 0.5)).astype(np.float64))
        else:
            self.fans.write(OnOff.ON, where=self.warm)
        good = np.nan_to_num(temperatures)
        self.mean = float(good.sum()) / len(self.bays)
        distance = (good - self.mean) * self.gain
        distance += self.dampers.pending * 0.5
        distance[np.isnan(temperatures)] = 0.0
        self.dampers.write(distance)
        self.coldest = min(float(good.min()), 100.0)
        for number, bay in enumerate(self.bays):
            if bay.temperature.quality is Quality.BAD:
                self.worst = float(20.0 + good[number] / 10.0)


def bays(count: int = 5, beyond: float = 0.0) -> Bays:
    """`beyond`: time in ms by which the ages that are allowed are longer than whole periods."""
    return Bays(timer=timer(), bays=[_bay(number, beyond) for number in range(count)])


def _bay(number: int, beyond: float) -> Bay:
    def sensor(**changes: Any) -> DigitalSensor:
        given: dict[str, Any] = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.3, "zero_offset": 0.1}
        return DigitalSensor("mm", **given | {"on_error": "mark"} | changes)

    def actuator(**changes: Any) -> DigitalActuator:
        given: dict[str, Any] = {"default": 0.0, "minimum": 0.0, "maximum": 100.0, "resolution": 0.01}
        return DigitalActuator("V", **given | {"limits": "clamp"} | changes)

    return Bay(
        temperature=sensor(**{"max_age": f"{3 + beyond} ms"} if number else {}),
        pressure=sensor(),
        heater=actuator(**{"slew_rate": 4000.0} if number != 1 else {}),
        valve=actuator(default=5.0, minimum=-20.0, limits="raise"),
        damper=actuator(minimum=-8.0, maximum=8.0, **{"expires": "4 ms"} if number == 2 else {}),
        fan=BinaryActuator(OnOff, one=OnOff.OFF if number == 3 else OnOff.ON, default=OnOff.ON),
        door=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age=f"{5 + beyond} ms"),
    )

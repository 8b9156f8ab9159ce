"""A vessel in a jacket: a cascade of two laws, as it is translated."""

from __future__ import annotations

from typing import Any

from helpers.machines import timer
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import Cascade, Servo
from umo.errors import BadInput


class Jacketed(Compound):
    timer: DigitalSensor
    vessel: DigitalSensor
    jacket: DigitalSensor
    heater: DigitalActuator

    def setup(self) -> None:
        self.inner = Servo(self.jacket, self.heater, gain=2.0, integral_time=0.5, limit=60.0)
        self.outer = Cascade(self.vessel, self.inner, low=10.0, high=90.0, gain=0.8, integral_time=1.0)
        self.behind, self.unread = 0, 0

    def control(self) -> None:
        try:
            if not self.outer.control(50.0, feed_forward=5.0, dt=self.dt):
                self.behind += 1
        except BadInput:
            self.unread += 1
            self.heater.write(self.heater.default)


def jacketed() -> Jacketed:
    def sensor(**changes: Any) -> DigitalSensor:
        given: dict[str, Any] = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.3, "on_error": "mark"}
        return DigitalSensor("degC", **given | changes)

    heater = DigitalActuator("V", default=0.0, minimum=0.0, maximum=100.0, resolution=0.01, slew_rate=4000.0)
    return Jacketed(timer=timer(), vessel=sensor(), jacket=sensor(), heater=heater)

"""A step-down converter: voltage over current, with a soft start and an over-current trip."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from helpers.machines import timer
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, Number
from umo.control import PID, value_of
from umo.states import OnOff


class Converter(Compound):
    timer: DigitalSensor
    voltage: DigitalSensor
    current: DigitalSensor
    supply: DigitalSensor
    duty: DigitalActuator
    gate: BinaryActuator[OnOff]
    target: Annotated[float, Number("V", 0.0, 24.0, tunable=True)] = 12.0
    ramp: float = 400.0
    """Rise of the setpoint in V/s."""
    most: float = 8.0
    """Largest current that is asked for, A."""

    def setup(self) -> None:
        self.outer = PID(gain=0.8, integral_time=0.004)
        self.inner = PID(gain=0.021, integral_time=0.0011)
        self.setpoint = 0.0
        self.power = 0.0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.current) > 10.0, [self.duty, self.gate], "over-current", latched=True)

    def control(self) -> None:
        voltage, current = value_of(self.voltage), value_of(self.current)
        supply = max(value_of(self.supply), 1.0)
        step = self.ramp * self.dt
        self.setpoint += min(max(self.target - self.setpoint, -step), step)
        wanted = self.outer.step(self.setpoint, voltage, self.dt, low=0.0, high=self.most)
        share = voltage / supply
        duty = self.inner.step(wanted, current, self.dt, feed_forward=share, low=0.0, high=0.95)
        self.power += (voltage * current - self.power) * 0.01
        self.duty.write(duty)
        self.gate.write(OnOff.ON if self.target > 0.0 else OnOff.OFF)


def converter() -> Converter:
    def sensor(units: str, most: float, **given: str) -> DigitalSensor:
        return DigitalSensor(units, minimum=-most / 50, maximum=most, resolution=most / 4000.0, **given)

    return Converter(
        timer=timer(),
        voltage=sensor("V", 40.0),
        current=sensor("A", 12.0),
        supply=sensor("V", 60.0, on_error="hold", max_age="1 s"),
        duty=DigitalActuator("1", default=0.0, minimum=0.0, maximum=0.95, resolution=1 / 4000.0, limits="clamp"),
        gate=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )

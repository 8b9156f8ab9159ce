"""A plant whose parts fail alone: equipment in equipment, and an axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from helpers.machines import timer
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock
from umo.control import PID, ServoAxis, value_of
from umo.control.axis import Interruption
from umo.control.axis_state import AxisState
from umo.control.inputs import HOMING
from umo.objects import Quality
from umo.states import OnOff


def sensor(**changes: Any) -> DigitalSensor:
    return DigitalSensor("mm", **({"minimum": 0.0, "maximum": 100.0, "resolution": 0.3} | changes))


def actuator(**changes: Any) -> DigitalActuator:
    return DigitalActuator("V", **({"default": 0.0, "minimum": -10.0, "maximum": 10.0, "resolution": 0.03} | changes))


class Pump(Compound, equipment=True):
    """Fails above 95 mm; its valve fails alone."""

    level: DigitalSensor
    motor: DigitalActuator
    limit: float = 95.0

    def setup(self) -> None:
        self.law = PID(gain=0.2, integral_time=0.5)
        self.periods = 0

    def control(self) -> None:
        self.periods += 1
        level = value_of(self.level)
        self.motor.write(self.law.step(50.0, level, self.dt, low=-10.0, high=10.0))
        if level > self.limit:
            raise RuntimeError("full")


class Valve(Compound, equipment=True):
    position: DigitalSensor
    coil: BinaryActuator[OnOff]

    def control(self) -> None:
        self.coil.write(OnOff.ON if value_of(self.position, Quality.UNREFERENCED) > 30.0 else OnOff.OFF)


class Slide(ServoAxis, equipment=True):
    """An axis that fails alone."""

    gain: float = 0.05
    integral_time: float = 0.4
    velocity: float = 50.0
    acceleration: float = 500.0
    jerk: float = 5000.0
    window: float = 1.0
    following_error: float = 40.0

    def host_begins_homing(self) -> bool:
        """What the host does with an axis, before it moves: it enables it, whether it is referenced or not. True if
        the axis was not enabled."""
        self._accept = HOMING
        if self.enabled or self.encoder.quality == Quality.BAD:
            return False
        self._state, self._interrupted = AxisState.STANDSTILL, Interruption.NONE
        self._stand()
        return True


class Unit(Compound, equipment=True, stop_order=("heater", "pump", "valve")):
    """Equipment with equipment in it."""

    pump: Pump
    valve: Valve
    temperature: DigitalSensor
    heater: DigitalActuator

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.temperature) > 80.0, [self.heater], "too hot", effect="stop")

    def control(self) -> None:
        self.heater.write(0.1 * value_of(self.temperature) - 1.0)


class Plant(Compound):
    timer: DigitalSensor
    unit: Unit
    other: Pump
    slide: Slide
    speed: DigitalSensor
    fan: DigitalActuator

    def control(self) -> None:
        speed = value_of(self.speed)
        self.fan.write(0.04 * speed)
        if speed > 60.0:
            self.unit.heater.write(1.0)  # refused while the unit is in fault; Interlocked while it is too hot


def plant(beyond: float = 0.0) -> Plant:
    """`beyond`: time in ms by which the ages that are allowed are longer than whole periods."""

    def pump() -> Pump:
        return Pump(level=sensor(), motor=actuator(slew_rate=2000.0))

    return Plant(
        timer=timer(),
        unit=Unit(
            pump=pump(),
            valve=Valve(
                position=sensor(on_error="hold", max_age=f"{2 + beyond} ms", incremental=True),
                coil=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
            ),
            temperature=sensor(velocity="3 ms"),
            heater=actuator(on_error="retry", max_age=f"{2 + beyond} ms"),
        ),
        other=pump(),
        slide=Slide(encoder=sensor(incremental=True), motor=actuator()),
        speed=sensor(on_error="mark"),
        fan=actuator(expires=f"{5 + beyond} ms"),
    )

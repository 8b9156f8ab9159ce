"""A plant whose parts have rates of their own, in one another: filters, ages, rates of outputs, faults, interlocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import new_class
from typing import Any

from helpers.equipment_plant import Slide, actuator, sensor
from helpers.machines import timer
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock
from umo.control import PID, Hysteresis, state_of, value_of
from umo.states import OnOff, PassFail


class Mixer(Compound):
    """At the rate of what it lies in."""

    torque: DigitalSensor
    motor: DigitalActuator

    def setup(self) -> None:
        self.turned = 0.0

    def control(self) -> None:
        self.turned += self.dt * value_of(self.torque)
        self.motor.write(0.1 * value_of(self.torque) - 3.0)


class Jet(Mixer, every=1):
    """At the machine's own rate, in a slow part."""


class Tank(Compound, equipment=True, every=3):
    """Fails alone above 90 mm."""

    level: DigitalSensor
    flow: DigitalSensor
    lid: BinarySensor[PassFail]
    inlet: DigitalActuator
    drain: DigitalActuator
    lamp: BinaryActuator[OnOff]
    mixer: Mixer

    def setup(self) -> None:
        self.law = PID(gain=0.2, integral_time=0.5)
        self.periods, self.steps = 0, 0.0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.lid) is PassFail.FAIL, [self.inlet], "the lid is open")
        yield Interlock(lambda: value_of(self.level) > 70.0, [self.drain], "too full", latched=True)

    def control(self) -> None:
        level = value_of(self.level)
        self.periods += 1
        self.steps += self.dt / self.cycle.period
        self.inlet.write(self.law.step(50.0, level, self.dt, low=-9.0, high=9.0))
        if self.periods % 4 == 0:
            self.drain.write(0.02 * self.flow.velocity)
        self.lamp.write(OnOff.ON if value_of(self.flow) > 40.0 else OnOff.OFF)
        if level > 90.1:
            raise RuntimeError("full")


class Burner(Compound, equipment=True):
    """Fails alone, in a slow part."""

    flame: DigitalSensor
    gas: DigitalActuator

    def control(self) -> None:
        self.gas.write(0.15 * value_of(self.flame) - 2.0)


class Furnace(Compound, every=7):
    temperature: DigitalSensor
    pressure: DigitalSensor
    heater: DigitalActuator
    damper: DigitalActuator
    valve: BinaryActuator[OnOff]
    burner: Burner
    jet: Jet

    def setup(self) -> None:
        self.regulator = Hysteresis(self.pressure, self.valve, OnOff.ON, low=30.1, high=55.0)
        self.heated = 0.0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.pressure) > 85.0, [self.heater], "too high", effect="stop")

    def control(self) -> None:
        self.heated += self.dt
        self.heater.write(0.1 * value_of(self.temperature) - 2.0)
        self.damper.write(0.3 * value_of(self.jet.torque) - 9.0)
        self.regulator.control()


class RatedPlant(Compound):
    timer: DigitalSensor
    speed: DigitalSensor
    fan: DigitalActuator
    brake: DigitalActuator
    tank: Tank
    furnace: Furnace

    def setup(self) -> None:
        self.seen = 0.0

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.tank.level) > 60.1, [self.fan, self.furnace.damper], "the tank is full")
        yield Interlock(lambda: value_of(self.speed) > 80.0, [self.tank.mixer.motor], "too fast")

    def control(self) -> None:
        speed = value_of(self.speed)
        self.fan.write(0.04 * speed)
        self.brake.write(0.2 * speed - 9.0)
        self.seen += self.dt * self.tank.dt + self.furnace.dt + self.tank.mixer.motor.read()
        if speed > 55.0:
            self.furnace.damper.write(0.05 * speed)  # sent when the furnace is due, at once where it is at its default


class Carriage(Compound, every=5):
    slide: Slide


class RatedPlantWithAxis(RatedPlant):
    """An axis takes more RAM than an ATmega328P has left."""

    carriage: Carriage


def at(every: int, kind: type[Any]) -> type[Any]:
    """The same class at another rate."""
    return new_class(kind.__name__, (kind,), {"every": every, "equipment": kind._settings.equipment})


def rated_plant(
    beyond: float = 0.0,
    rates: Sequence[int] = (3, 7),
    kind: type[RatedPlant] = RatedPlant,
    **more: Compound,
) -> RatedPlant:
    """`rates`: of tank and furnace. `beyond`: time in ms by which the ages that are allowed are longer than whole
    periods."""

    def age(periods: int) -> str:
        return f"{periods + beyond} ms"

    def relay() -> BinaryActuator[OnOff]:
        return BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)

    def mixer(kind: type[Any] = Mixer, **changes: Any) -> Any:
        return kind(torque=sensor(**changes), motor=actuator(slew_rate=900.0))

    return kind(
        timer=timer(),
        speed=sensor(on_error="mark"),
        fan=actuator(expires=age(5)),
        brake=actuator(slew_rate=2000.0),
        tank=at(rates[0], Tank)(
            level=sensor(on_error="hold", max_age=age(7)),
            flow=sensor(filter="9 ms", velocity="4 ms", on_error="mark"),
            lid=BinarySensor(PassFail, one=PassFail.FAIL, debounce="8 ms", on_error="hold", max_age=age(10)),
            inlet=actuator(slew_rate=700.0, on_error="retry", max_age=age(10)),
            drain=actuator(expires=age(7), slew_rate=800.0),
            lamp=relay(),
            mixer=mixer(on_error="mark"),
        ),
        furnace=at(rates[1], Furnace)(
            temperature=sensor(on_error="mark"),
            pressure=sensor(on_error="hold", max_age=age(30)),
            heater=actuator(on_error="retry", max_age=age(20)),
            damper=actuator(slew_rate=500.0, expires=age(15)),
            valve=relay(),
            burner=Burner(flame=sensor(), gas=actuator()),
            jet=mixer(Jet, on_error="mark"),
        ),
        **more,
    )


def rated_plant_with_axis(rates: Sequence[int]) -> RatedPlant:
    """`rates`: of tank, furnace and axis."""
    slide = Slide(encoder=sensor(incremental=True), motor=actuator())
    return rated_plant(0.0, rates, RatedPlantWithAxis, carriage=at(rates[2], Carriage)(slide=slide))

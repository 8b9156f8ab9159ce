"""Row (a): umo, with range checks, quality and time on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.driver import Loop
from bench.mix import Layout
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Vector, connect
from umo.drivers import Direction
from umo.objects import atoms
from umo.states import EnableDisable, OnOff, PassFail, Rotation, UpDown


class ZAxis(Compound):
    motor: DigitalActuator
    encoder: DigitalSensor
    encoder_zero: BinaryActuator[EnableDisable]


class ThetaAxis(Compound):
    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    encoder: DigitalSensor
    encoder_zero: BinaryActuator[EnableDisable]


class Counterweight(Compound):
    vacuum: BinaryActuator[OnOff]
    pressure: DigitalSensor


class Gripper(Compound):
    vacuum: BinaryActuator[OnOff]
    pressure: BinarySensor[PassFail]


class Manipulator(Compound):
    z: ZAxis
    theta: ThetaAxis
    counterweight: Counterweight
    gripper: Gripper
    solenoid: BinaryActuator[OnOff]
    counter: DigitalSensor


class Plant(Compound):
    manipulators: list[Manipulator]
    rest: dict[str, Any]
    timer: DigitalSensor


def _enable() -> BinaryActuator[EnableDisable]:
    return BinaryActuator(EnableDisable, one=EnableDisable.ENABLE, default=EnableDisable.DISABLE)


def _valve() -> BinaryActuator[OnOff]:
    return BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)


def _z() -> ZAxis:
    return ZAxis(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=10.0 / 2047),
        encoder=DigitalSensor("um", minimum=55_000.0, maximum=129_000.0, resolution=4.64357, zero_offset=-147_871.0),
        encoder_zero=_enable(),
    )


def _theta() -> ThetaAxis:
    return ThetaAxis(
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
        encoder=DigitalSensor("deg", minimum=-270.0, maximum=270.0, resolution=0.000529483, zero_offset=227.4438),
        encoder_zero=_enable(),
    )


def _counterweight() -> Counterweight:
    return Counterweight(vacuum=_valve(), pressure=DigitalSensor("count", minimum=0.0, maximum=1000.0, resolution=1.0))


def _gripper() -> Gripper:
    return Gripper(vacuum=_valve(), pressure=BinarySensor(PassFail, one=PassFail.FAIL))


def _counter() -> DigitalSensor:
    return DigitalSensor("count", minimum=0.0, maximum=99_999.9, resolution=1.0)


MAKERS: dict[str, Any] = {
    "z": _z,
    "theta": _theta,
    "counterweight": _counterweight,
    "gripper": _gripper,
    "solenoid": _valve,
    "counter": _counter,
}


def machine(plan: Layout) -> Plant:
    """The plant, declared."""
    return Plant(
        manipulators=[Manipulator(**{name: make() for name, make in MAKERS.items()}) for _ in range(plan.manipulators)],
        rest={name: MAKERS[name]() for name in plan.rest},
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
    )


def wiring(plant: Plant, driver: Loop) -> dict[str, Any]:
    """Inputs and outputs on consecutive channels, in declared order; the timer in virtual time."""
    numbers = {Direction.INPUT: iter(range(10**6)), Direction.OUTPUT: iter(range(10**6))}
    wire: dict[str, Any] = {}
    for item in atoms(plant):
        if item is not plant.timer:
            name = "in" if item.direction is Direction.INPUT else "out"
            wire[item.path] = {"driver": "card", "channel": f"{name}:{next(numbers[item.direction])}"}
    wire["timer"] = {"driver": "simulated", "period": "1 ms"}
    return {"drivers": {"card": driver}, "wire": wire}


class Umo:
    """A connected plant and the work that is measured; `close` leaves it."""

    def __init__(self, plan: Layout, driver: Loop) -> None:
        self.driver = driver
        self.plant = machine(plan)
        self.connection = connect(self.plant, wiring(self.plant, driver))
        self.connection.__enter__()
        items: list[Any] = [item for item in atoms(self.plant) if item is not self.plant.timer]
        self.actuators = [item for item in items if item.direction is Direction.OUTPUT]
        self.sensors = [item for item in items if item.direction is Direction.INPUT]
        self.volts: list[tuple[DigitalActuator, float]] = []
        self.turned: list[tuple[DigitalActuator, float]] = []
        self.states: list[tuple[BinaryActuator[Any], Any]] = []
        self.vectors: list[tuple[Vector[Any], Any]] = []

    def prepare(self, commands: Sequence[float]) -> None:
        """Values and states as control code has them; for the vectors one for each kind of actuator."""
        pairs = list(zip(self.actuators, commands, strict=True))
        self.volts = [(item, value) for item, value in pairs if isinstance(item, DigitalActuator)]
        self.states = [(item, item.one if level else item.zero) for item, level in pairs if hasattr(item, "one")]
        self.turned = [(item, -value) for item, value in self.volts]
        motors, volts = zip(*self.volts, strict=True)
        self.vectors = [(Vector(motors), np.array(volts))]
        for kind in {item.states: None for item, _ in self.states}:
            alike = [(item, float(state is item.one)) for item, state in self.states if item.states is kind]
            self.vectors.append((Vector(item for item, _ in alike), np.array([level for _, level in alike])))

    def sample_update(self, periods: int) -> None:
        m = self.plant
        for _ in range(periods):
            m.sample()
            m.update()

    def write(self, periods: int) -> None:
        for _ in range(periods):
            for motor, volts in self.volts:
                motor.write(volts)
            for valve, state in self.states:
                valve.write(state)

    def write_vectors(self, periods: int) -> None:
        for _ in range(periods):
            for vector, values in self.vectors:
                vector.write(values)

    def period(self, periods: int) -> None:
        """The motors' commands change in each period, as a control law's do: what is unchanged is sent more quickly."""
        m = self.plant
        for number in range(periods):
            m.sample()
            for motor, volts in self.turned if number % 2 else self.volts:
                motor.write(volts)
            for valve, state in self.states:
                valve.write(state)
            m.update()

    def values(self) -> list[float]:
        return [
            sensor.read() if isinstance(sensor, DigitalSensor) else float(sensor.read() is sensor.one)
            for sensor in self.sensors
        ]

    def raws(self) -> list[int]:
        return [int(raw) for raw in self.driver.outputs]

    def load(self, readings: Sequence[int]) -> None:
        self.driver.inputs[:] = readings

    def close(self) -> None:
        self.connection.__exit__(None, None, None)

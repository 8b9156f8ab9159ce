"""The machines of the worlds: one output on a device on the cycle, one on a device behind a worker. The devices are in
the memory of the world and outlive all processes. The machine of worlds with clients has the second output in
equipment, which fails once by itself."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated, Any

import umo
from tools.schedules.gate import NS, Gate
from tools.schedules.shared import DEVICES, Head, Move
from umo.cycle.sequences import next_period
from umo.drivers import Channel, Direction, Driver
from umo.errors import DeviceTimeout
from umo.objects.range import Number

PERIODS, LONG, WITH_CLIENTS = 5, 100, 60
"""Periods that the application drives for; in a long run; and, in automatic mode, in one with clients."""
UNIT, UNIT_FAILS_AT, SETUP_TIME = "unit", 8, 0.004
"""The equipment, the period in which it fails, and the time in s that its `setup` takes."""
PERIOD, HANG_TIMEOUT, TIMEOUT, RESET_FOR = 0.01, 0.1, 0.02, 0.3
"""s."""
WIRING: dict[str, Any] = {
    "drivers": {
        "d1": {"type": "tools.schedules.machine:Board", "name": "d1", "timeout": f"{TIMEOUT:g} s"},
        "d2": {
            "type": "tools.schedules.machine:Board", "name": "d2", "timeout": f"{TIMEOUT:g} s", "off_cycle": True,
            "period": "20 ms", "max_age": "5 s",
        },
    },
    "wire": {
        "timer": {"driver": "timerfd", "period": f"{PERIOD:g} s"},
        "motor": {"driver": "d1"},
        "heater": {"driver": "d2"},
    },
    "process": {"hang_timeout": f"{HANG_TIMEOUT:g} s", "reset_for": f"{RESET_FOR:g} s"},
}  # fmt: skip
PLANT_WIRING = WIRING | {
    "wire": {name if name != "heater" else f"{UNIT}.heater": entry for name, entry in WIRING["wire"].items()}
}
periods = [PERIODS]
"""Those of this world."""
gates: list[Gate] = []
"""The gate of this process, where it is one of a world."""


class Machine(umo.Compound, stop_order=("heater", "motor")):
    timer: umo.DigitalSensor
    motor: umo.DigitalActuator
    heater: umo.DigitalActuator
    _: KW_ONLY
    count: Annotated[int, Number("", 0, 1e9, kept=True)] = 0
    """What a keeper writes, where there are frames."""


def declare() -> Machine:
    return Machine(timer=_timer(), motor=_output(), heater=_output())


def _timer() -> umo.DigitalSensor:
    return umo.DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)


def _output() -> umo.DigitalActuator:
    return umo.DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=1.0)


async def drive(m: Machine) -> str:
    """Another level in each period, so that each one writes."""
    for number in range(periods[0]):
        m.count = number
        m.motor.write(5.0 + number % 5)
        m.heater.write(5.0 + number % 5)
        await next_period()
    return "driven"


class Unit(umo.Compound, equipment=True):
    """Equipment whose control fails once."""

    heater: umo.DigitalActuator

    def setup(self) -> None:
        self._periods = 0
        for gate in gates:  # none, where the plan is made
            gate.stand("setup")
            gate.sleep(SETUP_TIME)

    def control(self) -> None:
        self._periods += 1
        if self._periods == UNIT_FAILS_AT:
            raise RuntimeError("it fails once")
        self.heater.write(5.0 + self._periods % 5)


class Plant(umo.Compound, stop_order=("unit", "motor")):
    """The machine of a world with clients."""

    timer: umo.DigitalSensor
    motor: umo.DigitalActuator
    unit: Unit
    _: KW_ONLY
    count: Annotated[int, Number("", 0, 1e9, kept=True)] = 0


def declare_plant() -> Plant:
    return Plant(timer=_timer(), motor=_output(), unit=Unit(heater=_output()))


async def drive_plant(m: Plant) -> str:
    for number in range(periods[0]):
        m.count = number
        m.motor.write(5.0 + number % 5)
        await next_period()
    return "driven"


class Board(Driver):
    """A device with one output, whose level is in the memory of the world; 0 is the default."""

    def __init__(self, *, name: str) -> None:
        self._name, self._number = name, DEVICES.index(name)

    def devices(self) -> list[str]:
        return [f"board {self._name}"]

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.OUTPUT, 8, signed=True)

    def open(self) -> None:
        self._tell(Move.OPEN)

    def close(self) -> None:
        self._tell(Move.CLOSE)

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._tell(Move.INITIALIZE, default)

    def finalize(self, channel: Channel) -> None:
        self._tell(Move.FINALIZE)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._tell(Move.RESET, default)

    def write(self, channel: Channel, raw: int) -> None:
        self._tell(Move.WRITE, raw)

    def _tell(self, move: Move, raw: int | None = None) -> None:
        """DeviceTimeout if the device does not answer."""
        (gate,) = gates
        head, level = gate.memory.head, "" if raw is None else f" {raw}"
        gate.stand(f"{self._name} {move.name}{level}")
        if head[Head.SILENT + self._number]:
            until = gate.now_ns() + round(self.timeout * NS)
            while gate.now_ns() < until:
                gate.sleep((until - gate.now_ns()) * 1e-9)
            raise DeviceTimeout("no answer")
        if raw is not None:
            head[Head.LEVELS + self._number] = raw
        gate.memory.note(gate.slot, self._number, move, raw or 0)

"""A plant of two reactors that are equipment, each on a circuit of its own."""

from __future__ import annotations

from typing import Any

from helpers.letters import Letters
from helpers.machines import actuator, relay, sensor, timer, wired
from umo import (
    BinaryActuator,
    Compound,
    DigitalActuator,
    DigitalSensor,
    TaskFailed,
    connect,
)
from umo.control import next_period
from umo.objects import atoms
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.states import OnOff
from umo.testing import Scripted


class Valve(Compound, equipment=True):
    """Equipment inside equipment."""

    coil: BinaryActuator[OnOff]


class Reactor(Compound, equipment=True, stop_order=("heater", "stirrer")):
    stirrer: DigitalActuator
    heater: DigitalActuator
    thermometer: DigitalSensor
    drain: BinaryActuator[OnOff]
    outlet: Valve

    def setup(self) -> None:
        self.law: Any = None
        self.acted = 0
        self.cleaned = 0

    def control(self) -> None:
        self.acted += 1
        if self.law is not None:
            self.law()

    async def heat(self, periods: int = 1000) -> str:
        try:
            self.heater.write(5.0)
            for _ in range(periods):
                await next_period()
            return "warm"
        finally:
            self.cleaned += 1


class Plant(Compound):
    timer: DigitalSensor
    lamp: BinaryActuator[OnOff]
    level: DigitalSensor
    a: Reactor
    b: Reactor

    def setup(self) -> None:
        self.acted = 0

    def control(self) -> None:
        self.acted += 1


def reactor(kind: type[Reactor] = Reactor, **changes: Any) -> Reactor:
    parts: dict[str, Any] = {
        "stirrer": actuator(),
        "heater": actuator(),
        "thermometer": sensor(),
        "drain": relay(synchronous=False),
        "outlet": Valve(coil=relay()),
    }
    return kind(**(parts | changes))


class Rig:
    """The plant; each reactor on a circuit of its own, the rest on a third."""

    def __init__(self, machine: Any = None, **changes: Any) -> None:
        self.boxes = {name: Scripted() for name in ("box", "of_a", "of_b")}
        parts = {"a": reactor(), "b": reactor()} | changes
        self.m: Any = machine or Plant(timer=timer(), lamp=relay(), level=sensor(), **parts)
        entries = {path: {"driver": f"of_{path[0]}"} for path in _paths(self.m) if path[:2] in ("a.", "b.")}
        drivers = {name: self.boxes[name] for name in ("of_a", "of_b")}
        self.connection = connect(self.m, wired(self.m, self.boxes["box"], entries=entries, **drivers))

    def __enter__(self) -> Rig:
        self.connection.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(*error)

    def periods(self, count: int = 1) -> None:
        for _ in range(count):
            self.m.timer.read()
            self.m.sample()
            self.m.control()
            self.m.update()

    @property
    def texts(self) -> list[str]:
        return [f"{event.path}: {event.text}" for event in self.connection.machine.events]


def _paths(machine: Compound) -> list[str]:
    return [item.path for item in atoms(machine)]


def run_both(rig: Rig) -> None:
    """Both reactors are driven."""
    for each in (rig.m.a, rig.m.b):
        each.cycle.start(each.heat())
        each.stirrer.write(2.0)
        each.drain.write(OnOff.ON)
        each.outlet.coil.write(OnOff.ON)
    rig.m.lamp.write(OnOff.ON)
    rig.periods(2)
    assert [driven(each) for each in (rig.m.a, rig.m.b)] == [(2.0, 5.0, OnOff.ON, OnOff.ON)] * 2


def driven(each: Reactor) -> tuple[Any, ...]:
    return each.stirrer.read(), each.heater.read(), each.drain.read(), each.outlet.coil.read()


AT_DEFAULT = (0.0, 0.0, OnOff.OFF, OnOff.OFF)
DRIVEN = (2.0, 5.0, OnOff.ON, OnOff.ON)


def fail_law(rig: Rig) -> None:
    def broken() -> None:
        raise ValueError("the law is broken")

    rig.m.a.law = broken


def fail_sensor(rig: Rig) -> None:
    rig.boxes["of_a"].set("a.thermometer", OSError("the wire is broken"))


def fail_actuator(rig: Rig) -> None:
    box = rig.boxes["of_a"]
    box.at(len(box.calls) + 1, OSError("short circuit"))  # after read_many, write_many


def fail_sequence(rig: Rig) -> None:
    async def phase() -> None:
        raise TaskFailed("no feed")

    rig.m.a.cycle.start(phase())


FAILURES = [fail_law, fail_sensor, fail_actuator, fail_sequence]
REASONS = ["the law is broken", "the wire is broken", "short circuit", "no feed"]


async def failing() -> None:
    raise TaskFailed("no feed")


class Commanded(Rig):
    """With a client that has the lease."""

    def __init__(self, mode: Mode = Mode.AUTOMATIC, **changes: Any) -> None:
        super().__init__(**changes)
        self.letters, self.mode, self.number = Letters(), mode, 0
        self.now = 1.0
        """The clock of the heartbeats, s."""

    def __enter__(self) -> Commanded:
        super().__enter__()
        machine = self.connection.machine
        machine.attach(ClientControl(self.letters, self.letters, self.mode, lambda: self.now))
        self.do("lease")
        return self

    def do(self, do: str, path: str = "", **more: Any) -> tuple[str, str]:
        """Send it, and let a period pass; its last answer."""
        self.number += 1
        self.letters.signs = dict.fromkeys(("", path), (1, 1.0))
        self.letters.waiting.append(ClientCommand(self.number, "ann", "key", do, path, **more))
        self.periods()
        return self.answer(self.number)

    def answer(self, number: int) -> tuple[str, str]:
        events = self.connection.machine.events
        return next((str(each.state), each.text) for each in reversed(events) if each.command == number)

"""A machine in this process that faces are tried on: one of everything that a face can show, stepped by the test's loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from typing import Annotated, Any

from helpers.machines import actuator, relay, sensor, switch, timer, wired
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Number,
    Range,
    action,
    connect,
    published,
)
from umo.alarms import Alarm, High
from umo.control import wait
from umo.cycle.client_commands import Mode
from umo.cycle.client_control import ClientControl
from umo.errors import FramesError
from umo.faces.contract import Changes, Commands, Face
from umo.faces.declaration import Declaration
from umo.faces.host import Host
from umo.frames import Reader
from umo.frames.client_memory import ClientMemory
from umo.frames.reader import NumberedEvent
from umo.remote.queue import Receiver
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods

STEP = 0.005
"""Time in s from one period to the next, of 1 ms in the machine's own time."""
LIMIT = 20.0
"""Time in s within which what a test waits for must come."""


class Phase(Enum):
    IDLE = 0
    FILLING = 1
    COOKING = 2


class Cell(
    Compound,
    alarms={"full": Alarm(High("level", 80.0), "too full")},
    equipment=True,
):
    """Equipment with everything."""

    level: DigitalSensor
    limit: BinarySensor[PassFail]
    valve: DigitalActuator
    lamp: BinaryActuator[OnOff]
    _: KW_ONLY
    gain: Annotated[float, Number("mm", 0.0, 10.0, tunable=True)] = 1.0
    phase: Annotated[Phase, Number(shown=True)] = Phase.IDLE
    done = 0

    @action(harmless=True, weight=Range("kg", 0.0, 5.0))
    def add(self, weight: float) -> float:
        """Add so much, in kg; twice as much is returned."""
        return 2 * weight

    @action(harmless=True)
    async def cook(self) -> None:
        """Cook until it is cancelled."""
        await wait(1e9)

    @action(velocity=Range("V", -10.0, 10.0), release="halt")
    def jog(self, velocity: float) -> None:
        """Drive the valve while it is held."""
        self.valve.write(velocity)

    def halt(self) -> None:
        self.valve.write(0.0)


class Plant(Compound):
    timer: DigitalSensor
    cell: Cell


@dataclass
class Live:
    """The machine while it runs."""

    m: Plant
    box: Scripted
    gauge: Scripted
    """The device of the level."""
    connection: Any
    path: Any
    running: bool = True

    def set(self, channel: str, raw: Any) -> None:
        (self.gauge if channel == "cell.level" else self.box).set(channel, raw)

    async def step_for_ever(self) -> None:
        while True:
            if self.running:
                periods(self.m)
            await asyncio.sleep(STEP)


@asynccontextmanager
async def live(mode: Mode = Mode.AUTOMATIC) -> AsyncIterator[Live]:
    """A machine that runs, takes commands and is found."""
    cell = Cell(level=sensor(on_error="hold", max_age="1 h"), limit=switch(), valve=actuator(), lamp=relay())
    m, box, gauge = Plant(timer=timer(), cell=cell), Scripted(), Scripted({"cell.level": 20})
    wiring = wired(m, box, clock=VirtualTimer(), entries={"cell.level": {"driver": "gauge"}}, gauge=gauge)
    connection = connect(m, wiring)
    with connection, published(connection, "plant", "simulated") as ring, Reader(ring.path) as own:
        assert own.ends is not None
        cells = ClientMemory(own.ends.cells, ring.layout)
        machine = connection.machine
        machine.clients = ClientControl(machine, Receiver(cells), cells, mode)
        ring.show(machine.clients)
        rig = Live(m, box, gauge, connection, ring.path)
        stepping = asyncio.create_task(rig.step_for_ever())
        try:
            yield rig
        finally:
            stepping.cancel()
            await asyncio.gather(stepping, return_exceptions=True)
            cells.close()


@asynccontextmanager
async def hosted(rig: Live, *faces: Face, read_only: bool = False, **more: Any) -> AsyncIterator[list[str]]:
    """A host with these faces; what it says."""
    said: list[str] = []

    def find() -> Reader:
        with contextlib.suppress(FramesError):
            reader = Reader(rig.path)
            if reader.alive:
                return reader
            reader.close()
        raise FramesError("plant does not run")

    named = [(type(face).__name__.lower(), face) for face in faces]
    host = Host(None, named, rate=100.0, read_only=read_only, say=said.append, find=find, **more)
    serving = asyncio.create_task(host.run())
    try:
        yield said
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


async def until(condition: Callable[[], Any]) -> Any:
    """What the condition returns, once it is true."""
    async with asyncio.timeout(LIMIT):
        while not (found := condition()):
            await asyncio.sleep(STEP)
    return found


class Recorder(Face):
    """A face that notes what it is told."""

    proves_users = True

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.machine: Declaration | None = None
        self.commands: Any = None
        self.told: list[Changes] = []
        self.heard: list[NumberedEvent] = []
        self.why = ""

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self.calls.append("begin")
        self.machine, self.commands = machine, commands

    async def frames(self, changes: Changes) -> None:
        self.calls.append("frames")
        self.told.append(changes)

    async def events(self, events: Any) -> None:
        self.calls.append("events")
        self.heard += events

    async def end(self, why: str) -> None:
        self.calls.append("end")
        self.why = why

    def value(self, name: str) -> float:
        assert self.machine is not None
        return float(self.told[-1].values[self.machine.by_name[name].number])

    def quality(self, name: str) -> int:
        assert self.machine is not None
        return int(self.told[-1].quality[self.machine.by_name[name].number])

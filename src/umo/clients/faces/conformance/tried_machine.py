"""The machine on which faces are tested. It runs in this process and has one item of every kind that a face can
show."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import KW_ONLY
from enum import Enum
from math import ceil
from pathlib import Path
from typing import Annotated, Any

from umo.control import wait
from umo.cycle.connect import connect
from umo.errors import FramesError
from umo.objects import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Number,
    Range,
    action,
)
from umo.operation.alarms import Alarm, High
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.client_control import ClientControl
from umo.process.frames import Reader, published
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver
from umo.states import OnOff, PassFail
from umo.testing.periods import periods
from umo.testing.scripted import Scripted
from umo.testing.virtual import VirtualTimer

STEP = 0.005
"""Time in s from one period to the next. On the machine's clock a period is 1 ms."""
LIMIT = 20.0
"""Time in s within which an awaited condition must become true (`until`)."""
OWN_DEVICES = {"cell.level": "gauge", "cell.position": "ruler"}
"""Objects that each have a device of their own."""


class Phase(Enum):
    """A value with more than two states."""

    IDLE = 0
    FILLING = 1
    COOKING = 2


ALARMS = {"full": Alarm(High("level", 80.0), "too full"), "over 90 % (#1)": Alarm(High("level", 90.0), "spills")}
"""The alarms of the cell. The name of an alarm can be any text."""


class TriedCell(Compound, equipment=True, alarms=ALARMS):
    """Equipment with a level of 0 to 100 mm, a limit switch, a valve of -10 to 10 V, a lamp."""

    level: DigitalSensor
    position: DigitalSensor
    """The incremental position, which is not referenced at first. It is marked BAD when its device returns nothing."""
    limit: BinarySensor[PassFail]
    valve: DigitalActuator
    lamp: BinaryActuator[OnOff]
    _: KW_ONLY
    gain: Annotated[float, Number("mm", 0.0, 10.0, tunable=True)] = 1.0
    phase: Annotated[Phase, Number(shown=True)] = Phase.IDLE

    @action(harmless=True, weight=Range("kg", 0.0, 5.0))
    def add(self, weight: float) -> float:
        """Add an amount in kg, and return twice the amount."""
        return 2 * weight

    @action(harmless=True)
    async def cook(self) -> None:
        """Cook until the action is cancelled."""
        await wait(1e9)

    @action(velocity=Range("V", -10.0, 10.0), release="halt")
    def jog(self, velocity: float) -> None:
        """Drive the valve while it is held."""
        self.valve.write(velocity)

    def halt(self) -> None:
        self.valve.write(0.0)


class Plant(Compound):
    timer: DigitalSensor
    cell: TriedCell


def plant() -> Plant:
    span: dict[str, Any] = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.5}
    return Plant(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=1e6, resolution=1.0, synchronous=False),
        cell=TriedCell(
            level=DigitalSensor("mm", on_error="hold", max_age="1 h", **span),
            position=DigitalSensor("mm", incremental=True, on_error="mark", **span),
            limit=BinarySensor(PassFail, one=PassFail.FAIL),
            valve=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.5),
            lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        ),
    )


class TriedMachine:
    """The running plant, with a step every 5 ms. It can be ended and started again."""

    def __init__(self, mode: Mode = Mode.AUTOMATIC) -> None:
        self.mode = mode
        self.goes_on = True
        """True while periods are run; False if the machine is silent."""
        self.m = plant()
        self.devices = {"box": Scripted(), "gauge": Scripted({"cell.level": 20}), "ruler": Scripted()}
        """The devices: the gauge for the level, the ruler for the position, the box for everything else."""
        self._run = ExitStack()
        self._stepping: asyncio.Task[None] | None = None
        self._path: Path | None = None
        self.connection: Any = None

    async def __aenter__(self) -> TriedMachine:
        self.begin()
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.end()

    def begin(self) -> None:
        """Start a run that publishes new frames."""
        wire: dict[str, Any] = {"timer": {"driver": "clock", "period": "1 ms"}}
        wire |= {f"cell.{name}": {"driver": "box"} for name in ("limit", "valve", "lamp")}
        wire |= {path: {"driver": name} for path, name in OWN_DEVICES.items()}
        drivers = {**self.devices, "clock": VirtualTimer()}
        self.connection = connect(self.m, {"drivers": drivers, "wire": wire})
        self._run.enter_context(self.connection)
        ring = self._run.enter_context(published(self.connection, "plant", "simulated"))
        own = self._run.enter_context(Reader(ring.path))
        assert own.ends is not None
        cells = ClientMemory(own.ends.cells, ring.layout)
        self._run.callback(cells.close)
        machine = self.connection.machine
        self.clients = machine.attach(ClientControl(Receiver(cells), cells, self.mode))
        ring.show(self.clients)
        self._path = ring.path
        self._stepping = asyncio.create_task(self._step())

    async def end(self) -> None:
        """End the run as a machine does: its actuators are reset."""
        if self._stepping is not None:
            self._stepping.cancel()
            await asyncio.gather(self._stepping, return_exceptions=True)
            self._stepping, self._path = None, None
            self._run.close()

    async def _step(self) -> None:
        while True:
            if self.goes_on:
                periods(self.m)
            await asyncio.sleep(STEP)

    def find(self) -> Reader:
        """Return the frames of the run. Raises FramesError while there is no run."""
        if self._path is not None:
            with suppress(FramesError):
                return Reader(self._path)
        raise FramesError("plant does not run")

    def set(self, path: str, raw: Any) -> None:
        """Set the raw value that the device of an object returns from now on, or the error that it raises. Two raw
        steps are 1 mm."""
        self.devices[OWN_DEVICES.get(path, "box")].set(path, raw)

    @property
    def number(self) -> int:
        """Number of the last period."""
        return int(self.connection.machine.clock.number)

    @property
    def events(self) -> list[Any]:
        return list(self.connection.machine.events)

    @property
    def holder(self) -> str:
        """The name of the client who has the lease."""
        return str(self.clients.lease.holder)


async def until(condition: Callable[[], Any], within: float = LIMIT) -> Any:
    """Return the result of the condition once it is true. Raises TimeoutError if it is not true within `within` s,
    counted in checks of `STEP` each. On a busy computer the checks are late, so the face and its clients, which are
    also late, get more time."""
    for _ in range(ceil(within / STEP)):
        if found := condition():
            return found
        await asyncio.sleep(STEP)
    raise TimeoutError(f"the condition did not become true within {within:g} s")


async def finishes(task: asyncio.Task[Any], within: float = LIMIT) -> bool:
    """True if the task ends within this time in s, counted as in `until`. Otherwise the task is cancelled, and the
    result is False."""
    try:
        return bool(await until(task.done, within))
    except TimeoutError:
        return False
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

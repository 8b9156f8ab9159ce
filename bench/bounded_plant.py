"""The machine of `python -m bench --bounds`: many parts on a simulated driver, with clients, alarms and frames."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from time import thread_time
from typing import Annotated, Any

import umo
from umo import Compound, DigitalActuator, DigitalSensor, Interlock, Number, action
from umo.control import Servo, next_period
from umo.cycle.to_defaults import ToDefault
from umo.drivers import Looks
from umo.drivers.simulated import Simulated
from umo.objects import atoms
from umo.operation import PackML
from umo.operation.alarms import Alarm, Low
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.operation.recipe_book import RecipeBook
from umo.operation.recipes import Recipe
from umo.process.frames import published
from umo.process.frames.memory import RunDescriptors
from umo.testing import VirtualTimer

PERIOD = 0.001
OWN_PERIOD, MAX_AGE = "50 ms", "150.2 ms"
"""Of a driver off the cycle. No number of periods lasts as long as the age: in which one it is over does not depend on
rounding."""
SLOW = "temperatures", "probes"
"""The drivers that are off the cycle in a `SlowRig`."""
OF_ZONE = 10
"""Number of the objects of a zone."""


ALARMS = {"cold": Alarm(Low("temperatures.0", -1.0), "it is cold")}
NUMBERS = {"gain": Number(tunable=True, minimum=0.0, maximum=10.0)}


class Zone(Compound, equipment=True, alarms=ALARMS, numbers=NUMBERS):
    """One part of the plant: equipment with ten objects, a law, a tunable number, an action and an alarm."""

    heaters: list[DigitalActuator]
    temperatures: list[DigitalSensor]
    gain = 1.0
    broken = False

    def setup(self) -> None:
        self.servo = Servo(self.temperatures[0], self.heaters[0], gain=1.0)

    def control(self) -> None:
        if self.broken:
            raise ValueError("it is broken")

    @action
    def warm(self) -> None:
        """Nothing that takes time."""


class HallStates(PackML):
    """The states of a hall."""


class Filling(Recipe):
    """A recipe with as many values as a client can send."""

    levels: Annotated[list[float], Number("V", 0.0, 10.0)]


class Hall(Compound, equipment=True):
    """Many actuators in one equipment, with the states of PackML and a book of recipes."""

    fans: list[DigitalActuator]

    def setup(self) -> None:
        self.unit = HallStates(self)
        self.book = RecipeBook(Filling, Path(__file__).with_name("bounded_recipes.toml"))


class Plant(Compound):
    """`zones` that fail alone, one hall, valves under one interlock, and probes."""

    timer: DigitalSensor
    zones: list[Zone]
    valves: list[DigitalActuator]
    probes: list[DigitalSensor]
    hall: Hall
    stopped = False
    each_stopped = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.stopped, list(self.valves), "emergency stop", latched=True)
        for number, zone in enumerate(self.zones):
            yield Interlock(lambda: self.each_stopped, list(zone.heaters), f"zone {number} is open")


def _actuator(**more: Any) -> DigitalActuator:
    return DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01, **more)


def _sensor(**more: Any) -> DigitalSensor:
    return DigitalSensor("degC", minimum=-100.0, maximum=100.0, resolution=0.1, **more)


def plant(count: int) -> Plant:
    """So many objects in zones of ten, so many valves, probes and fans."""
    half = OF_ZONE // 2
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False)
    return Plant(
        timer=timer,
        zones=[
            Zone(heaters=[_actuator() for _ in range(half)], temperatures=[_sensor() for _ in range(half)])
            for _ in range(count // OF_ZONE)
        ],
        valves=[_actuator(expires="1 s") for _ in range(count)],
        probes=[_sensor(on_error="mark") for _ in range(count)],
        hall=Hall(fans=[_actuator() for _ in range(count)]),
    )


class Away(Simulated, Looks):
    """A simulated circuit whose block transfers may time out; it knows whether its device answers."""

    def __init__(self) -> None:
        super().__init__(history=1)
        self.away = False

    def look(self) -> bool | None:
        return not self.away

    def read_many(self, channels: Any, out: Any) -> None:
        if self.away:
            raise TimeoutError("no answer")
        super().read_many(channels, out)

    def write_many(self, channels: Any, raws: Any) -> None:
        if self.away:
            raise TimeoutError("no answer")
        super().write_many(channels, raws)


class Box:
    """The commands of clients, as they come in."""

    def __init__(self) -> None:
        self.taken = self.dropped = 0
        self.waiting: deque[ClientCommand] = deque()

    def get(self) -> ClientCommand | None:
        return self.waiting.popleft() if self.waiting else None


class Signs:
    """The heartbeats of clients: there are some until `silent`."""

    def __init__(self) -> None:
        self.asked, self.now, self.silent = [0], 0.0, False
        self.stop: tuple[int, str] | None = None
        self.last = 0.0

    def signed(self, path: str, lease: int) -> float:
        return self.last


class Rig:
    """A connected plant with so many objects of each kind, whose frames are published. `step` is one period."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._stack = ExitStack()
        self.m = plant(count)
        self.box, self.signs = Box(), Signs()
        self.number = 0
        drivers = {name: Away() for name in ("heaters", "temperatures", "valves", "probes", "fans")}
        self.drivers: dict[str, Away] = drivers
        wire: dict[str, Any] = {"timer": {"driver": "clock", "period": PERIOD}}
        for item in atoms(self.m):
            if item is not self.m.timer:
                wire[item.path] = {"driver": item.path.split(".")[-2], "channel": item.path}
        log = logging.getLogger("umo")
        handler, propagated = logging.FileHandler(os.devnull), log.propagate
        log.addHandler(handler)
        log.propagate = False
        self._stack.callback(setattr, log, "propagate", propagated)
        self._stack.callback(handler.close)
        self._stack.callback(log.removeHandler, handler)
        tables = {"clock": VirtualTimer(), **self._tables()}
        self.connection = umo.connect(self.m, {"drivers": tables, "wire": wire})
        self._stack.enter_context(self.connection)
        self.machine = self.connection.machine
        self._watch_resets()
        own, readers = RunDescriptors.pair()
        self._stack.callback(own.close)
        self._stack.callback(readers.close)
        self._stack.enter_context(published(self.connection, "bounds", ends=own))
        self.clients = ClientControl(self.box, self.signs, Mode.AUTOMATIC, clock=lambda: self.signs.now)
        self.machine.attach(self.clients)

    def _tables(self) -> dict[str, Any]:
        """The drivers of the wiring."""
        return {**self.drivers}

    def close(self) -> None:
        self._stack.close()

    def step(self) -> float:
        """One period; its time in s, of the processor: others may have it meanwhile."""
        self.signs.now += PERIOD
        if not self.signs.silent:
            self.signs.last = self.signs.now
        m = self.m
        self.were_reset = 0.0
        self._began = thread_time()
        m.timer.read()
        m.sample()
        m.control()
        m.update()
        return thread_time() - self._began

    def _watch_resets(self) -> None:
        """Note when in a period the last actuator was reset."""
        image: Any = self.machine.image
        self._began = self.were_reset = 0.0
        settle = image.settle

        def watched(slots: Any, way: ToDefault) -> Any:
            failures = settle(slots, way)
            if way is ToDefault.RESET:
                self.were_reset = thread_time() - self._began
            return failures

        image.settle = watched

    def steps(self, count: int) -> float:
        """The shortest of some periods, in s."""
        return min(self.step() for _ in range(count))

    def ask(self, do: str, path: str = "", value: Any = None, **more: Any) -> None:
        """A command of the client that has the lease."""
        self.number += 1
        self.box.waiting.append(ClientCommand(self.number, "ann", "key", do, path, value, **more))

    def do(self, do: str, path: str = "", value: Any = None, **more: Any) -> None:
        """The same, carried out in periods that are not measured."""
        self.ask(do, path, value, **more)
        self.drain()

    def drain(self) -> None:
        """Periods until nothing waits."""
        while self.box.waiting or self.machine.events.untold:
            self.step()
        self.steps(2)

    def answer(self) -> str:
        """The answer to the last command, with its state."""
        found = [event for event in self.machine.events if event.command == self.number]
        return f"{found[-1].state} {found[-1].text}" if found else ""

    def ask_other(self, do: str, **more: Any) -> None:
        """A command of another client."""
        self.number += 1
        self.box.waiting.append(ClientCommand(self.number, "bob", "other", do, **more))

    def ask_to_stop(self) -> None:
        self.signs.stop, self.signs.asked[0] = (2, "ann"), 1

    def go_on(self) -> None:
        """The stop is not heeded, so that more can be measured."""
        self.signs.stop, self.signs.asked[0] = None, 0
        self.clients._stopping = False
        self.connection.stop.requested = False

    def happened(self, text: str) -> bool:
        """Whether one of the last events begins so, its state first where it is an answer."""
        told = [event for event in self.machine.events if event.time == self.m.now]
        return any(text in (str(event.state), event.text[: len(text)]) for event in told)

    def last(self) -> list[str]:
        return [f"{event.state} {event.path} {event.text}" for event in list(self.machine.events)[-3:]]

    def write_all(self, value: float) -> None:
        """Drive every actuator of the zones, the valves and the hall."""
        for each in (*self.heaters, *self.m.valves, *self.m.hall.fans):
            each.write(value)

    @property
    def heaters(self) -> list[DigitalActuator]:
        return [each for zone in self.m.zones for each in zone.heaters]

    def hold_all(self) -> None:
        """In manual mode, under the lease: a client writes every valve."""
        for number in range(self.count):
            self.ask("write", f"valves.{number}", 5.0)
        self.drain()

    def reset_time(self, items: Any) -> float:
        """The time in s of the resets of these actuators by the program."""
        slots = [item._slot for item in items]
        began = thread_time()
        self.machine.image.reset_some(slots)
        return thread_time() - began


class SlowRig(Rig):
    """The same with its temperatures and probes off the cycle. What their devices take is not timed: a process of their
    own does that."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        remotes = (self.machine.image.segments.drivers[name] for name in SLOW)
        self._servers = [remote.server for remote in remotes]
        self._work = [server.work for server in self._servers]
        for server in self._servers:
            server.work = _nothing

    def _tables(self) -> dict[str, Any]:
        own = {"off_cycle": True, "period": OWN_PERIOD, "max_age": MAX_AGE}
        return {**self.drivers, **{name: {"type": self.drivers[name], **own} for name in SLOW}}

    def step(self) -> float:
        for work in self._work:
            work()
        return super().step()

    def hasten(self) -> None:
        """The devices transfer their values now."""
        for server in self._servers:
            server._due = 0

    def until_old(self, name: str, ages: int) -> None:
        """The device is away: periods until the next one finds its values older than so many maximum ages."""
        self.drivers[name].away = True
        remote = self.machine.image.segments.drivers[name]
        image: Any = self.machine.image
        slot = next(slot for slot, wire in enumerate(image.wires) if wire.driver is remote)
        while self.m.now + PERIOD - image.times[slot] <= ages * remote.max_age:
            self.step()
        for server in self._servers:  # nothing else arrives in that period
            server._due = server.ns() + 10_000_000

    def until_back(self, name: str) -> None:
        """The device answers again: periods until its values are there."""
        self.drivers[name].away = False
        items = [item for item in atoms(self.m) if item.path.split(".")[-2:-1] == [name]]
        while any(item.quality is not umo.Quality.GOOD for item in items):
            self.step()


def _nothing() -> None:
    """Another process does it."""


async def failing() -> None:
    """A sequence that fails in its next period."""
    await next_period()
    raise ValueError("it is broken")

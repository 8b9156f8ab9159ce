"""Commands of a mirror to a station of a fleet under a schedule of their messages, and what must be true of them.

Both ends are umo's (`MirrorCommands`, `FleetCommands`); the machine behind the gateway notes what it carries out, and
tells it in an event, which goes the same way as the answers.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from itertools import count
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from tools.message_orders.fleet_net import Net, NetSession, virtual_fleet
from tools.message_orders.link_world import Untrue, require
from tools.message_orders.schedules import Schedule
from umo.clients.fleet.fleet_commands import CLOCK_ERROR, FleetCommands, FleetUsers
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.mirror_commands import VALID, MirrorCommands
from umo.cycle.events import CommandState, Event
from umo.errors import CommandRefused
from umo.operation.commands.client_commands import ClientCommand

SCENARIOS = ("commands",)
KEY = StationKey("c1", "made")
LOOK = 0.1
"""s from one look of the mirror to the next."""
SHORT, LONG = 0.25, VALID + 2.0
"""Times in s for which a message is held: others overtake it, or a command is not valid any more."""
ANSWER_TIME = 2 * VALID + 1.0
"""s within which the end of each command is told."""
COMMANDS = 3
DURATION = 0.35
"""s that the machine takes for one: a copy comes before its end."""
REFUSED = 2
"""The number of a command that the machine refuses."""


class Machine:
    """What is behind the gateway."""

    def __init__(self, net: Net, session: Any) -> None:
        self.carried_out: Counter[str] = Counter()
        self.begun_at: dict[str, float] = {}
        self._net, self._session, self._numbers = net, session, count(100)

    async def take_lease(self, user: Any, *, over: bool = False) -> int:
        del user, over
        return 7

    def give_back(self, user: Any) -> None: ...

    async def ask(self, user: Any, do: str, path: str, *, sent: Any, **more: Any) -> int:
        del user, do, more
        number = next(self._numbers)
        if path == f"p{REFUSED}":
            raise CommandRefused("it is inhibited")
        sent(number)
        self.begun_at[path] = self._net.now
        while self._net.now < self.begun_at[path] + DURATION:
            await asyncio.sleep(0)
        self.carried_out[path] += 1
        self._session.put("event", f"{number} {path}")
        return number


class CommandWorld:
    """A gateway and a mirror. The loop of the gateway runs when something has come."""

    def __init__(self, net: Net, loop: asyncio.AbstractEventLoop) -> None:
        self.net, self._loop = net, loop
        session: Any = NetSession(net)
        self.machine = Machine(net, session)
        self.told: dict[int, list[Event]] = {}
        self._coming: list[ClientCommand] = []
        self._sent_at: dict[str, float] = {}
        self._gateway = loop.run_until_complete(self._begin(session))
        session.declare_subscriber("event", self._take_event)
        inbox = SimpleNamespace(get=lambda: self._coming.pop(0) if self._coming else None, taken=0, dropped=0)
        cells = SimpleNamespace(stop=None, signed=lambda path, lease: net.now)
        ring: Any = SimpleNamespace(cells=cells, live=lambda given: None, lease=lambda *given: None)
        with patch("umo.clients.fleet.mirror_commands.Receiver", lambda cells: inbox):
            self.commands = MirrorCommands(session, KEY, "ann", ring, self._tell)

    async def _begin(self, session: Any) -> FleetCommands:
        gateway: Any = self.machine
        return FleetCommands(session, KEY, FleetUsers(), lambda: gateway, lambda: 1e9 + self.net.now)

    def _tell(self, event: Event) -> None:
        if event.command:
            self.told.setdefault(event.command, []).append(event)
            require(len(self.told[event.command]) == 1, f"the end of command {event.command} is told twice")

    def _take_event(self, sample: Any) -> None:
        """As a mirror takes one from its feed, which has each once."""
        number, path = sample.payload.decode().split()
        local = self.commands.local(int(number))
        if local and local not in self._evented:
            self._evented.add(local)
            self._tell(Event(0.0, path, "", "ann", local, CommandState.DONE, ""))
            self.commands.has_ended(local)

    def step(self) -> None:
        until = self.net.now + LOOK
        while (due := self.net.next_due) <= until:
            self.net.carry(due)
            self._loop.run_until_complete(_turns())
        self.net.carry(until)
        self._loop.run_until_complete(_turns())
        self.commands.look()

    def _ask(self, number: int, do: str = "write") -> None:
        self._sent_at[f"p{number}"] = self.net.now
        self._coming.append(ClientCommand(number, "ann", "key", do=do, path=f"p{number}", value=1.0))

    def run(self) -> None:
        self._evented: set[int] = set()
        self._ask(1, "lease")
        self._until_told([1])
        self.net.counts = True
        numbers = list(range(2, 2 + COMMANDS))
        for number in numbers:
            self._ask(number)
            self.step()
        self._until_told(numbers)
        self.net.counts = False
        last = numbers[-1] + 1
        self._ask(last)
        self._until_told([last])
        require(self.told[last][0].state is CommandState.DONE, "a command is not carried out, whose messages come")
        self._check()

    def _until_told(self, numbers: list[int]) -> None:
        until = self.net.now + ANSWER_TIME
        while not all(each in self.told for each in numbers):
            require(self.net.now < until, f"the end of a command is not told within {ANSWER_TIME:g} s")
            self.step()

    def _check(self) -> None:
        for _ in range(round((LONG + SHORT) / LOOK)):  # what is held comes
            self.step()
        for path, times in self.machine.carried_out.items():
            require(times == 1, f"command {path} is carried out {times} times")
            age = self.machine.begun_at[path] - self._sent_at[path]
            require(age <= VALID + CLOCK_ERROR + LOOK, f"command {path} is carried out {age:g} s after it was sent")
        for number, (event,) in self.told.items():
            done = self.machine.carried_out[f"p{number}"]
            if number > 1 and event.state is CommandState.DONE:
                require(bool(done), f"command {number} is told as done, and was not carried out")
            require("has ended" not in event.text, f"command {number} is told as of a gateway that has ended")
            if event.text.startswith("CommandRefused"):
                require(not done, f"command {number} is told as refused, and was carried out")

    def close(self) -> None:
        self._loop.run_until_complete(self._gateway.close())


async def _turns() -> None:
    for _ in range(6):
        await asyncio.sleep(0)


class CommandRuns:
    """Runs schedules, each with a gateway and a mirror of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()

    def run(self, schedule: Schedule) -> str:
        """What is untrue; "": nothing."""
        net = Net(schedule.letters, SHORT, LONG)
        with virtual_fleet(net):
            world = CommandWorld(net, self._loop)
            try:
                world.run()
            except Untrue as error:
                return str(error)
            finally:
                world.close()
        return ""

    def close(self) -> None:
        self._loop.close()

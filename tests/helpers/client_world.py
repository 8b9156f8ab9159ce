"""A machine and its clients in virtual time. After each period it is looked at what must be true of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import KW_ONLY
from typing import Annotated, Any

from helpers.machines import actuator, timer, wired
from umo import connect
from umo.clients.remote.client_session import LEASE_TIME, ClientSession, PendingCommand
from umo.control import wait
from umo.cycle.events import CommandState, Event
from umo.errors import UmoError
from umo.objects import Compound, DigitalActuator, DigitalSensor, Number, Range, action
from umo.operation.commands.client_commands import DEAD_MAN_TIME, Mode
from umo.operation.commands.client_control import ClientControl
from umo.operation.commands.verbs import GIVE_BACK, TAKE_LEASE
from umo.process.frames import Reader, published
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver
from umo.testing import Scripted, periods

STEP = 0.05
"""s on the clock of the heartbeats from one period to the next."""
SLACK = 2 * STEP
"""s by which the machine sees later than a client dies that it has died."""


class Cell(Compound):
    """Every kind of thing that clients do: what is done at once, what lasts, what is held."""

    timer: DigitalSensor
    valve: DigitalActuator
    _: KW_ONLY
    gain: Annotated[float, Number("mm", 0.0, 10.0, tunable=True)] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.counted: list[int] = []

    @action(harmless=True, number=Range("", 0.0, 1e9))
    def count(self, number: float) -> None:
        self.counted.append(int(number))

    @action(harmless=True)
    async def cook(self) -> None:
        await wait(1e9)

    @action(velocity=Range("V", -10.0, 10.0), release="halt")
    def jog(self, velocity: float) -> None:
        """Above 5 V it fails, once it has begun."""
        self.valve.write(2 * velocity)

    def halt(self) -> None:
        self.valve.write(0.0)


class WorldClient:
    """A client: it sends heartbeats and looks for answers in each period, as long as it lives and is not frozen."""

    def __init__(self, world: ClientWorld, name: str) -> None:
        self.name, self._world = name, world
        self.session = ClientSession(world.reader.again(), clock=lambda: world.now)
        self.is_alive, self.is_frozen = True, False
        self.last_life = world.now
        """When it was there last, ns."""
        self.waits: list[PendingCommand] = []
        self.ends: list[Event] = []
        """The ends of its commands, as it was told them."""
        self._had_lease = False

    def asking(self, do: str, path: str = "", **fields: Any) -> PendingCommand:
        self.last_life = self._world.now
        return self.session.asking(do, path, who=self.name, **fields)

    def ask(self, do: str, path: str = "", **fields: Any) -> PendingCommand:
        """Send a command; its answers are looked for in the periods that follow."""
        asked = self.asking(do, path, **fields)
        try:
            asked.send()
        except UmoError:  # the queue is full
            return asked
        self.waits.append(asked)
        self._world.over |= {asked.number} if fields.get("over") else set()
        return asked

    def do(self, do: str, path: str = "", **fields: Any) -> Event:
        """Send a command; its end."""
        asked = self.ask(do, path, **fields)
        while asked.end is None:
            self._world.step()
        return asked.end

    def live(self) -> None:
        if not self.is_alive or self.is_frozen:
            return
        self.last_life = self._world.now
        self.session.keep()
        for asked in list(self.waits):
            asked.look()
            if asked.end is not None:
                self.waits.remove(asked)
                self.ends.append(asked.end)

    def check_lease(self, events: list[Event]) -> None:
        """Who lives loses the lease only if somebody takes it, or it is given back."""
        had, self._had_lease = self._had_lease, self.session.has_lease and self.is_alive and not self.is_frozen
        if had and self.is_alive and not self.is_frozen and not self._had_lease:
            ends = [each for each in events if each.asked.startswith((TAKE_LEASE.name, GIVE_BACK.name))]
            assert any(each.state is CommandState.DONE for each in ends), f"{self.name} lost the lease, and lives"


class ClientWorld:
    def __init__(self, m: Cell, reader: Reader, control: ClientControl) -> None:
        self.m, self.reader, self.control = m, reader, control
        self.now = 10**12
        self.clients: dict[str, WorldClient] = {}
        self.ends: Counter[int] = Counter()
        """How often each command has ended, but for the end of what it held."""
        self.done: set[int] = set()
        self.over: set[int] = set()
        """Commands that take the lease over."""
        self._holder = ""
        """Who has the lease, as events tell it, and since when: it may have waited in the queue for some periods."""
        self._taken_at = 0
        self._next_event = 0

    def client(self, name: str) -> WorldClient:
        """A new one."""
        found = self.clients[name] = WorldClient(self, name)
        return found

    def step(self, seconds: float = STEP) -> None:
        for _ in range(round(seconds / STEP)):
            for client in self.clients.values():
                client.live()
            self.now += round(STEP * 1e9)
            periods(self.m)
            self._check()

    def _check(self) -> None:
        events = [each.event for each in self.reader.events(self._next_event)]
        self._next_event = self.reader.now().next_event
        for event in events:
            if event.command and event.state is not CommandState.BEGUN:
                of_held = event.state is CommandState.CANCELLED and event.command in self.done
                self.ends[event.command] += not of_held
            self._follow(event)
        assert all(count == 1 for count in self.ends.values()), "a command has two ends"
        assert max(Counter(self.m.counted).values(), default=0) <= 1, "a command is done twice"
        self._check_life()
        for client in self.clients.values():
            client.check_lease(events)

    def _follow(self, event: Event) -> None:
        """One has the lease at a time, and nobody else commands."""
        if "it was not renewed" in event.text:
            self._holder = ""
        if event.state is not CommandState.DONE or not event.command:
            return
        self.done.add(event.command)
        if event.asked.startswith(TAKE_LEASE.name):
            assert self._holder in ("", event.who) or event.command in self.over, f"{event.who} took another's lease"
            self._holder, self._taken_at = event.who, self.now
        assert event.who == self._holder, f"{event.who} commands, and {self._holder or 'nobody'} has the lease"
        if event.asked == GIVE_BACK.name:
            self._holder = ""

    def _check_life(self) -> None:
        holder = self.control.lease.holder
        if not holder:
            assert not self.control.actions.held, "something is held, and nobody has the lease"
            return
        last = self.clients[holder].last_life
        silent, lasted = (self.now - last) * 1e-9, (self.now - self._taken_at) * 1e-9
        assert min(silent, lasted) <= LEASE_TIME + SLACK, f"{holder} has the lease, and is silent for {silent:g} s"
        if self.control.actions.held:
            assert silent <= DEAD_MAN_TIME + SLACK, f"{holder} holds something, and is silent for {silent:g} s"

    @property
    def valve(self) -> float:
        """What it has, as clients see it."""
        frame: Any = self.reader.latest()
        return float(frame["values"][self.reader.index("valve")])

    @property
    def is_at_rest(self) -> bool:
        """Whether nobody has the lease, nothing runs and nothing is driven."""
        return not self.control.lease.holder and not self.control.actions.any and self.valve == 0.0

    def check_answered(self) -> None:
        """Each command that came to the machine has one end."""
        assert sorted(self.ends) == list(range(1, self.reader.taken + 1))


@contextmanager
def client_world(mode: Mode = Mode.MANUAL) -> Iterator[ClientWorld]:
    m = Cell(timer=timer(), valve=actuator())
    connection = connect(m, wired(m, Scripted()))
    with ExitStack() as undo:
        undo.enter_context(connection)
        ring = undo.enter_context(published(connection, "cell"))
        reader = undo.enter_context(Reader(ring.path))
        assert reader.ends is not None
        cells = ClientMemory(reader.ends.cells, ring.layout)
        undo.callback(cells.close)
        now = lambda: world.now * 1e-9  # noqa: E731
        control = connection.machine.attach(ClientControl(Receiver(cells), cells, mode, now))
        ring.show(control)
        world = ClientWorld(m, reader, control)
        undo.callback(lambda: [each.session.close() for each in world.clients.values()])
        periods(m)
        yield world

"""An operator of a connected machine, in virtual time: commands under a lease, with heartbeats in every period."""

from __future__ import annotations

from typing import Any

from helpers.letters import Letters
from umo import Compound
from umo.cycle.events import CommandState, Event
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.testing import periods

BOOT = 1000.0
"""The clock of the heartbeats when the cycle's clock is 0, s."""


class Operator:
    """A client, on a connected machine."""

    def __init__(self, machine: Compound, mode: Mode = Mode.AUTOMATIC) -> None:
        self.m, self.number, self.lease = machine, 0, 0
        self.letters = Letters()
        self._held: set[str] = set()
        self.machine: Any = machine._machine.whole
        clients = ClientControl(self.letters, self.letters, mode, lambda: BOOT + self.machine.clock.now)
        self.clients = self.machine.attach(clients)
        self.alive = True
        """Whether it sends heartbeats."""

    def sign(self) -> None:
        if self.alive:
            now = BOOT + self.machine.clock.now
            self.letters.signs |= dict.fromkeys(("", *self._held), (self.lease, now))

    def run(self, count: int = 1) -> None:
        """Let periods pass, with heartbeats."""
        for _ in range(count):
            self.sign()
            periods(self.m)

    def send(self, do: str, path: str = "", value: Any = None, **more: Any) -> int:
        """Send a command; its number."""
        self.number += 1
        self._held.add(path)
        self.letters.waiting.append(ClientCommand(self.number, "ann", "key", do, path, value, **more))
        return self.number

    def do(self, do: str, path: str = "", value: Any = None, **more: Any) -> Event:
        """Send a command, and let a period pass: its first event."""
        number = self.send(do, path, value, **more)
        self.run()
        event = self.answer(number)
        if do == "lease" and event.state is CommandState.DONE:
            self.lease = int(event.text)
            self.sign()
        return event

    def call(self, path: str, **arguments: Any) -> Event:
        return self.do("call", path, arguments=arguments)

    def mode(self, mode: str) -> Event:
        return self.do("mode", value=mode)

    def answer(self, number: int) -> Event:
        return next(event for event in self.events if event.command == number)

    @property
    def events(self) -> list[Event]:
        return list(self.machine.events)

    @property
    def notes(self) -> list[str]:
        """What the machine itself has said."""
        return [event.text for event in self.events if not event.command]

    @property
    def driven(self) -> str:
        return str(self.machine.root._machine.facts()["driven"])

"""Commands from outside as data, the two ways in which they arrive (a queue and levels), and the lease, whose holder
may send commands."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Protocol

from umo.cycle.capability import Capability
from umo.errors import CommandRefused, LeaseHeld
from umo.text import NamedNumber

DEAD_MAN_TIME = 0.5
"""The time in s without a heartbeat after which a written actuator goes to its default or a jog ends. It is shorter
if the actuator expires sooner."""
DEAD_MAN_REASON = "dead-man timeout"
"""The reason in the event of such an end."""
NOT_RENEWED = "was not renewed"
"""The last words of the event about the end of a lease whose holder sent no heartbeat."""


class Mode(NamedNumber):
    """The mode of a machine. The numbers are stored in shared memory."""

    AUTOMATIC = 0
    MANUAL = 1


@dataclass(frozen=True)
class ClientCommand:
    """A command of one client. `do` is the name of a verb (`umo.operation.commands.verbs`); it determines which of the
    other fields are used."""

    number: int
    who: str = ""
    key: str = ""
    """The secret by which the lease knows its holder."""
    do: str = ""
    path: str = ""
    value: Any = None
    arguments: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 2.0
    over: bool = False
    refused: str = ""
    """The reason why a gateway of clients has refused the command: an event records the refusal, and the command is not
    carried out."""

    @classmethod
    def parse(cls, number: int, data: bytes) -> ClientCommand:
        """Make a command from a string. Raises ValueError, TypeError or RecursionError if the string is not a
        command."""
        text = json.loads(data)
        for name in ("who", "key", "do", "path", "refused", "arguments"):
            kind = dict if name == "arguments" else str
            if not isinstance(text.get(name, kind()), kind):
                raise TypeError(f"{name} is not a {kind.__name__}")
        seconds = float(text.pop("seconds", 2.0))
        if not isfinite(seconds):  # a lease of NaN seconds would never end
            raise ValueError(f"{seconds} is not a time")
        return cls(number, seconds=seconds, **text)

    def __str__(self) -> str:
        given = {**({"over": True} if self.over else {}), **self.arguments}
        words = [self.do, self.path, *(f"{name}={value}" for name, value in given.items())]
        return " ".join([*filter(None, words), *([] if self.value is None else [str(self.value)])])


class Inbox(Protocol):
    """The incoming commands."""

    taken: int
    """The number of commands that have arrived, whether they were passed on or dropped."""
    dropped: int
    """The number of arrived messages that were not commands."""

    def get(self) -> ClientCommand | None:
        """Return the next command, or None if there is none now. This function is quick and raises no error."""


class Levels(Protocol):
    """The levels that clients set. Reading them is quick, and raises no error."""

    @property
    def asked(self) -> Sequence[int]:
        """The array with one number, which is not 0 if `stop` must be checked. It is always the same array."""

    @property
    def stop(self) -> tuple[int, str] | None:
        """The stop signal that was requested, and the client that requested it, or None if there is no request."""

    def signed(self, path: str, lease: int) -> float:
        """Return the time of the last heartbeat of the holder of this lease for its hold at this path, in s on the
        clock of the clients; "" stands for the lease itself. 0 means never. Any number is possible, because clients
        write it."""


SHORTEST_LEASE, LONGEST_LEASE = 0.2, 60.0
"""Shortest and longest duration of a lease, in s."""


class Lease:
    """The lease. Times are in s on the clock of the holder's heartbeats. The lease ends if there is no heartbeat
    for too long."""

    def __init__(self) -> None:
        self.holder = ""
        """The holder's name, or empty if nobody has it."""
        self.number = 0
        """Number of the lease, counted from 1."""
        self._key = ""
        self._seconds = 0.0
        self.signed = 0.0
        """The time of the holder's last heartbeat."""

    def acquire(self, who: str, key: str, seconds: float, now: float, *, over: bool = False) -> bool:
        """Take the lease. Return True if the lease was taken over from another client. Raises LeaseHeld while another
        client has it, unless `over`."""
        others = bool(self.holder) and key != self._key
        if others and not over:
            raise LeaseHeld(f"{self.holder} has the lease")
        self.number += 1
        self.holder, self._key, self._seconds = who, key, min(max(seconds, SHORTEST_LEASE), LONGEST_LEASE)
        self.signed = now
        return others

    def check(self, key: str) -> None:
        """Check that a client has the lease. Raises CommandRefused if it has not."""
        if not self.holder:
            raise CommandRefused("nobody has the lease; take it first")
        if key != self._key:
            raise LeaseHeld(f"{self.holder} has the lease")

    def renew(self, then: float, now: float) -> None:
        """Note a heartbeat of the holder at a given time. A time in the future does not count."""
        if self.signed < then <= now:
            self.signed = then

    def expired(self, now: float) -> bool:
        return bool(self.holder) and now - self.signed > self._seconds

    def end(self) -> None:
        self.holder = self._key = ""


class Commanding(Capability):
    """The part of a receiver of commands (`umo.operation.commands.client_control`) that frames show."""

    mode: Mode
    lease: Lease
    inbox: Inbox

"""Commands to a station of a fleet. Each command is a query with a unique number and a time until which it is valid.

A query at `umo/SITE/STATION/command/USER` carries JSON: `id` (16 to 64 characters, chosen at random), `sent` and
`until` (UTC, s), `client`, `do`, `path` and the other fields of the command. The first answer is `{"number": n}`: the
number of this command in the machine's events. The last answer is `{"result": ...}` or `{"error": ..., "kind": ...}`.

A command is carried out once. If it arrives again, because the network or somebody else has copied it, the answer is
that of the first one. Numbers are remembered for longer than a command may be valid. A command that was sent before the
gateway began is refused, because it may already have been carried out. A client's holds last while the client sends
heartbeats at `umo/SITE/STATION/sign/USER/CLIENT`.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import zenoh

from umo.clients.faces.face import User
from umo.clients.faces.kept_tasks import KeptTasks
from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.sole_lease import SoleLease
from umo.errors import CommandRefused, UmoError, text_of
from umo.operation.commands.verbs import GIVE_BACK, STOP, TAKE_LEASE

LONGEST_VALID = 30.0
"""Longest time in s that a command may be valid."""
REMEMBERED = 3 * LONGEST_VALID
"""Time in s for which the number of a command is remembered."""
CLOCK_ERROR = 1.0
"""Largest accepted difference of two clocks in s."""
SIGN_TIMEOUT = 1.0
"""Time in s without a heartbeat after which the holds of a client are released."""
MAX_BYTES = 4096
"""Largest length of a command in bytes."""
MAX_REMEMBERED, MAX_REMEMBERED_OF_USER = 20_000, 4_000
"""Largest numbers of remembered commands, of all users and of one user. Further commands are refused, except a stop."""
MAX_WAITING, MAX_WAITING_STOPS = 64, 256
"""Largest numbers of unanswered commands, and of unanswered stops, of a user. Further ones are refused before they are
parsed."""
FORGET_PAUSE = 1.0
"""Time in s between two searches for numbers that need no longer be remembered."""
STOP_QUOTED = json.dumps(STOP.name).encode()
"""The verb `stop` as it appears in a command that has not been parsed yet."""
FIELDS = ("value", "arguments")
"""The fields that a command may have in addition to `do` and `path`."""


@dataclass(frozen=True)
class FleetUsers:
    """The users of a fleet. `is_proved`: True if their names are proved by the certificate of the connection, because
    the rules of the fleet bind the certificate to the name in the key."""

    is_proved: bool = False

    def user(self, name: str, is_alive: Callable[[], bool], *, is_unverified: bool = False) -> User:
        """Return the user of a key. `is_unverified` is True if this user passes on the commands of another person,
        whose name is not proved."""
        return User(name, self.is_proved and not is_unverified, is_alive=is_alive)


@dataclass
class CommandOutcome:
    """The result of a command."""

    at: float
    done: asyncio.Event = field(default_factory=asyncio.Event)
    number: int | None = None
    answer: dict[str, Any] = field(
        default_factory=lambda: {
            "error": "the gateway has ended; it is not known whether the command was carried out",
            "kind": "TaskFailed",
        }
    )


class FleetCommands:
    """Carries out the commands to one station. `gateway`: function that returns the gateway that passes the commands
    on. `utc`: function that returns the time of this computer's clock in s."""

    def __init__(
        self,
        session: zenoh.Session,
        key: StationKey,
        users: FleetUsers,
        gateway: Callable[[], SoleLease],
        utc: Callable[[], float] = time.time,
    ) -> None:
        self._users, self._gateway, self._utc = users, gateway, utc
        self._loop = asyncio.get_running_loop()
        self._began = utc()
        self._told: dict[tuple[str, str], CommandOutcome] = {}
        self._signs: dict[tuple[str, str], float] = {}
        self._counts: Counter[str] = Counter()
        """Number of remembered commands of each user."""
        self._waiting: Counter[str] = Counter()
        """Number of commands of each user that have arrived and are not answered yet. The thread of Zenoh and the
        thread of the loop change it."""
        self._lock = threading.Lock()
        self._forgot = 0.0
        self._tasks = KeptTasks()
        self._queries = session.declare_queryable(key.key(keys.COMMAND, keys.ANY), self._asked)
        self._signed = session.declare_subscriber(key.key(keys.SIGN, keys.ANY, keys.ANY), self._sign)

    # Threads of Zenoh ----------------------------------------------------------------------------------------

    def _asked(self, query: zenoh.Query) -> None:
        name = _name_in(query)
        # `in`: a flood is refused before it is parsed; what only looks like a stop is refused later
        most = MAX_WAITING_STOPS if query.payload is not None and STOP_QUOTED in bytes(query.payload) else MAX_WAITING
        with self._lock:
            if is_room := self._waiting[name] < most:
                self._waiting[name] += 1
        if not is_room:
            _reply(query, {"error": "too many commands at once", "kind": "CommandRefused"})
            query.drop()
            return
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._begin, query)

    def _sign(self, sample: zenoh.Sample) -> None:
        *_, user, client = str(sample.key_expr).split("/")
        if (user, client) in self._signs:  # others hold nothing
            self._signs[user, client] = time.monotonic()

    # Commands ------------------------------------------------------------------------------------------------

    def _begin(self, query: zenoh.Query) -> None:
        self._tasks.begin(self._answer(query))

    async def _answer(self, query: zenoh.Query) -> None:
        name, reply = _name_in(query), partial(_reply, query)
        try:
            command = self._parsed(name, query)
            await self._once(name, command, reply)
        except Exception as error:
            reply({"error": text_of(error), "kind": type(error).__name__})
        finally:
            query.drop()
            with self._lock:
                self._waiting[name] -= 1
                if not self._waiting[name]:
                    del self._waiting[name]

    def _parsed(self, name: str, query: zenoh.Query) -> dict[str, Any]:
        if keys.ANY in name or query.payload is None:
            raise CommandRefused("a command needs the name of its user in its key, and a content")
        data = bytes(query.payload)
        if len(data) > MAX_BYTES:
            raise CommandRefused(f"a command of {len(data)} bytes is too long; at most {MAX_BYTES} are allowed")
        try:
            command = json.loads(data)
            texts = [command[key] for key in ("id", "client", "do")] + [command.get("path", "")]
            sent, until = float(command["sent"]), float(command["until"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise CommandRefused("this is not a command of a fleet") from None
        if not all(isinstance(each, str) for each in texts) or not 16 <= len(texts[0]) <= 64:
            raise CommandRefused("this is not a command of a fleet")
        self._check_times(sent, until)
        return dict(command)

    def _check_times(self, sent: float, until: float) -> None:
        now = self._utc()
        if not now <= until + CLOCK_ERROR:
            raise CommandRefused(f"the command came {now - until:.1f} s too late: compare the clocks of the computers")
        if not (sent <= now + CLOCK_ERROR and until - sent <= LONGEST_VALID):
            raise CommandRefused("the command was sent in the future, or is valid for too long: compare the clocks")
        if sent < self._began - CLOCK_ERROR:
            raise CommandRefused(
                "the command was sent before the gateway started: it may already have been carried out"
            )

    async def _once(self, name: str, command: dict[str, Any], reply: Callable[[dict[str, Any]], object]) -> None:
        """Carry out a command, and send its answers. If the command has arrived before, only send the answers again."""
        self._forget()
        this = name, command["id"]
        told = self._told.get(this)
        if told is not None:
            if told.number is not None:
                reply({"number": told.number})
            await told.done.wait()
            reply(told.answer)
            return
        told = CommandOutcome(time.monotonic())
        if len(self._told) < MAX_REMEMBERED and self._counts[name] < MAX_REMEMBERED_OF_USER:
            self._told[this] = told
            self._counts[name] += 1
        elif command["do"] != STOP.name:
            raise CommandRefused("too many commands in a short time")

        def sent(number: int) -> None:
            told.number = number
            reply({"number": number})

        try:
            told.answer = {"result": await self._carry_out(name, command, sent)}
        except UmoError as error:
            told.answer = {"error": str(error), "kind": type(error).__name__}
        finally:
            told.done.set()
        reply(told.answer)

    async def _carry_out(self, name: str, command: dict[str, Any], sent: Callable[[int], object]) -> Any:
        client, do, gateway = command["client"], command["do"], self._gateway()
        self._signs[name, client] = time.monotonic()
        is_unverified = bool(command.get("unverified"))
        user = self._users.user(name, lambda: self._is_signed(name, client), is_unverified=is_unverified)
        if do == TAKE_LEASE.name:
            return await gateway.take_lease(user, over=command.get("over") is True)
        if do == GIVE_BACK.name:
            return gateway.give_back(user)
        more = {key: command[key] for key in FIELDS if key in command}
        return await gateway.ask(user, do, command.get("path", ""), sent=sent, **more)

    def _is_signed(self, name: str, client: str) -> bool:
        return time.monotonic() - self._signs.get((name, client), float("-inf")) < SIGN_TIMEOUT

    def _forget(self) -> None:
        now = time.monotonic()
        if now - self._forgot < FORGET_PAUSE:
            return
        self._forgot, old = now, now - REMEMBERED
        self._told = {each: told for each, told in self._told.items() if told.at >= old or not told.done.is_set()}
        self._counts = Counter(name for name, _ in self._told)
        self._signs = {each: at for each, at in list(self._signs.items()) if at > old}

    async def close(self) -> None:
        self._queries.undeclare()
        self._signed.undeclare()
        await self._tasks.end()


def _name_in(query: zenoh.Query) -> str:
    """Return the name of the user in the key of a command."""
    return str(query.key_expr).rpartition("/")[2]


def _reply(query: zenoh.Query, answer: dict[str, Any]) -> None:
    with suppress(zenoh.ZError):  # the client has gone
        query.reply(query.key_expr, json.dumps(answer))

"""Takes the commands of this process to a station of a fleet from the cells of the station's mirror, and passes them
on."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey, segment
from umo.clients.remote.who import is_unverified
from umo.cycle.events import CommandState, Event
from umo.errors import CommandRefused
from umo.operation.commands.client_commands import DEAD_MAN_TIME, ClientCommand, Lease
from umo.operation.commands.verbs import CALL, GIVE_BACK, LET_GO, STOP, TAKE_LEASE, WRITE
from umo.process.frames.command_queue import Receiver
from umo.process.frames.layout import Live
from umo.process.frames.ring_copy import RingCopy
from umo.system.processes import user_name

VALID = 5.0
"""Time in s for which a command is valid."""
LONGEST_WAIT = 86_400.0
"""Time in s to wait for the end of an action."""
EVENT_WAIT = 0.2
"""Longest time in s from the machine's answer to the machine's event."""
SIGN_PAUSE = 0.1
"""Time in s from one heartbeat to the next."""


class MirrorCommands:
    """Passes on commands. `tell` adds an event to the ring."""

    def __init__(
        self, session: zenoh.Session, key: StationKey, user: str, ring: RingCopy, tell: Callable[[Event], None]
    ) -> None:
        self._session, self._key, self._ring, self._tell = session, key, ring, tell
        self._user, self._client = user or segment(user_name()), secrets.token_hex(8)
        self._inbox = Receiver(ring.cells)
        self._lock = threading.Lock()
        self._numbers: dict[int, int] = {}
        """The number on this computer of each command, by the number that the station has given to it. An entry remains
        until the last answer is reported."""
        self._coming: list[tuple[int, int]] = []
        """The numbers, at the station and on this computer, of the commands that no frame has shown as taken yet."""
        self._taken = 0
        self._answers: list[tuple[float, ClientCommand, dict[str, Any]]] = []
        """Last answers of commands. Each becomes an event at its time, unless an event of the machine has reported the
        end of the command by then."""
        self._ended: set[int] = set()
        """The commands whose end an event of the machine has reported."""
        self._lease = Lease()
        """The lease of the client of this mirror that commands the station. Its number is that of the lease at the
        station."""
        self._held: set[str] = set()
        self._signed = 0.0
        self._is_stopped = False

    def local(self, number: int) -> int:
        """Return the number that a command of the station has on this computer, or 0 if the command is not from this
        computer."""
        with self._lock:
            return self._numbers.get(number, 0) if number else 0

    def taken(self, count: int) -> int:
        """Return the largest number n on this computer such that all commands up to n are among the first `count`
        commands of the station."""
        with self._lock:
            taken = [here for there, here in self._coming if there <= count]
            self._coming = [each for each in self._coming if each[0] > count]
            self._taken = max([self._taken, *taken])
            return min([self._taken, *(here - 1 for _, here in self._coming)])

    def look(self) -> None:
        """Pass on new commands to the station, and new answers to the cells."""
        while (command := self._inbox.get()) is not None:
            self._pass_on(command)
        self._ring.live({Live.TAKEN: self._inbox.taken, Live.DROPPED: self._inbox.dropped})
        if not self._is_stopped and (stop := self._ring.cells.stop) is not None:
            self._is_stopped = True
            self._send(ClientCommand(0, stop[1], do=STOP.name))
        now = time.monotonic()
        with self._lock:
            due = [each for each in self._answers if each[0] <= now]
            self._answers = [each for each in self._answers if each[0] > now]
        for _, command, answer in due:
            self._answer(command, answer)
        if now - self._signed > SIGN_PAUSE:
            self._signed = now
            self._sign(now)

    def _pass_on(self, command: ClientCommand) -> None:
        try:
            if command.do != TAKE_LEASE.name or (self._lease.holder and not command.over):
                self._lease.check(command.key)
        except CommandRefused as error:
            self._answer(command, {"error": str(error), "kind": type(error).__name__})
        else:
            self._send(command)

    def _send(self, command: ClientCommand) -> None:
        now = time.time()
        asked = {
            "id": secrets.token_hex(16), "client": self._client, "sent": now, "until": now + VALID,
            "do": command.do, "path": command.path,
        }  # fmt: skip
        if command.value is not None:
            asked["value"] = command.value
        if command.arguments:
            asked["arguments"] = dict(command.arguments)
        if command.over:
            asked["over"] = True
        if is_unverified(command.who):  # a visitor of a page: not the user of this computer's certificate
            asked["unverified"] = True
        wait = [0.0, 0]  # for its event; whether the last answer has come

        def reply(reply: zenoh.Reply) -> None:
            if reply.ok is None or wait[1]:  # what comes after the last answer is a copy, or was overtaken
                return
            answer = json.loads(bytes(reply.ok.payload))
            with self._lock:
                if "number" in answer:
                    if command.number:
                        self._numbers[answer["number"]] = command.number
                        self._coming.append((answer["number"], command.number))
                    wait[0] = EVENT_WAIT
                else:
                    wait[1] = 1
                    self._answers.append((time.monotonic() + wait[0], command, answer))

        def done() -> None:
            if not wait[1]:
                lost = {"error": "no answer: it is not known whether the command was carried out", "kind": "TaskFailed"}
                with self._lock:
                    self._answers.append((0.0, command, lost))

        self._session.get(
            self._key.key(keys.COMMAND, self._user),
            zenoh.handlers.Callback(reply, done),
            payload=json.dumps(asked),
            timeout=LONGEST_WAIT if command.do == CALL.name else 2 * VALID,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _answer(self, command: ClientCommand, answer: dict[str, Any]) -> None:
        """Process the last answer of a command. It is reported as an event if no event of the machine reports it."""
        failed = "error" in answer
        if command.do == TAKE_LEASE.name and not failed:
            self._lease.acquire(command.who, command.key, command.seconds, time.monotonic(), over=True)
            self._lease.number = int(answer["result"])
            self._ring.lease(self._lease.number, command.who.encode())
        if command.do == GIVE_BACK.name and not failed:
            self._lease.end()
        if command.do in (WRITE.name, CALL.name):
            (self._held.discard if failed or command.do == CALL.name else self._held.add)(command.path)
        if not command.number or self._forget(command.number):
            return
        text = f"{answer['kind']}: {answer['error']}" if failed else _json(answer.get("result"))
        state = CommandState.REFUSED if failed else CommandState.DONE
        self._tell(Event(0.0, command.path, text, command.who, command.number, state, str(command)))

    def _forget(self, number: int) -> bool:
        """Forget a command, because no more answers to it will arrive. Return True if an event of the machine has
        reported its end."""
        told = number in self._ended
        self._ended.discard(number)
        with self._lock:
            self._numbers = {there: here for there, here in self._numbers.items() if here != number}
        return told

    def has_ended(self, number: int) -> None:
        """Record that an event of the machine has reported the end of this command."""
        self._ended.add(number)

    def _sign(self, now: float) -> None:
        """Pass on the heartbeats, and release the actuators that a client on this computer no longer holds."""
        cells, lease = self._ring.cells, self._lease
        lease.renew(signed := cells.signed("", lease.number), now)
        if lease.expired(now):
            lease.end()
        if not lease.holder or now - signed > DEAD_MAN_TIME:
            return
        with suppress(zenoh.ZError):
            self._session.put(self._key.key(keys.SIGN, self._user, self._client), b"")
        for path in [each for each in self._held if now - cells.signed(each, lease.number) > DEAD_MAN_TIME]:
            self._held.discard(path)
            self._send(ClientCommand(0, lease.holder, do=LET_GO.name, path=path))


def _json(result: Any) -> str:
    return "" if result is None else json.dumps(result)

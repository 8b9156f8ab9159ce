"""One client of a running machine: its requests, its lease, and what it holds under the lease.

This module neither waits for the machine nor starts a thread. The owner of a session reads the answers
(`PendingCommand`), and calls `keep` as long as the client is alive. The owner is a thread
(`umo.clients.remote.commander`), or the loop of a page, of a face or of a fleet's gateway."""

from __future__ import annotations

import asyncio
import json
import secrets
import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import Any

from umo.clients.remote.suggestions import with_nearest
from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError, RangeError, StateError, TaskFailed, UmoError
from umo.operation.commands.client_commands import DEAD_MAN_TIME
from umo.operation.commands.verbs import GIVE_BACK, LET_GO, TAKE_LEASE, VERBS
from umo.process.frames import Reader, RunReader
from umo.process.frames.client_memory import LEASE, ClientMemory
from umo.process.frames.command_queue import Sender

LEASE_TIME = 2.0
"""Time in s for which a lease lasts without a heartbeat."""
ANSWER_TIMEOUT = 5.0
"""Time in s within which the machine must accept a command; five periods if they are longer."""
HEARTBEATS = 5
"""Number of heartbeats that a client sends within the dead-man time of a hold."""
CHANGE_NOTHING = RangeError, StateError
"""Errors of a refused command after which an earlier hold continues."""


@dataclass
class Hold:
    """One hold of a client: a written actuator or a jog."""

    who: str
    lasts: float
    """Time in s without a heartbeat after which the machine ends the hold."""
    next: int
    """Number of the next event that may report the end of the hold."""
    is_alive: Callable[[], bool]
    command: int = 0
    """Number of the command that began the hold, or 0 if the command is not sent yet."""
    why: str = ""
    """The reason why the hold has ended, as the machine reports it; "" while the hold lasts."""


class ClientSession:
    """A client of the run that `reader` reads. The session closes the reader at its end. `wake` is called when a hold
    begins, because `pause` may then be shorter. `clock` is CLOCK_MONOTONIC in ns. One thread gives commands; a
    different one may call `keep`."""

    def __init__(
        self, reader: Reader, wake: Callable[[], object] = lambda: None, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.reader = reader
        self.lease = 0
        """The number of the lease that the client has taken, or 0 if it has taken none."""
        self.held: dict[str, Hold] = {}
        """The holds, by path."""
        self._seconds, self._wake, self.clock = LEASE_TIME, wake, clock
        self._key = secrets.token_hex(8)
        self._cells: ClientMemory | None = None
        """The machine's cells; None before the first command."""
        self._sender: Sender | None = None
        self._dead_man = {str(each["path"]) for each in reader.layout.actions if each.get("dead_man")}
        self._expires = {each.path: each.expires for each in reader.layout.described.objects if each.is_actuator}

    @property
    def running(self) -> bool:
        return self.reader.state is not Stage.ENDED

    @property
    def has_lease(self) -> bool:
        """True while the client's lease lasts: neither the lease nor the run has ended, and no other client has taken
        it over."""
        if not self.running:
            return False
        now = self.reader.now()
        return now.lease == self.lease and bool(now.holder)

    # Commands ------------------------------------------------------------------------------------------

    def asking(
        self, do: str, path: str = "", *, who: str, is_alive: Callable[[], bool] = lambda: True, **fields: Any
    ) -> PendingCommand:
        """Return a command to send. The holds that the command begins exist from now on, as long as `is_alive` returns
        True. The holds that it ends no longer exist."""
        if do in VERBS and VERBS[do].ends:
            self.held.pop(path, None)
        start, before, lasts = self.reader.now().next_event, self.held.get(path), self.lasts(do, path)
        hold = None if lasts is None else Hold(who, lasts, start, is_alive)
        if self.has_lease:
            self.sign(LEASE)
            if hold is not None:
                self.sign(path)
                self.held[path] = hold
                self._wake()
        self._seconds = fields.get("seconds", self._seconds)
        key = secrets.token_hex(8) if fields.get("over") is True else self._key  # a take-over ends what it did, too
        command = {"do": do, "path": path, "key": key, "who": who, **fields}
        return PendingCommand(self, command, hold, before)

    def stop(self, who: str) -> None:
        """Ask the run to end safely. The request is a level in shared memory, which no queue delays. It needs no
        lease."""
        self._open_cells().ask_to_stop(signal.SIGTERM, who)

    def lasts(self, do: str, path: str) -> float | None:
        """Return the time in s for which the effect of a command lasts without a heartbeat, or None if the effect
        needs none."""
        verb = VERBS.get(do)
        if verb is None or not (verb.is_kept_up or (verb.of_action and path in self._dead_man)):
            return None
        return min(DEAD_MAN_TIME, self._expires.get(path) or DEAD_MAN_TIME)

    def _send(self, command: dict[str, Any]) -> int:
        """Send a command, and return its number. Raises CommandRefused if the queue is full, and FramesError if the run
        has ended."""
        cells = self._open_cells()
        if self._sender is None:
            self._sender = Sender(self.reader, cells)
        return self._sender.send(command)

    def _open_cells(self) -> ClientMemory:
        """Return the machine's cells. Raises FramesError if the station has ended or takes no commands."""
        reader = self.reader
        if not self.running:
            raise FramesError(f"{reader.about['station']} has ended")
        if self._cells is None:
            if reader.now().mode is None or reader.ends is None:
                raise FramesError(f"{reader.about['station']}: it takes no commands")
            self._cells = ClientMemory(reader.ends.cells, reader.layout)
        return self._cells

    # Life ----------------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Send heartbeats for the lease, and for the holds of living clients. Call this at least once in `pause`."""
        if self.has_lease:
            held = list(self.held.items())
            self.sign(LEASE, *(path for path, hold in held if not self.ended(path) and hold.is_alive()))

    @property
    def pause(self) -> float:
        """Longest time in s from one call of `keep` to the next."""
        return min([DEAD_MAN_TIME, self._seconds, *(hold.lasts for hold in list(self.held.values()))]) / HEARTBEATS

    def sign(self, *paths: str) -> None:
        """Send a heartbeat for the holds at these paths ("" for the lease). A run that has just ended does not need
        it."""
        with suppress(FramesError):
            cells, now = self._open_cells(), self.clock()
            for path in paths:
                cells.sign(path, self.lease, now)

    def ended(self, path: str) -> str:
        """Return the reason why the hold on this path has ended by itself, as the machine reports it; "" if the hold
        lasts or does not exist."""
        hold = self.held.get(path)
        if hold is None:
            return ""
        events = self.reader.events(hold.next)
        ends = (each.event for each in events)
        told = (each.text for each in ends if has_ended(each, path, self.reader, hold.command))
        hold.why = hold.why or next(told, "")
        if events:
            hold.next = events[-1].number + 1
        return hold.why

    def close(self) -> None:
        if self._sender is not None:
            self._sender.close()
            self._sender = None
        if self._cells is not None:
            self._cells.close()
            self._cells = None
        self.reader.close()


class LoopSession(ClientSession):
    """A client session in an event loop."""

    def __init__(self, reader: Reader) -> None:
        self._woken = asyncio.Event()
        super().__init__(reader, self._woken.set)

    async def pass_pause(self) -> None:
        """Wait until the next heartbeat is due, or a hold begins."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self.pause):
                await self._woken.wait()
        self._woken.clear()


class PendingCommand:
    """A command of a session. It is sent, and receives answers. The last answer is the command's end."""

    def __init__(self, session: ClientSession, command: dict[str, Any], hold: Hold | None, before: Hold | None) -> None:
        self.number = 0
        """The number of the command in the machine's events, or 0 if the command is not sent yet."""
        self.begun = False
        """True if an action has begun and not yet ended."""
        self.end: Event | None = None
        self.do, self.path, self.who = command["do"], command["path"], command["who"]
        self._session, self._command, self._hold, self._before = session, command, hold, before
        self._next = session.reader.now().next_event
        self._limit = max(ANSWER_TIMEOUT, 5 * session.reader.about["period"])
        self._sent = 0
        """Time at which the command was sent, in ns."""

    def send(self) -> None:
        """Send the command. Raises CommandRefused if the queue stays full for a second, or if the command is malformed.
        Raises FramesError if the run has ended."""
        try:
            self.number = self._session._send(self._command)
        except BaseException:
            self.forget(before=True)
            raise
        self._sent = self._session.clock()
        if self._hold is not None:
            self._hold.command = self.number

    def look(self) -> list[Event]:
        """Return new answers. Raises CommandRefused if no answer has arrived in time, and FramesError if none can
        arrive any more, or if events were overwritten before they were read, and the answer may be among them."""
        reader = self._session.reader
        ended = reader.state is Stage.ENDED  # before the events: the last of them may be the answer
        events, lost = reader.events(self._next), False
        if events:
            lost = events[-1].number + 1 - self._next > len(events)
            self._next = events[-1].number + 1
        found = [with_nearest(each.event, reader.layout) for each in events if each.event.command == self.number]
        self.begun = self.begun or bool(found)
        end = next((each for each in found if each.state is not CommandState.BEGUN), None)
        if end is not None and self.end is None:
            self.end = end
            self._has_ended(end)
        if self.end is None and not found and lost:
            raise FramesError(
                "the machine's answer may have been overwritten before it was read; it is not known whether the "
                "command was carried out"
            )
        if self.end is None and not found and ended:
            raise FramesError(f"{reader.about['station']} ended before the machine answered")
        if not self.begun and self._session.clock() - self._sent > self._limit * 1e9:
            raise CommandRefused(f"the machine has not answered within {self._limit:g} s")
        return found

    async def follow(
        self, looked: Callable[[], Awaitable[float]], is_over: Callable[[list[Event], float], Awaitable[bool]]
    ) -> None:
        """Pass new answers to `is_over` at each look at the frames, until `is_over` returns True. `looked` waits for
        the next look. Its result is passed together with the answers; minus infinity is passed with the first ones."""
        seen = -inf
        while not await is_over(self.look(), seen):
            seen = await looked()

    def outcome(self) -> Any:
        """Return the result of the command. Raises the machine's error if the command was refused or has failed."""
        assert self.end is not None
        if self.end.state is not CommandState.DONE:
            raise error_of(self.end)
        return json.loads(self.end.text) if self.end.text else None

    def _has_ended(self, end: Event) -> None:
        session = self._session
        if end.state is not CommandState.DONE:
            self.forget(before=isinstance(error_of(end), CHANGE_NOTHING))
        elif self.do == TAKE_LEASE.name:
            session.lease, session._key = int(end.text), self._command["key"]
            session.sign(LEASE)
        elif self.do == GIVE_BACK.name:
            session.lease = 0

    def forget(self, before: bool = False) -> None:
        """Forget a new hold; `before`: the earlier hold on its path."""
        held, path = self._session.held, self.path
        if self._hold is None or held.get(path) is not self._hold:
            return
        if before and self._before is not None:
            held[path] = self._before
        else:
            del held[path]


def has_ended(event: Event, path: str, reader: RunReader, command: int = 0) -> bool:
    """True if an event reports that the hold of a command at this path has ended. A hold ends with its command, by
    itself, or together with those of other actuators for one reason. An event for several actuators names only the
    first one in its text, and the hold of an actuator that a client still holds has not ended. The end of an action
    always has a separate event."""
    if event.state is not CommandState.CANCELLED:
        return False
    if event.command:
        return event.command == command
    if event.asked != LET_GO.name:
        return event.path == path
    return path in reader.paths and is_beside(path, event.path) and not reader.is_taken(path)


def is_beside(path: str, around: str) -> bool:
    """True if a path is below another; every path is below ""."""
    return not around or path.startswith(f"{around}.")


def error_of(event: Event) -> Exception:
    """Return the machine's error. It has the original type if that is a type of umo."""
    if event.state is CommandState.CANCELLED:
        return TaskFailed(f"{event.path or event.asked} was cancelled: {event.text}")
    name, _, text = event.text.partition(": ")
    kind = {each.__name__: each for each in _kinds(UmoError)}.get(name)
    if kind is None:
        return TaskFailed(event.text)
    error = kind.__new__(kind)  # without its constructor, which makes the message of other things
    error.args = (text,)
    return error


def _kinds(base: type[UmoError]) -> Iterator[type[UmoError]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _kinds(kind)

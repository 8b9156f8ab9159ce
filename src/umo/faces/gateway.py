"""The commands of the users of one face to one run, under one lease that the face takes when it needs it."""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import Any

from umo.clients.client_commands import DEAD_MAN_TIME
from umo.cycle.events import CommandState, Event
from umo.errors import CommandRefused, FramesError, RangeError, StateError, UmoError
from umo.faces.command_users import RefusalLimit, lives, named
from umo.faces.face import User
from umo.frames import Reader
from umo.frames.client_memory import LEASE
from umo.remote.commander import SIGNS_OF_LIFE, Answers, Commander, error_of, has_ended
from umo.system.roles import Caller, Roles

LEASE_TIME = 2.0
"""Duration of the lease in s without a sign of life from the face."""
LINGER = 5.0
"""Time in s from the last command, when nothing runs and nothing is held, until the lease is given back."""
MAX_COMMANDS, MAX_OF_USER = 64, 16
"""Commands of a face, and of one of its users, whose end is still to come, at most."""
ENDING = ("cancel", "let go")
"""Commands that end something: of them twice as many."""
OWN = ("lease", "give back")
"""Commands that the gateway gives by itself."""
MAX_PATH = 96
"""Characters of the path of a refused command that are told at most."""
SENDER = ThreadPoolExecutor(1, "umo face")
"""One thread: commands are sent in the order in which they were asked for."""
Looked = Callable[[], Awaitable[float]]
"""Waits for the next look; returns the time of the last frame of which the face has been told, in s on the cycle's
clock; infinity when the run is over."""


@dataclass
class Hold:
    """What a user's client keeps up: a written actuator, a jog."""

    user: User
    next: int
    """Number of the next event that may tell its end."""
    command: int = 0


class Gateway:
    """`is_reader`: the face only reads. `roles`: the roles of users as they are now."""

    def __init__(
        self,
        reader: Reader,
        face: str,
        looked: Looked,
        *,
        is_reader: bool = False,
        roles: Callable[[], Roles] = Roles.load,
    ) -> None:
        self._reader = reader.again()
        self._station = Commander(self._reader)
        self._face, self._looked, self._is_reader, self._roles = face, looked, is_reader, roles
        self._known: Roles | None = None
        """The roles of this turn of the loop."""
        self._dead_man = {str(each["path"]) for each in reader.layout.actions if each.get("dead_man")}
        self._key = secrets.token_hex(8)
        self._lease = 0
        """The number of the lease that it took; 0: none."""
        self._taking = asyncio.Lock()
        self._held: dict[str, Hold] = {}
        """What is held, by path."""
        self._pending: dict[object, tuple[User, str]] = {}
        """Commands whose end is still to come: user and path."""
        self._refusals = RefusalLimit()
        self._last = 0.0
        self._is_closed = False
        self._keeping = asyncio.create_task(self._keep())

    # Commands ------------------------------------------------------------------------------------------

    async def ask(
        self, user: User, do: str, path: str = "", *, sent: Callable[[int], object] = lambda number: None, **more: Any
    ) -> Any:
        """Carry out a command; its result when it has ended (`umo.faces.face.Commands`). `sent` is told the number that
        its events have."""
        who = named(user, self._face)
        if (refusal := self._refusal(user, do, path)) is not None:
            self._tell_refusal(who, do, path, refusal)
            raise CommandRefused(refusal)
        if do == "stop":
            self._station.stop(who)
            return None
        this = object()
        self._pending[this] = user, path
        try:
            await self._take_lease(who)
            return await self._carry_out(user, do, path, who, more, sent)
        finally:
            del self._pending[this]
            self._last = time.monotonic()

    def may(self, user: User, do: str, path: str = "") -> bool:
        """Whether such a command is passed on (`umo.faces.face.Commands`)."""
        return self._refusal(user, do, path) is None

    def _refusal(self, user: User, do: str, path: str) -> str | None:
        """Why a command is not passed on; None: it is."""
        if self._is_closed:
            return "the run has ended"
        if self._is_reader:
            return f"{self._face} only reads here: it was started without --commands"
        if not user.name.strip():
            return "a command needs the name of its user"
        if do in OWN:
            return f"{do}: the lease is taken for each command"
        if not user.is_owner:
            refusal = self._roles_now().refusal(Caller(self._face, user.name, user.proved), do)
            if refusal is not None:
                return refusal
        if do == "stop":  # no flood of commands keeps anybody from it
            return None
        if self._is_kept_up(do, path) and user.is_alive is None:
            return f"{path} is kept up only while its client lives, and {self._face} does not tell that"
        room = 2 if do in ENDING else 1
        if len(self._pending) >= room * MAX_COMMANDS or self._count_of(user) >= room * MAX_OF_USER:
            return "too many commands at once"
        return None

    def _roles_now(self) -> Roles:
        """The roles as the file has them. It is read once in a turn of the loop: a request may ask for the rights to
        thousands of things."""
        if self._known is None:
            self._known = self._roles()
            asyncio.get_running_loop().call_soon(self._forget_roles)
        return self._known

    def _forget_roles(self) -> None:
        self._known = None

    def _is_kept_up(self, do: str, path: str) -> bool:
        return do == "write" or (do == "call" and path in self._dead_man)

    def _count_of(self, user: User) -> int:
        return sum(each.name == user.name for each, _ in self._pending.values())

    def _tell_refusal(self, who: str, do: str, path: str, why: str) -> None:
        """As an event of the machine. A face that only reads touches no machine."""
        if not (self._is_reader or self._is_closed) and self._refusals.is_told(who, time.monotonic()):
            self._send_on(do, path=path[:MAX_PATH], who=who, refused=why)

    async def _carry_out(
        self, user: User, do: str, path: str, who: str, more: Mapping[str, Any], sent: Callable[[int], object]
    ) -> Any:
        if not lives(user):
            raise CommandRefused("its client has gone")
        start = self._reader.next_event
        before, hold = self._held.get(path), Hold(user, start)
        if self._is_kept_up(do, path):
            self._held[path] = hold
            self._sign(path)
        event = None
        try:
            hold.command = await self._send(do, path=path, who=who, **more)
            sent(hold.command)
            event = await self._end_of(Answers(self._reader, hold.command, start), user, path)
        finally:
            if (event is None or event.state is not CommandState.DONE) and self._held.get(path) is hold:
                del self._held[path]
        if event.state is not CommandState.DONE:
            error = error_of(event)
            if before is not None and isinstance(error, RangeError | StateError):
                self._held.setdefault(path, before)  # a wrong value ends nothing
            raise error
        if do == "let go":
            self._held.pop(path, None)
        return json.loads(event.text) if event.text else None

    async def _end_of(self, answers: Answers, user: User, path: str) -> Event:
        """The last answer, after the face has been told of the period in which it was given: a client that reads next
        sees what its command has done. An action whose client has gone is cancelled."""
        cancelled, seen, event = False, -inf, None
        while True:
            event = event or self._answer_of(answers)
            if event is not None and event.time <= seen:
                return event
            if seen == inf:
                raise FramesError("the run has ended before it answered")
            if event is None and answers.begun and not cancelled and not lives(user):
                cancelled = True
                await self._send("cancel", path=path, who=named(user, self._face))
            seen = await self._looked()

    def _answer_of(self, answers: Answers) -> Event | None:
        """The last answer, if it has come. FramesError if the face has ended meanwhile."""
        if self._is_closed:
            raise FramesError("the run has ended before it answered")
        return answers.end()

    def _send(self, do: str, **more: Any) -> asyncio.Future[int]:
        """In a thread: the queue may be full, or it is another client's turn."""

        def send() -> int:
            if self._is_closed and do != "give back":
                raise FramesError("the run has ended")
            try:
                return self._station.send(do, key=self._key, **more)
            except (TypeError, ValueError):  # of json
                raise StateError(f"{more.get('path') or do}: a value of this type is no command's") from None

        return asyncio.get_running_loop().run_in_executor(SENDER, send)

    def _send_on(self, do: str, **more: Any) -> None:
        """Without waiting for it: what is kept up must not wait for a full queue."""
        self._send(do, **more).add_done_callback(lambda sent: sent.cancelled() or sent.exception())

    # The lease -----------------------------------------------------------------------------------------

    async def _take_lease(self, who: str, *, anew: bool = False, over: bool = False) -> None:
        """LeaseHeld if another client has it, unless it is taken over. `anew`: also if the face has it already."""
        async with self._taking:
            if self._reader.lease_held(self._lease) and not anew:
                return
            self._held.clear()
            start = self._reader.next_event
            asked = await self._send("lease", who=who, seconds=LEASE_TIME, over=over)
            answers = Answers(self._reader, asked, start)
            while (event := self._answer_of(answers)) is None:
                if await self._looked() == inf:
                    raise FramesError("the run has ended before it answered")
            if event.state is not CommandState.DONE:
                raise error_of(event)
            self._lease = int(event.text)
            self._sign(LEASE)

    def _sign(self, *paths: str) -> None:
        with suppress(FramesError):  # the run has just ended
            self._station.sign(self._lease, *paths)

    async def _keep(self) -> None:
        """Give signs of life for the lease, and for what is held of those clients that live; in the end give it
        back."""
        while True:
            if self._reader.lease_held(self._lease):
                await self._look_after()
            await asyncio.sleep(DEAD_MAN_TIME / SIGNS_OF_LIFE)

    async def _look_after(self) -> None:
        for path, hold in list(self._held.items()):
            gone = not lives(hold.user)
            if gone or self._has_ended(hold, path):
                del self._held[path]
            if gone:
                self._send_on("let go", path=path, who=named(hold.user, self._face))
        if self._is_used or time.monotonic() - self._last <= LINGER:
            self._sign(LEASE, *self._held)
            return
        async with self._taking:
            if not self._is_used:  # nobody has come meanwhile
                await self._give_back()

    @property
    def _is_used(self) -> bool:
        return bool(self._held or self._pending)

    def _has_ended(self, hold: Hold, path: str) -> bool:
        """Whether the machine has ended it: by an interlock, a fault, a change of the mode."""
        if events := self._reader.events(hold.next):
            hold.next = events[-1].number + 1
        ends = (each.event for each in events if each.event.state is CommandState.CANCELLED)
        return any(
            each.command == hold.command or (not each.command and has_ended(each, path, self._reader)) for each in ends
        )

    async def _give_back(self) -> None:
        with suppress(UmoError):
            await self._send("give back", who=self._face)
            self._lease = 0

    async def close(self) -> None:
        """The face ends: the lease is given back, and the machine lets go of what was held. From now on it refuses."""
        if self._is_closed:
            return
        self._is_closed = True
        self._keeping.cancel()
        await asyncio.gather(self._keeping, return_exceptions=True)
        if self._reader.lease_held(self._lease):
            await self._give_back()
        self._station.close()

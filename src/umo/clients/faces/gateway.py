"""Passes the commands of one face's users to one run, under a single lease. The face takes the lease when a command
needs it."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from math import inf
from typing import Any

from umo.clients.faces.command_users import RefusalLimit, lives, named
from umo.clients.faces.face import User
from umo.clients.remote.client_session import LEASE_TIME, LoopSession, PendingCommand
from umo.cycle.events import Event
from umo.errors import CommandRefused, FramesError, StateError, UmoError
from umo.operation.commands.roles import Caller, Roles
from umo.operation.commands.verbs import CANCEL, GIVE_BACK, LET_GO, TAKE_LEASE, VERBS
from umo.process.frames import Reader

LINGER = 5.0
"""Time in s from the last command until the lease is given back, if no action runs and nothing is held."""
MAX_COMMANDS, MAX_OF_USER = 64, 16
"""Largest numbers of unfinished commands of a face, and of one of its users. Twice as many are allowed for commands
that end something."""
MAX_PATH = 96
"""Largest number of characters of the path of a refused command in the report."""
SENDER = ThreadPoolExecutor(1, "umo face")
"""The single thread that sends commands, so that they are sent in the order of the requests."""
Looked = Callable[[], Awaitable[float]]
"""Function that waits for the next look. It returns the time of the last frame that the face has received, in s on the
cycle's clock, or infinity when the run is over."""


class Gateway:
    """The gateway of one face to one run. `is_reader`: True if the face only reads. `roles`: function that returns the
    present roles of users."""

    def __init__(
        self,
        reader: Reader,
        face: str,
        looked: Looked,
        *,
        is_reader: bool = False,
        roles: Callable[[], Roles] = Roles.load,
    ) -> None:
        self._session = LoopSession(reader.again())
        self._face, self._looked, self._is_reader, self._roles = face, looked, is_reader, roles
        self._known: Roles | None = None
        """The roles that were read in this turn of the loop; None if they have not been read yet."""
        self._taking = asyncio.Lock()
        self._pending: Counter[str] = Counter()
        """Number of commands of each user whose end is still to come."""
        self._refusals = RefusalLimit()
        self._last = 0.0
        self._is_closed = False
        self._keeping = asyncio.create_task(self._keep())

    # Commands ------------------------------------------------------------------------------------------

    async def ask(
        self, user: User, do: str, path: str = "", *, sent: Callable[[int], object] = lambda number: None, **more: Any
    ) -> Any:
        """Carry out a command, and return its result when it has ended (`umo.clients.faces.face.Commands`). `sent` is
        called with the number that the command's events have."""
        who = named(user, self._face)
        if (refusal := self._refusal(user, do, path)) is not None:
            self._tell_refusal(who, do, path, refusal)
            raise CommandRefused(refusal)
        if _is_level(do):
            self._session.stop(who)
            return None
        self._pending[user.name] += 1
        try:
            await self._take_lease(who)
            if not lives(user):
                raise CommandRefused("its client has disconnected")
            asked = self._session.asking(do, path, who=who, is_alive=partial(lives, user), **more)
            return await self._carry_out(asked, user, sent)
        finally:
            self._pending[user.name] -= 1
            self._pending += Counter()  # without those who wait for nothing
            self._last = time.monotonic()

    def may(self, user: User, do: str, path: str = "") -> bool:
        """True if this command would be passed on (`umo.clients.faces.face.Commands`)."""
        return self._refusal(user, do, path) is None

    def _refusal(self, user: User, do: str, path: str) -> str | None:
        """Return why a command is not passed on, or None if it is."""
        if self._is_closed:
            return "the run has ended"
        if self._is_reader:
            return f"{self._face} can only read: it was started without --commands"
        if not user.name.strip():
            return "a command needs the name of its user"
        verb = VERBS.get(do)
        if verb is not None and verb.is_of_lease:
            return f"{do}: the face takes the lease for each command"
        if not user.is_owner:
            refusal = self._roles_now().refusal(Caller(self._face, user.name, user.proved), do)
            if refusal is not None:
                return refusal
        if _is_level(do):  # no flood of commands keeps anybody from it
            return None
        if user.is_alive is None and self._session.lasts(do, path) is not None:
            return f"{path} is held only while its client sends heartbeats, and {self._face} transmits no heartbeats"
        room = 2 if verb is not None and verb.ends else 1
        if self._pending.total() >= room * MAX_COMMANDS or self._pending[user.name] >= room * MAX_OF_USER:
            return "too many commands at once"
        return None

    def _roles_now(self) -> Roles:
        """Return the roles in the file. The file is read only once in a turn of the loop, because one request can ask
        for the rights to thousands of objects."""
        if self._known is None:
            self._known = self._roles()
            asyncio.get_running_loop().call_soon(self._forget_roles)
        return self._known

    def _forget_roles(self) -> None:
        self._known = None

    def _tell_refusal(self, who: str, do: str, path: str, why: str) -> None:
        """Report a refusal as an event of the machine. A face that only reads does not contact the machine."""
        if not (self._is_reader or self._is_closed) and self._refusals.is_told(who, time.monotonic()):
            self._send_on(do, path[:MAX_PATH], who, refused=why)

    async def _carry_out(
        self, asked: PendingCommand, user: User | None = None, sent: Callable[[int], object] = lambda number: None
    ) -> Any:
        """Send a command, and return its result when it has ended. `user` is None for a command of the face itself."""
        try:
            await self._send(asked)
            sent(asked.number)
            await self._until_told(asked, user)
        finally:
            if asked.end is None:
                asked.forget()
        return asked.outcome()

    async def _until_told(self, asked: PendingCommand, user: User | None) -> None:
        """Wait until a command has ended and the face has been notified of the period of the answer. A client that
        reads after that sees the effect of its command. An action whose client has disconnected is cancelled."""
        is_cancelled = False

        async def looked() -> float:
            seen = await self._looked()
            if self._is_closed:
                raise FramesError("the run ended before the machine answered")
            return seen

        async def is_over(_: list[Event], seen: float) -> bool:
            nonlocal is_cancelled
            if asked.end is not None and (user is None or asked.end.time <= seen):
                return True
            if seen == inf:
                raise FramesError("the run ended before the machine answered")
            if user is not None and asked.begun and asked.end is None and not is_cancelled and not lives(user):
                is_cancelled = True
                await self._send(self._session.asking(CANCEL.name, asked.path, who=asked.who))
            return False

        await asked.follow(looked, is_over)

    def _send(self, asked: PendingCommand) -> asyncio.Future[None]:
        """Send a command in a thread, because the queue can be full, or locked by another client."""

        def send() -> None:
            if self._is_closed and asked.do != GIVE_BACK.name:
                raise FramesError("the run has ended")
            try:
                asked.send()
            except (TypeError, ValueError):  # of json
                raise StateError(f"{asked.path or asked.do}: no command accepts a value of this type") from None

        return asyncio.get_running_loop().run_in_executor(SENDER, send)

    def _send_on(self, do: str, path: str, who: str, **more: Any) -> None:
        """Send a command without waiting for it, because heartbeats must not wait for a full queue."""
        sending = self._send(self._session.asking(do, path, who=who, **more))
        sending.add_done_callback(lambda sent: sent.cancelled() or sent.exception())

    # The lease -----------------------------------------------------------------------------------------

    async def _take_lease(self, who: str, *, anew: bool = False, over: bool = False) -> None:
        """Take the lease. Raises LeaseHeld if another client has the lease, unless `over` is True. With `anew` the
        lease is taken again even if the face already has it."""
        async with self._taking:
            if self._session.has_lease and not anew:
                return
            self._session.held.clear()
            asked = self._session.asking(TAKE_LEASE.name, who=who, seconds=LEASE_TIME, over=over)
            await self._carry_out(asked)

    async def _keep(self) -> None:
        """Send heartbeats for the lease, and for the holds of clients that are alive. Return the lease after it has
        not been used for `LINGER` s."""
        while True:
            if self._session.has_lease:
                await self._look_after()
            await self._session.pass_pause()

    async def _look_after(self) -> None:
        session = self._session
        for path, hold in list(session.held.items()):
            if not hold.is_alive():
                self._send_on(LET_GO.name, path, hold.who)
            elif session.ended(path):
                del session.held[path]
        if self._is_used or time.monotonic() - self._last <= LINGER:
            session.keep()
            return
        async with self._taking:
            if not self._is_used:  # nobody has come meanwhile
                await self._give_back()

    @property
    def _is_used(self) -> bool:
        return bool(self._session.held or self._pending)

    async def _give_back(self) -> None:
        with suppress(UmoError):
            await self._send(self._session.asking(GIVE_BACK.name, who=self._face))
            self._session.lease = 0

    async def close(self) -> None:
        """End the face: the lease is returned, and the machine releases its holds. Further commands are refused."""
        if self._is_closed:
            return
        self._is_closed = True
        self._keeping.cancel()
        await asyncio.gather(self._keeping, return_exceptions=True)
        if self._session.has_lease:
            await self._give_back()
        self._session.close()


def _is_level(do: str) -> bool:
    """True if a command is transmitted as a level in shared memory, which no queue delays."""
    return do in VERBS and VERBS[do].is_level

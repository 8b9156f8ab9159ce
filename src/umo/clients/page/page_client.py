"""The client of an open page: its commands, its lease, and its holds, which last while the page is open.

A page sends heartbeats (touches): it answers each state that it receives with the list of its holds. Without a touch
the holds are released, and later its lease ends. When the page is closed, both happen immediately.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any

from starlette.websockets import WebSocketDisconnect

from umo.clients.page.feed import Feed
from umo.clients.page.visitor import Visitor
from umo.clients.page.watched_run import Watched
from umo.clients.remote.client_session import LEASE_TIME, LoopSession, PendingCommand
from umo.clients.remote.who import UNVERIFIED, who_text
from umo.cycle.events import CommandState, Event
from umo.errors import CommandRefused, FramesError
from umo.operation.commands.roles import PAGE, Caller, Roles
from umo.operation.commands.verbs import GIVE_BACK, STOP, TAKE_LEASE
from umo.process.frames import Reader
from umo.system.processes import user_name

TOUCH_TIME = 0.4
"""Time in s after the last touch until the holds of a page are released."""
MAX_STATES_BEHIND = 4
"""Number of states by which the state that a touch answers may be older than the newest one; there are ten states per
second."""
MAX_COMMANDS = 32
"""Largest number of commands of a page that have not ended yet."""
COMMAND_KEYS = ("path", "value", "arguments", "over")
"""Keys of a page's command that are passed on, in addition to `do`. Other keys are used by this module."""
SENDERS = ThreadPoolExecutor(8, "umo client")
"""Threads that only send commands, so that no client waits for a slow answer to another page."""
Tell = Callable[[dict[str, Any]], Awaitable[None]]


class PageClient:
    """The client of one page of a visitor, for one run. `tell` sends a message to the page. Raises FramesError if the
    run has ended."""

    def __init__(self, watched: Watched, feed: Feed, visitor: Visitor, tell: Tell) -> None:
        self.watched = watched
        self._feed = feed
        self._visitor = visitor
        self._tell = tell
        self._user = ""
        """The last name that the page gave, in the form in which the file of roles contains it."""
        self._roles = Roles.load()
        """The roles, which are read again when the lease is taken."""
        self._who = self._named("")
        if not isinstance(watched.reader, Reader):
            raise FramesError(f"{watched.name}: it takes no commands")
        self._session = LoopSession(watched.reader.again())
        self._holds: set[str] = set()
        """The holds of the page at its last heartbeat."""
        self._touched = 0.0
        self._following: dict[asyncio.Task[None], PendingCommand] = {}
        """Commands that have not ended yet."""
        self._ended = False
        self._keeping = asyncio.create_task(self._keep())

    def _named(self, name: str) -> str:
        if self._visitor.is_owner:
            return who_text(name.strip() or user_name(), f" (page, {self._visitor.address})")
        return who_text(name, f"{UNVERIFIED} (page, {self._visitor.address})")

    # Commands ------------------------------------------------------------------------------------------

    async def carry_out(self, message: dict[str, Any]) -> None:
        """Send a command of the page. The answers are sent to the page when they arrive: `begun` for a long action,
        then the end of the command."""
        try:
            await self._carry_out(message, str(message.get("do")))
        except (CommandRefused, FramesError) as error:
            await self._answer(message, CommandState.REFUSED, str(error))

    async def _carry_out(self, message: dict[str, Any], do: str) -> None:
        more = {name: message[name] for name in COMMAND_KEYS if name in message}
        if do == TAKE_LEASE.name:
            name, self._roles = str(message.get("who", "")), Roles.load()
            self._user, self._who, more["seconds"] = " ".join(name.split()), self._named(name), LEASE_TIME
        caller = Caller(PAGE, self._user, is_owner=self._visitor.is_owner)
        if (refusal := self._roles.refusal(caller, do)) is not None:
            raise CommandRefused(refusal)
        if do == STOP.name:
            self._session.stop(self._who)
            await self._answer(message, CommandState.DONE, "")
            return
        if len(self._following) >= MAX_COMMANDS:
            raise CommandRefused(f"a page may have at most {MAX_COMMANDS} commands in progress")
        if not isinstance(path := more.get("path", ""), str):
            raise CommandRefused(f"{do}: the path must be a string")
        asked = self._session.asking(do, who=self._who, is_alive=partial(self._is_held, path), **more)
        await self._send(asked)
        task = asyncio.create_task(self._follow(message, asked))
        self._following[task] = asked
        task.add_done_callback(self._following.pop)

    async def _send(self, asked: PendingCommand) -> None:
        """Send a command in a thread, because the queue can be full, or locked by another client."""
        await asyncio.get_running_loop().run_in_executor(SENDERS, asked.send)

    async def _follow(self, message: dict[str, Any], asked: PendingCommand) -> None:
        async def is_over(events: list[Event], seen: float) -> bool:
            for event in events:
                more: dict[str, Any] = {"command": event.command}
                if event is asked.end and asked.do == TAKE_LEASE.name and event.state is CommandState.DONE:
                    more["lease"] = self._session.lease
                    self.touch([], self.watched.number)
                await self._answer(message, event.state, "" if "lease" in more else event.text, **more)
            return asked.end is not None

        try:
            await asked.follow(self._feed.looked, is_over)
        except (CommandRefused, FramesError) as error:
            await self._answer(message, CommandState.FAILED, str(error))

    async def _answer(self, message: dict[str, Any], state: CommandState, text: str, **more: Any) -> None:
        about = {"type": "answer", "id": message.get("id"), "state": str(state), "text": text}
        with suppress(WebSocketDisconnect, RuntimeError):  # the page is closed
            await self._tell(about | more)

    # The lease -----------------------------------------------------------------------------------------

    def touch(self, held: list[str], number: int) -> None:
        """Record a heartbeat of the page, with the state that it answers and the page's holds. A touch with an old
        state is ignored, because it shows that the connection is slow."""
        if self.watched.number - number > MAX_STATES_BEHIND:
            return
        self._touched = time.monotonic()
        self._holds = set(held)
        self._session.keep()

    @property
    def _silent(self) -> float:
        """Time in s since the last touch."""
        return time.monotonic() - self._touched

    def _is_held(self, path: str) -> bool:
        """True if the page holds the object at this path, or has just requested that."""
        is_new = any(each.path == path and not each.begun for each in self._following.values())
        return self._silent < TOUCH_TIME and (path in self._holds or is_new)

    async def _keep(self) -> None:
        """Renew the lease, and send heartbeats for the holds of the page, as long as the page sends touches."""
        while not self._ended:
            if self._silent < LEASE_TIME:
                self._session.keep()
            await self._session.pass_pause()

    async def close(self) -> None:
        """Close the page: the lease is returned, and the machine releases its holds."""
        self._ended = True
        for task in list(self._following):
            task.cancel()
        if self._session.has_lease:
            with suppress(CommandRefused, FramesError, OSError):
                await self._send(self._session.asking(GIVE_BACK.name, who=self._who))
        await self._keeping
        self._session.close()

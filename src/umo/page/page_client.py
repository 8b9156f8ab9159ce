"""The client of an open page: its commands, its lease, and what it holds while it is there.

A page shows that it is there by touching: it answers each state that it gets with what it holds. Without a touch, what
it holds is let go of, and later its lease ends. When the page is closed, both happen at once.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, cast

from starlette.websockets import WebSocketDisconnect

from umo.clients.client_commands import DEAD_MAN_TIME
from umo.cycle.events import CommandState
from umo.errors import CommandRefused, FramesError
from umo.frames.client_memory import LEASE
from umo.page.feed import Feed
from umo.page.visitor import Visitor
from umo.page.watched_run import Watched
from umo.remote.commander import SIGNS_OF_LIFE, Answers, Commander
from umo.remote.who import UNVERIFIED, who_text
from umo.system.processes import user_name
from umo.system.roles import PAGE, Caller, Roles

LEASE_TIME = 2.0
"""s for which the machine gives the lease; it is renewed as long as the page touches."""
TOUCH_TIME = 0.4
"""s after the last touch for which a page still holds what it held."""
MAX_STATES_BEHIND = 4
"""States behind the newest one that a touch may answer; there are ten a second."""
MAX_COMMANDS = 32
"""Commands of a page whose end is still to come, at most."""
"""Characters of the name that a page gives, at most."""
COMMAND_KEYS = ("path", "value", "arguments", "over")
"""Keys of a page's command that are passed on, besides `do`; the rest is this module's."""
SENDERS = ThreadPoolExecutor(8, "umo client")
"""Threads that do nothing else, so that a client never waits for a slow answer to another page."""
Tell = Callable[[dict[str, Any]], Awaitable[None]]


class PageClient:
    """The client of one page of a visitor, for one run. `tell` sends it a message. FramesError if the run has ended."""

    def __init__(self, watched: Watched, feed: Feed, visitor: Visitor, tell: Tell) -> None:
        self.watched = watched
        self._feed = feed
        self._visitor = visitor
        self._tell = tell
        self._user = ""
        """The name that the page gave last, as roles know it."""
        self._roles = Roles.load()
        """Read again with each lease."""
        self._who = self._named("")
        self._key = secrets.token_hex(8)
        self._reader = watched.reader.again()
        self._station = Commander(self._reader)
        self._held: list[str] = []
        self._touched = 0.0
        self._leased = 0
        """The number of the lease that this page took; 0: none."""
        self._following: dict[asyncio.Task[None], str] = {}
        """Commands whose end is still to come, with their paths until they are taken: these are held already."""
        self._ended = False
        self._keeping = asyncio.create_task(self._keep())

    def _named(self, name: str) -> str:
        if self._visitor.is_owner:
            return who_text(name.strip() or user_name(), f" (page, {self._visitor.address})")
        return who_text(name, f"{UNVERIFIED} (page, {self._visitor.address})")

    # Commands ------------------------------------------------------------------------------------------

    async def carry_out(self, message: dict[str, Any]) -> None:
        """Send a command of the page. Its answers are told when they come: `begun` for a long action, then its end."""
        if message.get("do") == "lease":
            self._user = " ".join(str(message.get("who", "")).split())
            self._roles = Roles.load()
        caller = Caller(PAGE, self._user, is_owner=self._visitor.is_owner)
        refusal = self._roles.refusal(caller, str(message.get("do")))
        if refusal is not None:
            await self._answer(message, CommandState.REFUSED, refusal)
            return
        if message.get("do") == "stop":
            await self._stop(message)
            return
        if len(self._following) >= MAX_COMMANDS:
            await self._answer(message, CommandState.REFUSED, f"up to {MAX_COMMANDS} commands at once")
            return
        more = {name: message[name] for name in COMMAND_KEYS if name in message}
        if message.get("do") == "lease":
            self._who, more["seconds"] = self._named(str(message.get("who", ""))), LEASE_TIME
        start, path = self._reader.next_event, str(message.get("path"))
        self._sign(path)
        try:
            number = await self._send(str(message.get("do")), **more)
        except (CommandRefused, FramesError) as error:
            await self._answer(message, CommandState.REFUSED, str(error))
            return
        task = asyncio.create_task(self._follow(message, Answers(self._reader, number, start)))
        self._following[task] = path
        task.add_done_callback(self._following.pop)

    async def _stop(self, message: dict[str, Any]) -> None:
        """A level in shared memory: it needs no lease, and no queue delays it."""
        try:
            self._station.stop(self._who)
        except FramesError as error:
            await self._answer(message, CommandState.REFUSED, str(error))
        else:
            await self._answer(message, CommandState.DONE, "")

    async def _send(self, do: str, **more: Any) -> int:
        """Send a command in a thread: the queue may be full, or it is another client's turn."""
        send = partial(self._station.send, do, key=self._key, who=self._who, **more)
        return await asyncio.get_running_loop().run_in_executor(SENDERS, send)

    async def _follow(self, message: dict[str, Any], answers: Answers) -> None:
        state = CommandState.BEGUN
        try:
            while state is CommandState.BEGUN:
                for event in answers.new():
                    state = event.state
                    self._following[cast("asyncio.Task[None]", asyncio.current_task())] = ""
                    text, more = event.text, {"command": event.command}
                    if (message.get("do"), state) == ("lease", CommandState.DONE):
                        self._leased, text = int(event.text), ""
                        self.touch([], self.watched.number)
                        more["lease"] = self._leased
                    await self._answer(message, state, text, **more)
                await self._feed.looked()
        except (CommandRefused, FramesError) as error:
            await self._answer(message, CommandState.FAILED, str(error))

    async def _answer(self, message: dict[str, Any], state: CommandState, text: str, **more: Any) -> None:
        about = {"type": "answer", "id": message.get("id"), "state": str(state), "text": text}
        with suppress(WebSocketDisconnect, RuntimeError):  # the page is closed
            await self._tell(about | more)

    # The lease -----------------------------------------------------------------------------------------

    def touch(self, held: list[str], number: int) -> None:
        """The page is there, has this state, and holds these paths. An old state does not count: something is slow."""
        if self.watched.number - number > MAX_STATES_BEHIND:
            return
        self._touched = time.monotonic()
        self._held = held
        self._sign(LEASE, *held)

    def _sign(self, *paths: str) -> None:
        """A sign of life for these paths, as far as the page has the lease."""
        if self._reader.lease_held(self._leased):
            with suppress(FramesError):
                self._station.sign(self._leased, *paths)

    async def _keep(self) -> None:
        """Renew the lease, and give signs of life for what the page holds, as long as it touches."""
        while not self._ended:
            silent = time.monotonic() - self._touched
            if silent < LEASE_TIME:
                begun = filter(None, self._following.values())
                self._sign(LEASE, *([*self._held, *begun] if silent < TOUCH_TIME else []))
            await asyncio.sleep(DEAD_MAN_TIME / SIGNS_OF_LIFE)

    async def close(self) -> None:
        """The page is closed: the lease is given back, and the machine lets go of what it held."""
        self._ended = True
        for task in list(self._following):
            task.cancel()
        if self._reader.lease_held(self._leased):
            with suppress(CommandRefused, FramesError, OSError):
                await self._send("give back")
        await self._keeping
        self._station.close()

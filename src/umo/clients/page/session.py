"""One open page: its websocket, its subscriptions, and its requests.

From the page, JSON: `watch` (name of a run; "": none; place: its folder, null: any), `live` (id, paths, span, width,
trigger), `extremes` (id; anew: from now on), `stop` (id), `window` (id, paths, start, stop, width), `measure` (id,
paths, start, stop), `tune law` (id, facts, start, stop, relay), `command` (id, do, path, value, arguments, over, who),
`touch` (number of the state that it answers, held), `play` (of a recording: time, playing, speed).
To the page, JSON: `server`, `stations`, `fleet`, `description`, `state`, `extremes`, `measured`, `tuned`, `answer`,
`error`; binary: points (`umo.clients.page.subscriptions.packed`).
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar, runtime_checkable

from starlette.websockets import WebSocket, WebSocketDisconnect

from umo.clients.page.extremes import ExtremesNews
from umo.clients.page.feed import Feed
from umo.clients.page.page_client import PageClient
from umo.clients.page.subscriptions import BadRequest, HistoryPart, Subscription, in_worker, number, pixels
from umo.clients.page.tuning_answer import TuningQuestion
from umo.clients.page.visitor import Visitor
from umo.clients.page.watched_run import Watched
from umo.errors import FramesError, UmoError

T = TypeVar("T")
MAX_SUBSCRIPTIONS = 16
"""Largest number of subscriptions of one page."""
MAX_REQUESTS = 64
"""Largest number of parts of the history that a page has requested and not received yet."""
MAX_HELD = 256
"""Largest number of paths that a page holds simultaneously."""
CLOSE_TIMEOUT = 1.0
"""Time in s within which a page must close its socket."""
FLEET_PAUSE = 0.5
"""Time in s from one table of the fleet to the next."""
READ_ONLY = "this page is read-only"
UNKNOWN = Visitor("unknown")


@runtime_checkable
class PlayedBack(Protocol):
    """A recording (`umo.clients.page.watched_recording`)."""

    def play(self, time: float | None, playing: bool, speed: float) -> None: ...


@dataclass(frozen=True)
class InitialStation:
    """The station that is shown before the page chooses one. It is given by the pid of a run, or else by a folder."""

    station: str
    place: str
    pid: int | None = None

    def among(self, runs: Sequence[Watched]) -> Watched | None:
        own = [each for each in runs if (each.station, each.place) == (self.station, self.place)]
        return next((each for each in runs if each.about["pid"] == self.pid), own[-1] if own else None)


class Session:
    """The session of one page. `server`: the facts about this server that every page receives. `first`: the station to
    show first; None means the only run."""

    def __init__(
        self,
        socket: WebSocket,
        feed: Feed,
        server: dict[str, Any],
        first: InitialStation | None = None,
        visitor: Visitor = UNKNOWN,
    ) -> None:
        self._socket = socket
        self._feed = feed
        self._server = server
        self._first = first
        self._visitor = visitor
        self._name: str | None = None
        """Name of the run to show, or empty if there is none; None if none is chosen yet."""
        self._place: str | None = None
        """Folder of the station of this run; None means any folder."""
        self._watched: Watched | None = None
        self._live: dict[Any, Subscription] = {}
        self._extremes: ExtremesNews | None = None
        self._state = 0
        """Number of the state that was sent last."""
        self._stations = ""
        self._fleet, self._fleet_due = "", 0.0
        self._sending = asyncio.Lock()
        self._asked: asyncio.Queue[Callable[[], str | bytes]] = asyncio.Queue(MAX_REQUESTS)
        self._client: PageClient | None = None

    async def run(self) -> None:
        """Carry out the messages of the page until the page is closed."""
        self._feed.pages += 1
        sending = asyncio.create_task(self._sending_until_closed())
        try:
            while True:
                await self._receive(await self._socket.receive_text())
        except (WebSocketDisconnect, KeyError, RuntimeError):  # KeyError: a binary message; RuntimeError: it is closed,
            pass  # because nothing could be sent any longer
        finally:
            self._feed.pages -= 1
            sending.cancel()
            self._forget()
            await self._drop_client()
            with suppress(asyncio.CancelledError):
                await sending

    # To the page ---------------------------------------------------------------------------------------

    async def _sending_until_closed(self) -> None:
        """Send new data and answers. If that fails, the socket is closed, and the page connects again."""
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send_all())
                tasks.create_task(self._send_what_was_asked())
        except* (WebSocketDisconnect, RuntimeError):  # the page is closed
            pass
        finally:
            with suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
                await asyncio.wait_for(self._socket.close(1011), CLOSE_TIMEOUT)

    async def _send_what_was_asked(self) -> None:
        while True:
            work = await self._asked.get()
            await self._send(await in_worker(work))

    async def _send_all(self) -> None:
        """Send new data after every look at the rings. A slow page gets fewer messages, and no other page waits for
        it."""
        await self._tell(self._server | {"type": "server"})
        while True:
            await self._tell_stations()
            await self._tell_fleet()
            await self._tell_state()
            for live in list(self._live.values()):
                message = await in_worker(live.next) if live.takes_long else live.next()
                if message is not None:
                    await self._send(message)
            await self._feed.looked()

    async def _tell_stations(self) -> None:
        """Send the list of stations if it has changed. If the page shows another run than before, send the description
        of that run."""
        told = (self._of(watched, watched.line) for watched in list(self._feed.watched.values()))
        lines = [line for line in told if line is not None]
        runs = list(self._feed.watched.values())
        if (text := json.dumps({"type": "stations", "stations": lines})) != self._stations:
            self._stations = text
            await self._send(text)
        if self._name is None:  # the page has chosen none
            only = runs[0] if len(runs) == 1 else None
            first = only if self._first is None else self._first.among(runs)
            self._name = None if first is None else first.name
        watched = self._feed.watched.get(self._name or "")
        if watched is not None and self._place not in (None, watched.place):
            watched = None
        if watched is not self._watched:
            self._forget()
            self._watched = watched
            if watched is not None:
                watched.viewers += 1
                await self._tell(watched.description())

    def _of(self, watched: Watched, tell: Callable[[], T]) -> T | None:
        """Return the result of a function that reads a run. If it fails because the run's ring is damaged, drop this
        run and return None; the other runs are still shown."""
        try:
            return tell()
        except Exception as error:
            self._feed.drop(watched, error)
            return None

    async def _tell_fleet(self) -> None:
        """Send the table of the fleet while the page shows no station: at most once per `FLEET_PAUSE`, and only if it
        has changed."""
        fleet, now = self._feed.fleet, time.monotonic()
        if fleet is None or self._watched is not None or now < self._fleet_due:
            return
        self._fleet_due = now + FLEET_PAUSE
        if (text := json.dumps({"type": "fleet", "stations": fleet.rows()})) != self._fleet:
            self._fleet = text
            await self._send(text)

    async def _tell_state(self) -> None:
        watched = self._watched
        if watched is None or watched.reader.closed or watched.number == self._state:
            return
        full = self._state == 0 or watched.number != self._state + 1
        self._state = watched.number
        if (text := self._of(watched, lambda: watched.state(full))) is None:
            return
        await self._send(text)
        if self._extremes is not None and (news := self._extremes.next()) is not None:
            await self._tell(news)

    async def _tell(self, message: dict[str, Any]) -> None:
        await self._send(json.dumps(message))

    async def _send(self, message: str | bytes) -> None:
        async with self._sending:
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)

    # From the page -------------------------------------------------------------------------------------

    async def _receive(self, text: str) -> None:
        """Carry out a message of the page. The answer to an invalid message is an error."""
        message: Any = None
        try:
            message = json.loads(text)
            if not isinstance(message, dict):
                raise BadRequest("a message must be a JSON object")
            await self._carry_out(message)
        except (ValueError, RecursionError) as error:  # BadRequest and what json raises
            asked = message.get("id") if isinstance(message, dict) else None
            await self._tell({"type": "error", "id": asked, "text": str(error)[:200]})

    async def _carry_out(self, message: dict[str, Any]) -> None:
        kind, watched = message.get("type"), self._watched
        if kind == "watch":
            await self._watch(message.get("name"), message.get("place"))
        elif kind == "command":
            await (await self._client_on(watched)).carry_out(message)
        elif kind == "touch":
            if self._client is not None:
                self._client.touch(_held(message), int(number(message, "number")))
        elif kind == "stop":
            self._stop(_key(message))
        elif watched is None:
            raise BadRequest("no station is chosen")
        elif kind == "live":
            self._subscribe(Subscription(watched, message), _key(message))
        elif kind == "extremes":
            self._end_extremes()
            self._extremes = ExtremesNews(_key(message), watched.extremes_for(message.get("anew") is True))
        elif kind == "play":
            self._play(watched, message)
        elif kind == "window":
            head = {"id": message.get("id"), "window": True}
            self._ask(partial(HistoryPart.of(watched, message).window, head, pixels(message)))
        elif kind == "tune law":
            self._ask(partial(TuningQuestion(watched, message).answer, {"type": "tuned", "id": message.get("id")}))
        elif kind == "measure":
            head = {"type": "measured", "id": message.get("id")}
            self._ask(partial(HistoryPart.of(watched, message).measured, head))
        else:
            raise BadRequest(f"there is no message named {kind!r}")

    @staticmethod
    def _play(watched: Watched, message: dict[str, Any]) -> None:
        """Move the time of a recording, for all pages that show it."""
        if not isinstance(watched, PlayedBack):
            raise BadRequest("this is not a recording")
        time = number(message, "time") if "time" in message else None
        watched.play(time, message.get("playing") is True, number(message, "speed", 1.0))

    def _ask(self, work: Callable[[], str | bytes]) -> None:
        try:
            self._asked.put_nowait(work)
        except asyncio.QueueFull:
            raise BadRequest(f"a page may wait for at most {MAX_REQUESTS} answers") from None

    async def _client_on(self, watched: Watched | None) -> PageClient:
        """Return the client of this page for the run that the page shows. The client is created for the first
        command."""
        if not self._server.get("operate"):
            raise BadRequest(READ_ONLY)
        if watched is None:
            raise BadRequest("no station is chosen")
        if self._client is None or self._client.watched is not watched:
            await self._drop_client()
            try:
                self._client = PageClient(watched, self._feed, self._visitor, self._tell)
            except FramesError as error:
                raise BadRequest(str(error)) from None
        return self._client

    async def _drop_client(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            await client.close()

    async def _watch(self, name: Any, place: Any) -> None:
        if not isinstance(name, str) or not isinstance(place, str | None):
            raise BadRequest("name and place must be strings")
        await self._drop_client()
        self._name, self._place = name, place
        self._forget()
        try:
            await self._feed.open_elsewhere(name)
        except UmoError as error:
            raise BadRequest(str(error)) from None

    def _forget(self) -> None:
        """End all subscriptions and watch nothing."""
        self._end_extremes()
        if self._watched is not None:
            self._watched.viewers -= 1
        self._watched, self._state = None, 0
        self._live.clear()

    def _end_extremes(self) -> None:
        if self._extremes is not None and self._watched is not None:
            self._watched.end_extremes(self._extremes.extremes)
        self._extremes = None

    def _stop(self, key: int) -> None:
        self._live.pop(key, None)
        if self._extremes is not None and self._extremes.id == key:
            self._end_extremes()

    def _subscribe(self, live: Subscription, key: int) -> None:
        self._live.pop(key, None)
        if len(self._live) >= MAX_SUBSCRIPTIONS:
            raise BadRequest(f"a page may have at most {MAX_SUBSCRIPTIONS} subscriptions")
        self._live[key] = live


def _key(message: dict[str, Any]) -> int:
    key = message.get("id")
    if not isinstance(key, int):
        raise BadRequest("id must be a whole number")
    return key


def _held(message: dict[str, Any]) -> list[str]:
    held = message.get("held")
    if not isinstance(held, list) or len(held) > MAX_HELD or not all(isinstance(path, str) for path in held):
        raise BadRequest(f"held must be a list of at most {MAX_HELD} paths")
    return held

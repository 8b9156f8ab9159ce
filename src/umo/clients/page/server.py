"""The server of the page: its routes, and the socket on which it listens."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import logging
import re
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from umo.clients.page import unauthenticated
from umo.clients.page.access_control import AccessControl, names_in
from umo.clients.page.feed import Feed
from umo.clients.page.session import InitialStation, Session
from umo.clients.page.subscriptions import HistoryPart, csv_of, in_worker
from umo.clients.page.unauthenticated import HttpConnection, UnauthenticatedConnections
from umo.clients.page.visitor import PageToken
from umo.clients.page.watched_run import described_twin
from umo.errors import Interrupted
from umo.system.packages import umo_version
from umo.text import in_brackets, shown_path

if TYPE_CHECKING:
    from umo.clients.page.fleet_feed import FleetFeed
    from umo.clients.page.watched_recording import WatchedRecording

STATIC = Path(__file__).parent / "static"
MAX_MESSAGE_BYTES = 1 << 16
"""Largest number of bytes of a message from a page."""
MAX_CONNECTIONS = 500
"""Largest number of connections that have shown the token. Requests on further ones are answered with status 503."""
FOREIGN_ERRORS = ("Invalid UTF-8", "Cancel ")
"""First words of those messages of uvicorn that do not report an error of this server."""
GRACE_TIME = 1
"""Time in s within which open pages must close when the server ends."""

ATTACHMENT = {"content-disposition": "attachment"}
"""Header of a response that the browser saves as a file."""


@dataclass(frozen=True)
class Options:
    """Options of the server. `token`: the token of this user. `first`: the station that is shown first. `operate`: True
    if pages may command, within the roles of their visitors."""

    host: str
    port: int
    token: str
    first: InitialStation | None = None
    operate: bool = True
    certificate: Path | None = None
    key: Path | None = None
    fleet: FleetFeed | None = None
    """The stations of other computers."""
    recorded: WatchedRecording | None = None
    """A recording that is shown instead of stations."""
    shared: str | None = None
    """A token for other visitors."""
    proxy: str = ""
    """The address (origin) at which a proxy serves the page, or "" if none does."""


def application(options: Options, feed: Feed, ended: Callable[[asyncio.Task[None]], None]) -> ASGIApp:
    """Return the application that serves the page of a feed, with access control. `ended` is called when the
    application ends."""
    name = None if options.first is None else options.first.station
    about = {"station": name, "operate": options.operate, "version": umo_version()}

    async def index(request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    async def page(websocket: WebSocket) -> None:
        await websocket.accept()
        await Session(websocket, feed, about, options.first, websocket.scope["state"]["visitor"]).run()

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        reading = asyncio.create_task(feed.run())
        reading.add_done_callback(ended)
        yield
        reading.cancel()
        await asyncio.wait([reading])
        feed.close()

    routes = [
        Route("/", index),
        WebSocketRoute("/ws", page),
        Route("/twin/{name:path}", _twin),  # a name of a fleet has a slash
        Route("/csv/{name:path}", _csv),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(routes=routes, lifespan=lifespan)
    app.state.feed = feed
    names = None if options.certificate is None else names_in(options.certificate, options.key)
    scripts = _hashes((STATIC / "index.html").read_text())
    tokens = [PageToken(options.token, is_own=True)]
    if options.shared is not None:
        tokens.append(PageToken(options.shared, is_own=False))
    return AccessControl(app, tokens, options.host, options.port, scripts, names, options.proxy)


async def _twin(request: Request) -> Response:
    feed = request.app.state.feed
    watched = feed.watched.get(request.path_params["name"])
    ask = feed.fleet and feed.fleet.twin
    found = None if watched is None else await asyncio.to_thread(described_twin, watched, ask)
    return PlainTextResponse("no twin\n", 404) if found is None else JSONResponse(found)


async def _csv(request: Request) -> Response:
    watched, query = request.app.state.feed.watched.get(request.path_params["name"]), request.query_params
    if watched is None:
        return PlainTextResponse("there is no such run\n", 404)
    try:
        limits = {name: float(query.get(name, "")) for name in ("start", "stop")}
        stretch = HistoryPart.of(watched, {"paths": query.getlist("path")} | limits)
    except ValueError as error:  # BadRequest, and what float raises
        return PlainTextResponse(f"{error}\n", 400)
    return StreamingResponse(_pieces(csv_of(stretch)), media_type="text/csv", headers=ATTACHMENT)


async def _pieces(texts: Iterator[str]) -> AsyncIterator[str]:
    while text := await in_worker(next, texts, ""):
        yield text


def _hashes(html: str) -> str:
    """Return the hashes of the scripts in a page, for the Content-Security-Policy."""
    found = re.findall(r"<script[^>]*>([^<]+)</script>", html)
    return " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in found)


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket. Raises OSError if the port is in use, or the address does not belong to this
    computer."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family)


def serve(options: Options, listening: socket.socket, ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C or SIGTERM. `ready` is called when the server answers. An error in the feed is raised."""
    serving = server(options, ready)
    serving.run(sockets=[listening])
    if serving.failure is not None:
        raise serving.failure


def server(options: Options, ready: Callable[[], None]) -> Server:
    """Return the server, which does not run yet."""
    app = application(options, Feed(options.fleet, options.recorded), lambda task: serving.feed_ended(task))
    http: Any = partial(HttpConnection, UnauthenticatedConnections(), _tls(options))
    config = uvicorn.Config(
        app, loop="asyncio", http=http, log_level="error", access_log=False, lifespan="on",
        server_header=False, proxy_headers=False, ws="websockets-sansio", ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False, limit_concurrency=MAX_CONNECTIONS + unauthenticated.MAX_STRANGERS,
        timeout_graceful_shutdown=GRACE_TIME,
    )  # fmt: skip
    logging.getLogger("uvicorn.error").addFilter(_is_of_this_server)
    serving = Server(config, ready)
    return serving


def _is_of_this_server(record: logging.LogRecord) -> bool:
    """True if a logged error is one of this server. uvicorn also reports text from a page that is not UTF-8, and, when
    the server ends, responses that are not finished."""
    unfinished = record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError)
    return not unfinished and not record.getMessage().startswith(FOREIGN_ERRORS)


def _tls(options: Options) -> ssl.SSLContext | None:
    if options.certificate is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(options.certificate, options.key)
    return context


class Server(uvicorn.Server):
    """A server that reports when it is ready, and ends when its feed ends. Ctrl-C and SIGTERM end the server, not the
    process."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self.failure: BaseException | None = None
        """Error that ended the feed."""
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._ready()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal. The second signal ends the server without informing the pages. A further one also ends code
        that hangs."""
        if self.force_exit:
            place = "" if frame is None else f"{shown_path(frame.f_code.co_filename)}:{frame.f_lineno}"
            raise Interrupted(f"the page does not end{in_brackets(place)}", sig)
        self.force_exit, self.should_exit = self.should_exit, True

    def feed_ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled():
            self.failure = task.exception()
        self.should_exit = True

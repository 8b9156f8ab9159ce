"""The JetStream of a fleet: the settings of a nats-server that keeps the data published by gateways.

# ~/.config/umo/fleet.toml
[jetstream]
user = "cell7"                          # or UMO_JETSTREAM_USER
password_file = "~/.config/umo/nats"    # its first line; or UMO_JETSTREAM_PASSWORD
credentials = "~/.config/umo/me.creds"  # instead of both: a file of nsc; or UMO_JETSTREAM_CREDENTIALS
keep = "7 d"                            # largest age of the data, if the stream does not exist yet
bytes = 10_000_000_000                  # largest size, if the stream does not exist yet

Deltas and events are in one stream, in the order in which they arrived. Declarations are in a second stream, which has
the last declaration of each run, so that they are not dropped when the first stream reaches its limit of age or size.
"""

from __future__ import annotations

import asyncio
import os
import ssl
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import nats
from nats.aio.client import Client
from nats.errors import Error as NatsError
from nats.js import JetStreamContext
from nats.js.api import DiscardPolicy, StreamConfig
from nats.js.errors import NotFoundError

from umo.clients.faces.endpoint import is_local
from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_identity import CA_FILE, CERTIFICATE_FILE, KEY_FILE
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_settings import BYTES, KEEP, JetStreamTable
from umo.clients.fleet.jetstream_credentials import NOBODY, Credentials
from umo.errors import OptionError, UmoError, text_of

STREAM, DECLARATIONS = "umo", "umo-declarations"
DECLARATION_BYTES = 256 << 20
REFRESH = 3600.0
"""Time in s after which a declaration is published again, so that it is not dropped before the deltas of its run."""
DUPLICATES = 120.0
"""Time in s within which a repeated message is dropped."""
FIRST = "Umo-First"
"""Header of a delta. Its value is a number: deltas before that number that are not yet in the stream will not
arrive."""
RETRY_DELAY = 2.0
"""Time in s after which a server that is away is tried again."""
CONNECT_TIME = 3
"""Time in s within which a server must answer."""
AWAY = (NatsError, OSError, ssl.SSLError, TimeoutError, EOFError)
"""Errors that end an attempt to connect, or a connection."""


Use = Callable[[Client, JetStreamContext], Awaitable[None]]
Prepare = Callable[[JetStreamContext], Awaitable[None]]


class ProvedClient(Client):
    """A client that ends a connection to a server without TLS before it sends the user's credentials. nats-py would
    continue without TLS."""

    async def _process_info(self, info: dict[str, Any], initial_connection: bool = False) -> None:
        if initial_connection and not info.get("tls_required"):
            raise NatsError("the server has no TLS")
        await super()._process_info(info, initial_connection)


@dataclass(frozen=True)
class JetStreamServer:
    """The server. `url`: nats://HOST:PORT or tls://HOST:PORT; `certificates`: folder as for a fleet; `keep`: largest
    age of data in the stream in s."""

    url: str
    certificates: Path | None = None
    credentials: Credentials = NOBODY
    keep: float = KEEP
    bytes: int = BYTES

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.url)
            is_one = parts.scheme in ("nats", "tls") and bool(parts.hostname) and (parts.port or 4222) > 0
        except ValueError:
            is_one = False
        if not is_one or parts.path.strip("/") or parts.query:
            raise OptionError(f"{_hidden(self.url)!r} is not a JetStream; write nats://HOST:4222, or tls://HOST:4222")
        if "@" in parts.netloc:
            raise OptionError(
                "a password on a command line can be seen by every user: write user and password_file in [jetstream] "
                "of fleet.toml, or UMO_JETSTREAM_USER and UMO_JETSTREAM_PASSWORD"
            )
        if parts.scheme == "tls" and self.certificates is None:
            raise OptionError(f"{self.url}: tls needs the folder of certificates (--certificates)")
        if self.credentials.password is not None and parts.scheme == "nats" and not is_local(str(parts.hostname)):
            raise OptionError(f"{self.url}: anybody on the network could read the password; write tls://HOST:4222")
        self.context()

    def context(self) -> ssl.SSLContext | None:
        """Return the context for TLS, in which both ends prove who they are. Raises OptionError if the certificates
        cannot be used."""
        if not self.url.startswith("tls:") or self.certificates is None:
            return None
        ca, certificate, key = (self.certificates / name for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE))
        try:
            context = ssl.create_default_context(cafile=str(ca))
            context.load_cert_chain(certificate, key)
        except OSError as error:
            raise OptionError(
                f"{self.certificates}: the certificates in this folder cannot be used ({text_of(error)})"
            ) from None
        return context

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[tuple[Client, JetStreamContext]]:
        """Return a connection with its streams, which are created if they are missing. Raises one of `AWAY`, or
        UmoError."""
        client = Client() if self.context() is None else ProvedClient()
        try:
            await asyncio.wait_for(client.connect(
                self.url.replace("tls:", "nats:"), tls=self.context(), allow_reconnect=False,
                connect_timeout=CONNECT_TIME, error_cb=_unheard, ping_interval=2, max_outstanding_pings=2,
                name="umo fleet", **self.credentials.options(),
            ), 2 * CONNECT_TIME)  # fmt: skip
            js = client.jetstream()
            await self._make_streams(js)
            yield client, js
        finally:
            with suppress(*AWAY):
                await asyncio.wait_for(client.close(), CONNECT_TIME)

    async def keep_using(
        self, use: Use, stop: threading.Event, say: Callable[[str], object], prepare: Prepare | None = None
    ) -> None:
        """Call `use` with a connection until `use` is done. If the server is unreachable or `prepare` fails, try again
        until `stop`; `say` is called when the server becomes unreachable, and when the server is reached again."""
        told: str | None = None
        """The reason why the server is unreachable; empty if it is reached, None if that is not known yet."""
        while True:
            try:
                async with self.connected() as (client, js):
                    if prepare is not None:
                        await prepare(js)
                    if told is not None:
                        say("the JetStream can be reached again")
                    told = ""
                    await use(client, js)
                    return
            except (*AWAY, UmoError) as error:
                text = (
                    str(error)
                    if isinstance(error, UmoError)
                    else (f"the JetStream {self.url} cannot be reached: {why(error)}")
                )
                if not told:
                    say(f"{text}; waiting for it")
                told = text
            if await asyncio.to_thread(stop.wait, RETRY_DELAY):
                return

    async def _make_streams(self, js: JetStreamContext) -> None:
        """Create the streams that do not exist. Existing streams are used unchanged, because the operator of the server
        may have chosen other settings for them."""
        for name, subjects, most, keep, size in (
            (STREAM, [subject("*", "*", "*")], -1, self.keep, self.bytes),
            (DECLARATIONS, [subject("*", "*", keys.DECLARATION, "*")], 1, self.keep + 24 * REFRESH,
             DECLARATION_BYTES),
        ):  # fmt: skip
            config = StreamConfig(
                name, subjects=subjects, max_msgs_per_subject=most, max_age=keep, max_bytes=size,
                discard=DiscardPolicy.OLD, duplicate_window=min(DUPLICATES, keep),
            )  # fmt: skip
            try:
                await js.stream_info(name)
            except NotFoundError:
                await self._make(js, config)

    async def _make(self, js: JetStreamContext, config: StreamConfig) -> None:
        try:
            await js.add_stream(config)
        except nats.js.errors.APIError as error:
            raise UmoError(
                f"{self.url}: the stream {config.name} of {config.max_bytes:,} bytes cannot be created: "
                f"{error.description} ([jetstream] bytes in fleet.toml)"
            ) from None


async def _unheard(_: Exception) -> None:
    """Ignore a change of the connection, because the code that uses the connection notices it."""


def why(error: BaseException) -> str:
    """Describe an error of a connection in a few words."""
    if isinstance(error, TimeoutError | EOFError | nats.errors.NoServersError) and not str(error).strip():
        return "no answer"
    text = getattr(error, "description", None) or getattr(error, "strerror", None) or str(error)
    return str(text).removeprefix("nats: ") or type(error).__name__


def load(
    url: str, certificates: Path | None, table: JetStreamTable, environ: Mapping[str, str] = os.environ
) -> JetStreamServer:
    """Return the server that the table [jetstream] and the environment describe. Raises OptionError for an error in
    either."""
    return JetStreamServer(url, certificates, Credentials.load(table, environ), table.keep, table.bytes)


def _hidden(url: str) -> str:
    """Return an address without its password."""
    before, at, host = url.rpartition("@")
    return f"{before.partition('://')[0]}://...@{host}" if at else url


# Subjects ----------------------------------------------------------------------------------------------


def subject(site: str, station: str, *words: str) -> str:
    """Return the subject `umo.SITE.STATION.KIND`. A dot in a name becomes `~`, which no name contains."""
    return ".".join((keys.ROOT, *(each.replace(".", "~") for each in (site, station)), *words))


def key_and_kind(text: str) -> tuple[StationKey, str]:
    """Return the station and the kind of a subject."""
    _, site, station, kind, *_ = text.split(".")
    return StationKey(site.replace("~", "."), station.replace("~", ".")), kind


def matcher(patterns: Sequence[str]) -> Callable[[StationKey], bool]:
    """Return the function that tests whether a station matches one of the patterns SITE/STATION, in which `*` stands
    for any characters."""
    return lambda key: any(fnmatchcase(key.site, site) and fnmatchcase(key.station, station)
                           for site, _, station in (each.partition("/") for each in patterns))  # fmt: skip

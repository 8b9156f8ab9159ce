"""Limits the number and the duration of connections that have not shown the token yet. Incomplete requests, incomplete
TLS handshakes and refused pages count only towards these limits. A connection that has shown the token is no longer
counted, so that an open page can always reconnect and stop its machine.
"""

from __future__ import annotations

import asyncio
import ssl
from asyncio.trsock import TransportSocket
from collections import Counter
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

TOKEN_TIMEOUT = 10.0
"""Time in s after which a connection that has not shown the token is cut off."""
MAX_STRANGERS = 100
"""Largest number of connections that have not shown the token. When another one arrives, the address with the most of
these connections loses its oldest one."""


class UnauthenticatedConnections:
    """The connections of one server that have not shown the token."""

    def __init__(self) -> None:
        self._addresses: dict[asyncio.Transport, str] = {}
        """The address of each connection, beginning with the oldest connection."""

    def enter(self, transport: asyncio.Transport) -> None:
        """Add a new connection, which must show the token within `TOKEN_TIMEOUT`."""
        self._addresses = {known: address for known, address in self._addresses.items() if not known.is_closing()}
        if len(self._addresses) >= MAX_STRANGERS:
            ((most, _),) = Counter(self._addresses.values()).most_common(1)
            self._cut_off(next(known for known, address in self._addresses.items() if address == most))
        self._addresses[transport] = str((transport.get_extra_info("peername") or ("",))[0])
        asyncio.get_running_loop().call_later(TOKEN_TIMEOUT, self._cut_off, transport)

    def leave(self, transport: asyncio.Transport) -> None:
        """Forget a connection that has shown the token, or has ended."""
        self._addresses.pop(transport, None)

    def _cut_off(self, transport: asyncio.Transport) -> None:
        if self._addresses.pop(transport, None) is not None:
            transport.abort()


class HttpConnection(H11Protocol):
    """One connection. Its requests have this object as `visit` in their state. With `context` the connection uses
    TLS."""

    def __init__(
        self, strangers: UnauthenticatedConnections, context: ssl.SSLContext | None, *, app_state: Any, **given: Any
    ) -> None:
        super().__init__(app_state=app_state | {"visit": self}, **given)
        self._strangers = strangers
        self._context = context
        self._socket: asyncio.Transport | None = None
        self._handshake: asyncio.Task[None] | None = None
        self._early = b""
        """Bytes that arrived together with the end of the handshake."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self._socket = transport
        self._strangers.enter(transport)
        if self._context is None:
            super().connection_made(transport)
        else:
            transport.pause_reading()
            self._handshake = asyncio.create_task(self._begin_tls(transport, self._context))

    async def _begin_tls(self, transport: asyncio.Transport, context: ssl.SSLContext) -> None:
        """Carry out the handshake of TLS. Meanwhile the connection is one of the `UnauthenticatedConnections`, which
        may end it."""
        try:
            secured = await self.loop.start_tls(
                transport, self, context, server_side=True, ssl_handshake_timeout=TOKEN_TIMEOUT
            )
        except (OSError, ssl.SSLError):  # the other side speaks no TLS, or has gone
            transport.abort()
        else:
            if secured is not None:
                super().connection_made(secured)
                if self._early:
                    super().data_received(self._early)

    def data_received(self, data: bytes) -> None:
        if self.transport is None:
            self._early += data
        else:
            super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._socket is not None:
            self._strangers.leave(self._socket)
        if self.transport is not None:
            super().connection_lost(exc)

    def welcome(self) -> None:
        """Record that the token was shown, so that the connection may stay open."""
        if self._socket is not None:
            self._strangers.leave(self._socket)

    @property
    def peer_socket(self) -> TransportSocket | None:
        """The socket of the other end, or None if that end has closed."""
        return None if self.over or self._socket is None else self._socket.get_extra_info("socket")

    @property
    def over(self) -> bool:
        """True if the other side has disconnected."""
        return self._socket is None or self._socket.is_closing()

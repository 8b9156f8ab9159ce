"""The addresses of hosts, which are looked up within a time limit, and connections to hosts."""

from __future__ import annotations

import errno
import os
import select
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from ipaddress import IPv4Address, IPv6Address, ip_address
from threading import Thread
from time import monotonic
from typing import Any

from umo.drivers.streams.stream import Gone, Stream, TimedOut
from umo.errors import DriverError
from umo.text import reason_of

MAX_LOOKUP_TIME = 2.0
"""Time in s for the look-up of a device's name. The resolver itself has no limit."""
_END = "the device closed the connection"
Found = list[tuple[Any, ...]]
"""An entry of the result of `socket.getaddrinfo`."""


def addresses(host: str) -> tuple[str, ...]:
    """Return every numeric address of the host, IPv6 in brackets, so that two names of one device compare equal. If a
    name cannot be looked up, the name itself is returned.

    "Any address" (0.0.0.0, ::) becomes the loopback address; IPv4 within IPv6 becomes IPv4. The function raises no
    error and ends within `MAX_LOOKUP_TIME`.
    """
    try:
        found = _found(host, None, MAX_LOOKUP_TIME)
    except (OSError, ValueError):
        return (host.lower().rstrip("."),)
    return tuple(sorted({_normal(str(address[0]), address[3:]) for *_, address in found}))


class TcpDial:
    """An object that opens connections to a TCP port. The name of the host is looked up once, for the first
    connection."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._found: Found = []

    def __call__(self, deadline: float) -> Stream:
        """Open a connection: try each address of the host, with an equal share of the remaining time. Raises the Gone
        or TimedOut of the last address. Raises DriverError if the name is not found."""
        self._found = self._found or self._look_up(deadline)
        why, timed_out = "no address", False  # not the error itself: it would keep its frames, and they it
        for tried, place in enumerate(self._found):
            try:
                connection = _connected(place, (deadline - monotonic()) / (len(self._found) - tried))
            except OSError as error:
                why, timed_out = reason_of(error), isinstance(error, TimeoutError)
            else:
                return Stream(connection, _END)
        raise TimedOut if timed_out else Gone(why)

    def without_waiting(self, deadline: float) -> Iterator[Stream | None]:
        """Open a connection without waiting: yield None until it is open, then the stream."""
        if not self._found:
            outcome = _begin_look_up(self._host, self._port)
            while not outcome.done() and monotonic() < deadline:
                yield None
            self._found = self._result(lambda: outcome.result(0.0))
        why, timed_out = "no address", False
        for tried, place in enumerate(self._found):
            until = monotonic() + (deadline - monotonic()) / (len(self._found) - tried)
            try:
                for connection in _connecting(place, until):
                    yield None if connection is None else Stream(connection, _END)
                return
            except OSError as error:
                why, timed_out = reason_of(error), isinstance(error, TimeoutError)
        raise TimedOut if timed_out else Gone(why)

    def _look_up(self, deadline: float) -> Found:
        return self._result(lambda: _found(self._host, self._port, deadline - monotonic()))

    def _result(self, look_up: Callable[[], Found]) -> Found:
        try:
            return look_up()
        except TimeoutError:
            raise TimedOut(f"{self._host} was not looked up") from None
        except OSError as error:
            raise DriverError(f"{self._host}:{self._port}: {reason_of(error)}") from None
        except ValueError:  # UnicodeError, and a NUL
            raise DriverError(f"{self._host!r} is not the name of a host") from None


def _connected(place: tuple[Any, ...], seconds: float) -> socket.socket:
    """Return a connection that does not block. Raises OSError if there is none within this time in s."""
    family, kind, protocol, _, address = place
    connection = socket.socket(family, kind, protocol)
    try:
        if seconds <= 0:
            raise TimeoutError
        connection.settimeout(seconds)
        connection.connect(address)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
    except BaseException:
        connection.close()
        raise
    return connection


def _connecting(place: tuple[Any, ...], until: float) -> Iterator[socket.socket | None]:
    """Connect without waiting: yield None while it is in progress, then the connection. Raises OSError if it fails."""
    family, kind, protocol, _, address = place
    connection: socket.socket | None = socket.socket(family, kind, protocol)
    try:
        assert connection is not None
        connection.setblocking(False)
        code = connection.connect_ex(address)
        writable = select.poll()
        writable.register(connection, select.POLLOUT)
        while code == errno.EINPROGRESS:
            if writable.poll(0):
                code = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            elif monotonic() >= until:
                raise TimeoutError
            else:
                yield None
        if code:
            raise OSError(code, os.strerror(code))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected, connection = connection, None
        yield connected
    finally:
        if connection is not None:
            connection.close()


def _found(host: str, port: int | None, seconds: float) -> Found:
    try:
        return socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST)
    except OSError:
        return _looked_up(host, port, seconds)


def _looked_up(host: str, port: int | None, seconds: float) -> Found:
    outcome = _begin_look_up(host, port)
    try:
        return outcome.result(max(seconds, 0.0))
    finally:
        del outcome  # it holds the error, which holds this frame


def _begin_look_up(host: str, port: int | None) -> Future[Found]:
    """Begin to look up a host in a thread, because `getaddrinfo` has no timeout."""
    outcome: Future[Found] = Future()

    def look_up(outcome: Future[Found]) -> None:
        try:
            outcome.set_result(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
        except Exception as error:
            outcome.set_exception(error.with_traceback(None))

    Thread(target=look_up, args=(outcome,), name="umo look-up", daemon=True).start()
    return outcome


def _normal(text: str, scope: tuple[object, ...]) -> str:
    address: IPv4Address | IPv6Address = ip_address(text.partition("%")[0])
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped
    if address.is_unspecified:
        address = ip_address("127.0.0.1" if address.version == 4 else "::1")
    if address.version == 4:
        return str(address)
    return f"[{address}%{scope[0]}]" if any(scope) else f"[{address}]"

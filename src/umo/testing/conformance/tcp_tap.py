"""A tap for devices that are reached by a host and a port."""

from __future__ import annotations

import os
import selectors
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Timer

from umo.testing.conformance.closed_twice import out_of_the_way
from umo.testing.conformance.relay import Tapped
from umo.testing.conformance.taps import Tap

AT_ONCE = struct.pack("ii", 1, 0)
"""The option by which a closed socket lingers for 0 s, so that the other end finds the connection reset."""
MAX_CONNECTING = 1.0
"""Time in s that connecting to the device may take."""


class TcpTap(Tap):
    """Listens at `host` and `port`, or at a free port of this computer, and opens a connection to the device for each
    client that connects."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        self._device = (host, port)
        self._listener: socket.socket | None = None
        self._full: list[socket.socket] = []
        self._silent = False
        self._ignored: list[int] = []
        """Descriptors of connections whose end the silent device has not noticed."""
        self.host, self.port = "127.0.0.1", 0

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Return a context in which requests reach the device, but answers get lost. The device also does not notice
        that the driver ends its connection."""
        self._silent = True
        try:
            with super().silent():
                yield
        finally:
            with self._lock:
                self._silent = False
                while self._ignored:
                    os.close(self._ignored.pop())

    @property
    def descriptors(self) -> int:
        return super().descriptors + len(self._ignored)

    @contextmanager
    def unreachable(self, seconds: float | None = None) -> Iterator[bool]:
        """Return a context in which the queue of the listener is full. Linux then drops requests to connect, and the
        client repeats them after 1 s."""
        if not sys.platform.startswith("linux"):
            yield False
            return
        self._go()
        address = self.host, self.port
        back = Timer(seconds or 0.0, self._return)
        try:
            self._full = [socket.create_server(address, backlog=0), socket.create_connection(address, MAX_CONNECTING)]
            if seconds is not None:
                back.start()
            yield True
        finally:
            back.cancel()
            self._return()

    def _appear(self) -> None:
        while self._full:
            self._full.pop().close()
        listener = socket.create_server((self.host, self.port), backlog=16)
        self._listener = socket.socket(fileno=out_of_the_way(listener.detach()))
        self.port = self._listener.getsockname()[1]
        self._selector.register(self._listener, selectors.EVENT_READ)

    def _vanish(self) -> None:
        if self._listener is not None:
            self._selector.unregister(self._listener)
            self._listener.close()
            self._listener = None

    def _ended(self, tapped: Tapped, by: int) -> None:
        if self._silent and by == tapped.driver:
            self._ignored.append(out_of_the_way(os.dup(by)))
        super()._ended(tapped, by)

    def _reset(self, tapped: Tapped) -> None:
        with socket.socket(fileno=os.dup(tapped.driver)) as driver:
            driver.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, AT_ONCE)

    def _accept(self) -> None:
        assert self._listener is not None
        driver, _ = self._listener.accept()
        self.connections += 1
        try:
            device = socket.create_connection(self._device, MAX_CONNECTING)
            self.missing = ""
        except OSError as error:
            self.missing = f"{self._device[0]}:{self._device[1]}: {error.strerror or error}"
            driver.close()
            return
        for each in (driver, device):
            each.settimeout(None)
            with suppress(OSError):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._add(driver.detach(), device.detach())

"""A device on loopback TCP for the tests of the kit, with a record of the levels that its outputs had.

A request: number (16 bits), function (1 read, 2 write, 3 arm the watchdog), count (8 bits each); per channel its place
(8 bits) and a level, or the time of the watchdog in ms (32 bits); a checksum (16 bits). The answer is the same with a
status (0, or an error) for the place; the high bit of its function says that a channel failed.
"""

from __future__ import annotations

import selectors
import socket
import struct
import threading
import zlib
from collections import deque
from collections.abc import Callable, Mapping
from math import inf
from time import monotonic

HEADER = struct.Struct(">HBB")
ITEM = struct.Struct(">Bi")
CHECK = struct.Struct(">H")
READ, WRITE, ARM, FAILED = 1, 2, 3, 0x80
PLACES = {"out": 0, "io": 16, "in": 32}
HIGHEST = 48
"""Places from here on are answered with status 2."""


def frame(number: int, function: int, items: list[tuple[int, int]]) -> bytes:
    body = HEADER.pack(number, function, len(items)) + b"".join(ITEM.pack(*item) for item in items)
    return body + CHECK.pack(zlib.crc32(body) & 0xFFFF)


def size(count: int) -> int:
    return HEADER.size + count * ITEM.size + CHECK.size


class Device:
    """in:N reads what out:N is at; in:8 and above are constant. One thread serves all clients."""

    def __init__(
        self, clients: int = 400, watchdog: float = inf, defaults: Mapping[int, int] | None = None, wire: float = 0.0
    ) -> None:
        """`watchdog`: s of silence after which the device brings these places to their defaults by itself, until it is
        armed with another time. `wire`: s after which in:N follows out:N."""
        self.raws = dict.fromkeys(range(HIGHEST), 0) | {40 + i: 1000 + 77 * i for i in range(8)}
        self.host, self.port = "127.0.0.1", 0
        self._clients = clients
        self._watchdog, self._defaults, self._heard = watchdog, defaults or {}, inf
        self._wire, self._under_way = wire, {place: deque([(-inf, 0)]) for place in range(8)}
        self._levels = {place: deque([0], maxlen=1000) for place in range(32)}
        self.when_driven: Callable[[], None] = lambda: None
        """Called at each write, before its answer."""
        self._selector = selectors.DefaultSelector()
        self._listener: socket.socket | None = None
        self._end = False
        self._waker, wake = socket.socketpair()
        self._wake = wake
        self._selector.register(wake, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._work, daemon=True)

    def __enter__(self) -> Device:
        self._listener = socket.create_server((self.host, self.port))
        self.port = self._listener.getsockname()[1]
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end = True
        self._waker.send(b"!")
        self._thread.join()
        for key in list(self._selector.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]
        self._waker.close()
        self._selector.close()

    def levels(self, text: str) -> list[int]:
        """As Subject.levels wants them."""
        kind, number = text.split(":")
        kept = self._levels[PLACES[kind] + int(number)]
        found = list(kept)
        kept.clear()
        kept.append(found[-1])
        return found

    def _work(self) -> None:
        while not self._end:
            ready = self._selector.select(self._until_it_lets_go())
            self._let_go()
            for key, _ in sorted(ready, key=lambda each: each[0].fileobj is self._listener):  # who leaves goes first
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is not self._wake:
                    self._serve(key.fileobj)  # type: ignore[arg-type]

    def _until_it_lets_go(self) -> float | None:
        left = self._heard + self._watchdog - monotonic()
        return max(0.0, left) if left < inf else None

    def _let_go(self) -> None:
        """The watchdog has run out: the places go to their defaults."""
        if monotonic() - self._heard > self._watchdog:
            self._heard = inf
            for place, raw in self._defaults.items():
                self._set(place, raw)

    def _accept(self) -> None:
        assert self._listener is not None
        client, _ = self._listener.accept()
        if len(self._selector.get_map()) - 2 >= self._clients:
            client.close()
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._selector.register(client, selectors.EVENT_READ)

    def _serve(self, client: socket.socket) -> None:
        try:
            request = client.recv(65536)
            if request:
                client.sendall(self.answer(request))
        except OSError:
            request = b""
        if not request:
            self._selector.unregister(client)
            client.close()

    def answer(self, request: bytes) -> bytes:
        """To one whole request; to one whose checksum is wrong status 3."""
        number, function, count = HEADER.unpack_from(request.ljust(HEADER.size, b"\0"))
        body, check = request[: -CHECK.size], request[-CHECK.size :]
        if len(request) != size(count) or check != CHECK.pack(zlib.crc32(body) & 0xFFFF):
            return frame(number, function | FAILED, [(3, 0)] * count)
        self._heard = monotonic()
        done = [self._carry_out(function, *ITEM.unpack_from(request, 4 + 5 * i)) for i in range(count)]
        failed = FAILED if any(status for status, _ in done) else 0
        return frame(number, function | failed, done)

    def _carry_out(self, function: int, place: int, raw: int) -> tuple[int, int]:
        if function == ARM:
            self._watchdog = raw / 1000 or inf
            return 0, 0
        if place >= HIGHEST or (function == WRITE and place >= 32):
            return 2, 0
        if function == WRITE:
            self.when_driven()
            self._set(place, raw)
        return 0, self._looped(place - 32) if 32 <= place < 40 else self.raws[place]

    def _set(self, place: int, raw: int) -> None:
        self.raws[place] = raw
        if raw != self._levels[place][-1]:
            self._levels[place].append(raw)
        if place in self._under_way:
            self._under_way[place].append((monotonic(), raw))
            self._looped(place)

    def _looped(self, place: int) -> int:
        levels = self._under_way[place]
        while len(levels) > 1 and monotonic() - levels[1][0] >= self._wire:
            levels.popleft()
        return levels[0][1]

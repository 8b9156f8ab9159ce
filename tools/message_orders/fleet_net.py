"""A fleet's network in one process and in virtual time, in place of Zenoh: a schedule decides over each message.

What it may do is what Zenoh may: it drops a message (congestion, a router that was killed), delivers a copy (of two
ways to one gateway), and brings one later. Answers to queries, and what comes by another router, may overtake what one
end puts under one key. It carries messages whole: it cuts and damages none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from heapq import heappop, heappush
from itertools import count
from math import inf
from queue import Empty
from types import SimpleNamespace
from typing import Any, Self
from unittest.mock import patch

WAY = 0.001
"""Time in s that a message takes."""
KEPT = 20
"""Deltas that a gateway keeps at least, and one with all words before them."""
MODULES = ("station_publisher", "fleet_mirror", "arrival_ages", "mirror_commands", "fleet_commands")
"""Those of `umo.clients.fleet` that ask for the time."""


class Net:
    """`letters` decide over messages while it `counts`: `.` deliver, `L` lose, `R` repeat after `short`, `W` hold for
    `short` s, `H` hold for `long` s; what is held is overtaken."""

    LETTERS, EACH = ".LRWH", ".LRW"
    """All letters; and those that all schedules to a depth have."""

    def __init__(self, letters: str, short: float, long: float) -> None:
        self._letters, self._short, self._long = letters, short, long
        self.now = 0.0
        self.counts = self.is_dead = False
        """While it does not count, all is delivered; while it is dead, nothing that is sent."""
        self.decided = 0
        """The number of messages that letters have decided over."""
        self.messages = 0
        self._order = count()
        self._under_way: list[tuple[float, int, Callable[[], object]]] = []
        self.subscribers: list[tuple[str, Callable[[Any], object]]] = []
        self.queryables: list[tuple[str, Callable[[Any], object]]] = []
        self.advance: Callable[[float], None] = self.carry

    @property
    def is_decided(self) -> bool:
        return self.decided >= len(self._letters)

    @property
    def next_due(self) -> float:
        """When the next message comes; infinity: none is under way."""
        return self._under_way[0][0] if self._under_way else inf

    def send(self, deliver: Callable[[], object]) -> None:
        """A message, which `deliver` brings to its end."""
        letter = "."
        self.messages += 1
        if self.counts and not self.is_decided:
            letter = self._letters[self.decided]
            self.decided += 1
        hold = {"W": self._short, "H": self._long}.get(letter, 0.0)
        if letter == "L" or self.is_dead:
            return
        self.at(self.now + WAY + hold, deliver)
        if letter == "R":
            self.at(self.now + WAY + self._short, deliver)

    def at(self, due: float, act: Callable[[], object]) -> None:
        heappush(self._under_way, (due, next(self._order), act))

    def carry(self, until: float) -> None:
        """Let what is due come, up to a time."""
        while self._under_way and self._under_way[0][0] <= until:
            due, _, act = heappop(self._under_way)
            self.now = max(self.now, due)
            act()
        self.now = max(self.now, until)


class NetSession:
    """What umo uses of `zenoh.Session`."""

    def __init__(self, net: Net) -> None:
        self._net = net

    def declare_publisher(self, key: str, **more: Any) -> Any:
        del more
        return SimpleNamespace(put=lambda data: self.put(key, data), undeclare=lambda: None)

    def put(self, key: str, data: bytes | str) -> None:
        payload = data.encode() if isinstance(data, str) else data
        sample = SimpleNamespace(key_expr=key, payload=payload)

        def deliver() -> None:
            for pattern, taker in list(self._net.subscribers):
                if fnmatchcase(key, pattern):
                    taker(sample)

        self._net.send(deliver)

    def declare_subscriber(self, key: str, taker: Callable[[Any], object]) -> Any:
        return _declared(self._net.subscribers, key, taker)

    def declare_queryable(self, key: str, answer: Callable[[Any], object]) -> Any:
        return _declared(self._net.queryables, key, answer)

    def liveliness(self) -> Any:
        return SimpleNamespace(declare_token=lambda key: SimpleNamespace(undeclare=lambda: None))

    def get(
        self, selector: Any, handler: Any = None, *, timeout: float, payload: str | None = None, **more: Any
    ) -> Iterator[Any]:
        """Each answer as it comes; none with a handler, which is given them."""
        del more
        net, replies = self._net, list[Any]()
        waits = _Waits(net, replies.append if handler is None else handler.callback, timeout)
        waits.ended = (lambda: None) if handler is None else handler.drop
        key = str(getattr(selector, "key_expr", selector))
        data = None if payload is None else payload.encode()
        for pattern, answer in list(net.queryables):
            if fnmatchcase(key, pattern):
                waits.open += 1
                query = NetQuery(net, key, dict(getattr(selector, "parameters", {}) or {}), data, waits)
                net.send(lambda query=query, answer=answer: answer(query.again()))  # type: ignore[misc]
        return self._coming(replies, waits) if handler is None else iter(())

    def _coming(self, replies: list[Any], waits: _Waits) -> Iterator[Any]:
        while replies or not waits.is_over:
            if replies:
                yield replies.pop(0)
            else:
                self._net.advance(self._net.now + 0.01)

    def close(self) -> None: ...


class _Waits:
    """Who waits for the answers to one query: up to their end, or to the time."""

    def __init__(self, net: Net, taker: Callable[[Any], object], timeout: float) -> None:
        self._taker = taker
        self.open = 0
        self.is_over = False
        self.ended: Callable[[], object]
        net.at(net.now + timeout, self.end)

    def take(self, reply: Any) -> None:
        if not self.is_over:
            self._taker(reply)

    def close_one(self) -> None:
        self.open -= 1
        if self.open == 0:
            self.end()

    def end(self) -> None:
        if not self.is_over:
            self.is_over = True
            self.ended()


class NetQuery:
    """A query as who answers sees it."""

    def __init__(self, net: Net, key: str, parameters: dict[str, str], payload: bytes | None, waits: _Waits) -> None:
        self._net, self.key_expr, self.parameters, self.payload, self._waits = net, key, parameters, payload, waits

    def again(self) -> NetQuery:
        """For one delivery of it."""
        return NetQuery(self._net, self.key_expr, self.parameters, self.payload, self._waits)

    def reply(self, key: str, payload: bytes | str) -> None:
        del key
        data = payload.encode() if isinstance(payload, str) else payload
        reply = SimpleNamespace(ok=SimpleNamespace(payload=data))
        self._net.send(lambda: self._waits.take(reply))

    def drop(self) -> None:
        self._net.send(self._waits.close_one)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()


def _declared(among: list[Any], key: str, function: Any) -> Any:
    entry = key, function
    among.append(entry)
    return SimpleNamespace(undeclare=lambda: among.remove(entry) if entry in among else None)


class _Queue:
    """A queue that nobody waits at."""

    def __init__(self) -> None:
        self._items: list[Any] = []

    def put(self, each: Any) -> None:
        self._items.append(each)

    def get(self, timeout: float = 0.0) -> Any:
        if not self._items:
            raise Empty
        return self._items.pop(0)

    def __len__(self) -> int:
        return len(self._items)


@contextmanager
def virtual_fleet(net: Net) -> Iterator[None]:
    """The network's clock in place of the computer's; no thread begins."""
    clock = SimpleNamespace(
        monotonic=lambda: net.now, monotonic_ns=lambda: round(net.now * 1e9), time=lambda: 1e9 + net.now
    )
    thread = SimpleNamespace(
        Thread=lambda **more: SimpleNamespace(start=lambda: None, join=lambda wait: None, is_alive=lambda: False),
        Event=lambda: _Flag(), current_thread=lambda: None, Lock=_no_lock,
    )  # fmt: skip
    patches: list[Any] = [patch(f"umo.clients.fleet.{each}.time", clock) for each in MODULES]
    patches += [
        patch("umo.clients.fleet.fleet_mirror.threading", thread),
        patch("umo.clients.fleet.fleet_mirror.queue", SimpleNamespace(SimpleQueue=_Queue, Empty=Empty)),
        patch("umo.clients.fleet.station_publisher.MAX_DELTAS", KEPT),
        patch("umo.clients.fleet.station_publisher.KEPT", 0.0),
        patch("umo.clients.fleet.fleet_mirror.utc", lambda: (10**18, 0)),
    ]
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


class _Flag:
    def __init__(self) -> None:
        self._is_set = False

    def set(self) -> None:
        self._is_set = True

    def is_set(self) -> bool:
        return self._is_set


def _no_lock() -> Any:
    raise AssertionError("the mirror itself has no lock")

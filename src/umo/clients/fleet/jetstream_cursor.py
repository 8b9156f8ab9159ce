"""The progress of publishing a run to a JetStream, and the data that are still to be sent."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from math import inf
from typing import Any, NamedTuple

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.jetstream_server import FIRST, REFRESH, subject
from umo.clients.fleet.run_words import peek
from umo.clients.fleet.station_publisher import StationPublisher
from umo.errors import UmoError

MOST_EVENTS = 100
"""Largest number of events of one message."""


class OutgoingMessage(NamedTuple):
    """A message for the stream. `next`: the number after the last one in the message."""

    kind: str
    subject: str
    data: bytes
    headers: dict[str, str]
    next: float


class JetStreamCursor:
    """The progress of one run. The thread that sends calls `messages`, `confirm` and `skip`; the thread of the gateway
    calls `end`."""

    def __init__(self, publisher: StationPublisher) -> None:
        self.publisher, self.key = publisher, publisher.key
        self._run = publisher.run.hex()
        self._declaration = publisher.described()
        self._declare_at = -inf
        self._delta: int | None = None
        self._event: int | None = None
        """Numbers of the next delta and of the next event that the server has not confirmed; None before the first one
        is sent."""
        self._lost = {keys.DELTA: 0, keys.EVENT: 0}
        self._lock = threading.Lock()
        self.has_ended = False
        self._last_events: list[list[Any]] = []
        self.is_done = False

    def end(self) -> None:
        """Take the remaining events, because the reader is about to be closed."""
        with self._lock:
            if not self.has_ended:
                self._last_events = self._new_events()
                self.has_ended = True

    def messages(self, now: float) -> Iterator[OutgoingMessage]:
        """Return the messages to send now, in their order, and only a part of them if there are many. All earlier
        messages must be confirmed or given up."""
        with self._lock:
            has_ended = self.has_ended
        declarations = [self._declare(now)] if now >= self._declare_at else []
        found = [*declarations, *self._events(), *self._deltas()]
        self.is_done = has_ended and not found
        return iter(found)

    def _declare(self, now: float) -> OutgoingMessage:
        to = subject(*self.key, keys.DECLARATION, self._run)
        return OutgoingMessage(keys.DECLARATION, to, self._declaration, {}, now + REFRESH)

    def _new_events(self) -> list[list[Any]]:
        if self.publisher.reader.now().next_event <= (self._event or 0):
            return []
        try:
            events = self.publisher.reader.events(self._event or 0)
        except (UmoError, ValueError, OSError):  # a damaged ring
            return []
        return [[each.number, *each.event] for each in events]

    def _events(self) -> list[OutgoingMessage]:
        with self._lock:
            told = self._last_events if self.has_ended else self._new_events()
        told = [each for each in told if each[0] >= (self._event or 0)][:MOST_EVENTS]
        if not told:
            return []
        first, last = told[0][0], told[-1][0]
        if self._event is not None and first > self._event:
            self._lost[keys.EVENT] += first - self._event
            self._event = first
        data = json.dumps({"run": self._run, "events": told}).encode()
        headers = {"Nats-Msg-Id": f"{self._run}/events/{first}-{last}"}
        return [OutgoingMessage(keys.EVENT, subject(*self.key, keys.EVENT), data, headers, last + 1)]

    def _deltas(self) -> list[OutgoingMessage]:
        _, deltas = self.publisher.kept.since(self._delta or 0)
        if not deltas:
            return []
        first = peek(deltas[0]).number
        if self._delta is not None and first > self._delta:
            self._lost[keys.DELTA] += first - self._delta
        self._delta = first
        to = subject(*self.key, keys.DELTA)
        return [
            OutgoingMessage(
                keys.DELTA, to, data, {"Nats-Msg-Id": f"{self._run}/{number}", FIRST: str(first)}, number + 1
            )
            for data in deltas
            for number in (peek(data).number,)
        ]

    def confirm(self, message: OutgoingMessage) -> None:
        """Record that the server has confirmed a message."""
        if message.kind == keys.DELTA:
            self._delta = int(message.next)
        elif message.kind == keys.EVENT:
            self._event = int(message.next)
        else:
            self._declare_at = message.next

    def skip(self, message: OutgoingMessage) -> None:
        """Skip a message that cannot be sent."""
        if message.kind == keys.DELTA:
            self._lost[keys.DELTA] += 1
        elif message.kind == keys.EVENT:
            self._lost[keys.EVENT] += len(json.loads(message.data)["events"])
        self.confirm(message)

    def take_lost(self) -> tuple[int, int]:
        """Return the numbers of deltas and events lost since the last call."""
        found = self._lost[keys.DELTA], self._lost[keys.EVENT]
        self._lost = dict.fromkeys(self._lost, 0)
        return found

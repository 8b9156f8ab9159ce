"""Queries gateways for published data that did not arrive (`umo.clients.fleet.run_feed`)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.run_feed import Missing

MAX_CONCURRENT_QUERIES = 8
"""Largest number of queries of one process that wait for their answers; answers to more queries would be dropped by the
network."""
WAIT = 2.0
"""Longest time in s to wait for an answer."""


class PastQueries:
    """The queries of one process. A thread of Zenoh calls `put` with each answer, its station and its run."""

    def __init__(self, session: zenoh.Session, put: Callable[[StationKey, bytes, bytes], None]) -> None:
        self._session, self._put = session, put
        self._lock = threading.Lock()
        self._waiting = 0

    @property
    def are_too_many(self) -> bool:
        return self._waiting >= MAX_CONCURRENT_QUERIES

    def ask(self, key: StationKey, missing: Missing) -> None:
        """Send a request to the gateway of a station. Without a network no answer will arrive."""

        def replied(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._put(key, missing.run, bytes(reply.ok.payload))

        def done() -> None:
            with self._lock:
                self._waiting -= 1

        parameters = {"run": missing.run.hex(), "delta": str(missing.delta), "event": str(missing.event)}
        with self._lock:
            self._waiting += 1
        with suppress(zenoh.ZError):
            self._session.get(
                zenoh.Selector(key.key(keys.PAST), parameters),
                zenoh.handlers.Callback(replied, done),
                timeout=WAIT,
                congestion_control=zenoh.CongestionControl.DROP,
                consolidation=zenoh.ConsolidationMode.NONE,
            )

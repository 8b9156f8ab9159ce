"""Lists the stations of a fleet, with their status, for lists and tables."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey

DEBOUNCE = 0.5
"""Time in s from the loss of a station's token until it counts as away. The delay is necessary because all tokens are
lost for a short time when a router restarts."""
MAX_STATIONS = 10_000
ASKED_ONE_BY_ONE = 20
"""Largest number of new stations that are queried for their status one by one. If more appear simultaneously, one query
is sent to all."""
ANSWER_TIME = 1.0
"""Time in s within which stations report their status."""


@dataclass
class FleetStation:
    """A station as the fleet sees it."""

    key: StationKey
    status: Mapping[str, Any] = field(default_factory=dict)
    """The last status of the station (`umo.clients.fleet.station_publisher.status_of`), or empty if no status has
    arrived yet."""
    told: float = 0.0
    """Time of the last status, in s of the monotonic clock."""
    lost: float | None = None
    """Time at which the token of the station was lost; None while the token exists."""

    def is_present(self, now: float) -> bool:
        return self.lost is None or now - self.lost < DEBOUNCE

    @property
    def state(self) -> str:
        return str(self.status.get("state", ""))


class FleetPresence:
    """Follows the stations of a fleet. Its updates come from a thread of Zenoh; `stations` is a copy."""

    def __init__(self, session: zenoh.Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._clock = session, clock
        self._lock = threading.Lock()
        self._found: dict[StationKey, FleetStation] = {}
        self._come: set[StationKey] = set()
        """Stations that have appeared and were not queried for their status yet."""
        self._statuses = session.declare_subscriber(keys.EVERY.key(keys.STATUS), self._told)
        self._tokens = session.liveliness().declare_subscriber(keys.EVERY.key(keys.ALIVE), self._changed, history=True)

    def _changed(self, sample: zenoh.Sample) -> None:
        """Record that the token of a station has appeared or disappeared."""
        key, comes = keys.station_of(str(sample.key_expr)), sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            station = self._found.get(key)
            if station is None and comes and len(self._found) < MAX_STATIONS:
                station = self._found[key] = FleetStation(key)
            if station is not None:
                station.lost = None if comes else self._clock()
                if comes:
                    self._come.add(key)

    def _ask(self) -> None:
        """Query the stations that have appeared for their status."""
        with self._lock:
            come, self._come = self._come, set()
        for key in come if len(come) <= ASKED_ONE_BY_ONE else (keys.EVERY,):
            self._session.get(key.key(keys.STATUS), zenoh.handlers.Callback(self._replied), timeout=ANSWER_TIME)

    def _replied(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._told(reply.ok)

    def _told(self, sample: zenoh.Sample) -> None:
        if (status := status_in(bytes(sample.payload))) is None:
            return
        with self._lock:
            station = self._found.get(keys.station_of(str(sample.key_expr)))
            if station is not None:
                station.status, station.told = status, self._clock()

    def stations(self) -> list[FleetStation]:
        """Return all known stations by name, except those that have ended and are away. New stations are queried for
        their status."""
        self._ask()
        now = self._clock()
        with self._lock:
            over = [key for key, each in self._found.items() if each.state == "ended" and not each.is_present(now)]
            for key in over:
                del self._found[key]
            return [FleetStation(**vars(each)) for _, each in sorted(self._found.items())]

    def close(self) -> None:
        undeclared: list[Any] = [self._tokens, self._statuses]
        for each in undeclared:
            each.undeclare()


def status_in(data: bytes) -> dict[str, Any] | None:
    """Return the status in a message, or None if it has none."""
    try:
        status = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return status if isinstance(status, dict) and isinstance(status.get("station"), str) else None


def statuses(session: zenoh.Session, timeout: float = ANSWER_TIME) -> dict[StationKey, dict[str, Any]]:
    """Return the present status of each station."""
    found: dict[StationKey, dict[str, Any]] = {}
    for reply in session.get(keys.EVERY.key(keys.STATUS), timeout=timeout):
        if reply.ok is not None and (status := status_in(bytes(reply.ok.payload))) is not None:
            found[keys.station_of(str(reply.ok.key_expr))] = status
    return dict(sorted(found.items()))

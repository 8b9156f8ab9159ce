"""The stations of a fleet on the page: a table of all stations, and a mirror of each station that a page shows."""

from __future__ import annotations

import json
import time
from typing import Any

from umo.clients.fleet import fleet_settings
from umo.clients.fleet.fleet_keys import TWIN, station_key
from umo.clients.fleet.fleet_mirror import answer_of, find
from umo.clients.fleet.fleet_presence import FleetPresence, FleetStation
from umo.clients.fleet.fleet_session import opened_client
from umo.clients.page.watched_run import Watched
from umo.text import printable

UNSEEN_TIME = 10.0
"""Time in s after which a mirror that no page shows is closed."""


class FleetFeed:
    """The connection of the page to the fleet. Raises UmoError if the fleet cannot be reached, or the settings are
    wrong."""

    def __init__(self) -> None:
        self._settings = fleet_settings.load()
        self._session = opened_client(self._settings.network)
        self._presence = FleetPresence(self._session)
        self._unseen: dict[str, float] = {}

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each station."""
        now = time.monotonic()
        return [_row(station, now) for station in self._presence.stations()]

    def watched(self, name: str) -> Watched:
        """Return a mirror of a station, which may take some seconds. Raises FramesError if the station does not
        answer."""
        reader = find(name, self._settings)
        reader.skip_older_half()
        return Watched(reader)

    def twin(self, name: str) -> dict[str, Any] | None:
        """Return the description of a station's twin, or the error in its declaration as `error`, or None if the
        station declares no twin. Raises FramesError if the station does not answer."""
        found = json.loads(answer_of(self._session, station_key(name), TWIN))
        return found if isinstance(found, dict) else None

    def is_unseen(self, watched: Watched) -> bool:
        """True if no page has shown this mirror for some time."""
        now = time.monotonic()
        if watched.viewers:
            self._unseen.pop(watched.name, None)
            return False
        is_unseen = now - self._unseen.setdefault(watched.name, now) > UNSEEN_TIME
        if is_unseen:  # it is closed; one that is opened again begins anew
            del self._unseen[watched.name]
        return is_unseen

    def close(self) -> None:
        self._presence.close()
        closing: Any = self._session
        closing.close()


def _row(station: FleetStation, now: float) -> dict[str, Any]:
    status, present = station.status, station.is_present(now)
    faults = status.get("faults") or {}
    return {
        "name": str(station.key),
        "wiring": printable(str(status.get("wiring", ""))),
        "present": present,
        "state": printable(station.state) if present else "away",
        "mode": status.get("mode") or "",
        "lease": printable(str(status.get("lease", ""))),
        "missed": int(status.get("missed", 0)),
        "alarms": int(status.get("alarms", 0)),
        "alarm": printable(str(status.get("text", ""))),
        "faults": [printable(path) for path in faults],
        "progress": printable(str(status.get("progress", ""))),
    }

"""The station that a test is about."""

from __future__ import annotations

from pathlib import Path

from umo.process.station import Station, find
from umo.system.packages import station_of


def station(place: Path | str) -> Station:
    """The station in a folder, the shipped one of this name, or the one that a test belongs to: `station(__file__)`,
    where the test is in the station's folder or in one below it. Raises StationError if there is none. The result has
    `machine()`, `main`, `wirings` and `load("control")`: its own classes.
    """
    path = Path(place)
    return find((station_of(path) if path.is_file() else None) or place)

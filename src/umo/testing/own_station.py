"""Finds the station that a test belongs to."""

from __future__ import annotations

from pathlib import Path

from umo.process.station import Station, find
from umo.system.packages import station_of


def station(place: Path | str) -> Station:
    """Return the station in a folder, the shipped station with this name, or the station that a test belongs to:
    `station(__file__)`, if the test is in the station's folder or in a folder below it. Raises StationError if there is
    no such station. The result has `machine()`, `main`, `wirings`, and `load("control")`, which returns the station's
    module with its classes.
    """
    path = Path(place)
    return find((station_of(path) if path.is_file() else None) or place)

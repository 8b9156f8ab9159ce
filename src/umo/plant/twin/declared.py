"""The twin of a running station."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from umo.objects import Compound
from umo.plant.twin.twin import Twin
from umo.process.frames.layout import Layout
from umo.process.station import Station, StationError, find
from umo.system.packages import MARK
from umo.text import did_you_mean
from umo.user_code import raise_as
from umo.wiring.parameters import arguments_for


def twin_of(layout: Layout, place: Path) -> dict[str, Any] | None:
    """Return the description of the twin that twin.py of a station declares for its machine; None if there is none.

    The description of the station's frames contains the options of the machine. `place`: the station's folder; for a
    running station, the folder that its run names. Raises StationError if twin.py cannot be imported or fails,
    DeclarationError if the twin does not fit the machine.
    """
    if not declares_twin(place):  # or a machine and an application given as functions
        return None
    station = find(place)
    options = arguments_for(station.make, "machine", layout.about.get("options", {}))
    declared = declared_by(station, station.machine(**options))
    return None if declared is None else declared.describe(layout)


def place_of(layout: Layout) -> Path:
    """Return the folder that a running station names. If it names none, return a folder that does not exist."""
    return Path(layout.about.get("place") or "-")


def declares_twin(place: Path) -> bool:
    """Return True if the folder of a station has a twin.py. Its code is not run."""
    return (place / MARK).is_file() and (place / "twin.py").is_file()


def declared_by(station: Station, machine: Compound | None = None) -> Twin | None:
    """Return the result of `twin(machine)` in twin.py of a station, for this machine, or for a machine without options;
    None if there is no such file."""
    module = station.module("twin")
    if module is None:
        return None
    file, make = station.path / "twin.py", getattr(module, "twin", None)
    if not callable(make):
        raise StationError(f"{file} has no twin(){did_you_mean('twin', vars(module))}")
    machine = station.machine() if machine is None else machine
    with raise_as(StationError, f"twin() of {file} failed"):
        twin = make(machine)
    if not isinstance(twin, Twin):
        raise StationError(f"twin() of {file} returned {twin!r}, not a Twin")
    return twin

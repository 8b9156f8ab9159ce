"""The station that the argument STATION of a command means, if the command only reads the station's folder."""

from __future__ import annotations

from pathlib import Path

from umo.errors import FramesError
from umo.process.frames.search import meant_by, several_runs
from umo.process.station import Station, StationError, find
from umo.system.packages import MARK
from umo_command.show.stations import readers


def station_named(name: str) -> Station:
    """Return the station in this folder, or with this name (`find`). If there is none, return the running station with
    this name or pid, whose folder is known from its run. Raises StationError if there is none, or if the run has no
    folder, and FramesError if runs from several folders have this name.

    Commands that open devices or start a run use `find`: they are not for a station that runs already.
    """
    try:
        return find(name)
    except StationError:
        found = readers()
        fitting = meant_by(name, found)
        for reader in found:
            reader.close()
        places = {str(reader.about["place"]) for reader in fitting}
        if not places:
            raise
        if len(places) > 1:
            raise FramesError(several_runs(name, fitting)) from None
        (place,) = places
        if not place or not (Path(place) / MARK).is_file():
            raise StationError(
                f"{name} is running (pid {fitting[0].about['pid']}), but its run names no folder of a station, which "
                f"this command needs: give the folder"
            ) from None
        return find(place)

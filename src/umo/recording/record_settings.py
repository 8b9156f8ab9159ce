"""The settings of a recorder for the stored data and the files: the table `[record]` of a wiring, and the options of
the command line that override it.

[record]
last = "10 min"      # a flight recorder: saved when the run fails, or on demand
rotate = "1 h"       # a new file after this time of the run
size = "1 GB"        # a new file at this size
keep = "20 GB"       # files beyond it keep only what replay needs
rate = 100           # messages per second for Foxglove and other tools
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from umo.wiring.settings import a_number, a_size, a_time, changed, settings_of

ROTATE, SIZE = 3600.0, 1 << 30
"""Default time in s, and default size in bytes, after which the next file begins."""
RATE = 100.0
LEAST_SIZE = 10**5


@dataclass(frozen=True)
class RecordSettings:
    """The settings. Times are in s, sizes in bytes."""

    last: Annotated[float | None, a_time(1.0)] = None
    """The time before the end of the run, or before a request, for which a flight recorder keeps all data. None means
    that the whole run is recorded."""
    rotate: Annotated[float, a_time(1.0)] = ROTATE
    size: Annotated[int, a_size(LEAST_SIZE)] = SIZE
    keep: Annotated[int | None, a_size(LEAST_SIZE)] = None
    """Size of the files that keep all data. Older files keep only the data that replay needs. None means that all files
    keep all data."""
    rate: Annotated[float, a_number(0.01, 1e6, "a number of messages a second")] = RATE
    """Number of messages of the machine per second for Foxglove and other tools. Changes of states can add up to as
    many further messages. The data that umo itself reads contain every period."""

    @property
    def plain(self) -> dict[str, Any]:
        return asdict(self)


DEFAULT = RecordSettings()


def record_of(
    table: Mapping[str, Any], file: str = "wiring", changes: Mapping[str, Any] | None = None
) -> RecordSettings:
    """Return the settings in the table `[record]` of a wiring. Settings of the command line override them. Raises
    SettingsError for an error in either."""
    return changed(settings_of(RecordSettings, table, file, "record"), changes, "record")

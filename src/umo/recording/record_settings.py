"""Settings of a recorder, for the kept data and the files: the table `[record]` of a wiring, and what the command line
changes.

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
"""Default time in s and size in bytes of a file after which the next one is begun."""
RATE = 100.0
LEAST_SIZE = 10**5


@dataclass(frozen=True)
class RecordSettings:
    """Times in s, sizes in bytes."""

    last: Annotated[float | None, a_time(1.0)] = None
    """For a flight recorder: time before the end, or before a request, that is kept in full; None means all."""
    rotate: Annotated[float, a_time(1.0)] = ROTATE
    size: Annotated[int, a_size(LEAST_SIZE)] = SIZE
    keep: Annotated[int | None, a_size(LEAST_SIZE)] = None
    """Size of the files that are kept in full; older ones keep only the data that replay needs. None keeps all in
    full."""
    rate: Annotated[float, a_number(0.01, 1e6, "a number of messages a second")] = RATE
    """Messages of the machine per second for Foxglove and other tools, and as many again if states change in between.
    The data that umo itself reads have every period."""

    @property
    def plain(self) -> dict[str, Any]:
        return asdict(self)


DEFAULT = RecordSettings()


def record_of(
    table: Mapping[str, Any], file: str = "wiring", changes: Mapping[str, Any] | None = None
) -> RecordSettings:
    """Return the settings of the table `[record]` of a wiring, overridden by those of a command line. Raises
    SettingsError for a mistake in either."""
    return changed(settings_of(RecordSettings, table, file, "record"), changes, "record")

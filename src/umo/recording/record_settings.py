"""What a recorder keeps, in which files: the table `[record]` of a wiring, and what the command line changes.

[record]
last = "10 min"      # a flight recorder: saved when the run fails, or on demand
rotate = "1 h"       # a new file after this time of the run
size = "1 GB"        # a new file at this size
keep = "20 GB"       # files beyond it keep only what replay needs
rate = 100           # messages a second for other people's tools
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from umo.byte_size import byte_size
from umo.duration import seconds
from umo.errors import DeclarationError, OptionError
from umo.text import did_you_mean

ROTATE, SIZE = 3600.0, 1 << 30
"""s and bytes of a file, after which the next one is begun."""
RATE = 100.0
LEAST_SIZE = 10**5


@dataclass(frozen=True)
class RecordSettings:
    """Times in s, sizes in bytes."""

    last: float | None = None
    """Flight recorder: how much before the end, or before a demand, is kept in full; None: all."""
    rotate: float = ROTATE
    size: int = SIZE
    keep: int | None = None
    """Size of the files that are kept in full; older ones keep only what replay needs. None: all are."""
    rate: float = RATE
    """Messages of the machine a second for other people's tools; as many again where states change in between. What umo
    itself reads has every period."""

    @property
    def plain(self) -> dict[str, Any]:
        return asdict(self)


DEFAULT = RecordSettings()


def settings_of(table: Mapping[str, Any], before: RecordSettings = DEFAULT) -> RecordSettings:
    """The settings with what a table changes: durations and sizes as texts or numbers. OptionError for a mistake."""
    keys = list(before.plain)
    for key in table:
        if key not in keys:
            raise OptionError(f"record: there is no {key!r}{did_you_mean(key, keys)}: {', '.join(keys)}")
    changes: dict[str, Any] = {key: _time(key, table[key]) for key in ("last", "rotate") if table.get(key) is not None}
    changes |= {key: _size(key, table[key]) for key in ("size", "keep") if table.get(key) is not None}
    if (rate := table.get("rate")) is not None:
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0.01 <= rate <= 1e6:
            raise OptionError(f"record: rate: {rate!r} is not a number of messages a second from 0.01 to 1000000")
        changes["rate"] = float(rate)
    return replace(before, **changes)


def _time(key: str, value: Any) -> float:
    try:
        time = seconds(value)
    except DeclarationError as error:
        raise OptionError(f"record: {key}: {error}") from None
    if time < 1.0:
        raise OptionError(f"record: {key}: {value!r} is less than 1 s")
    return time


def _size(key: str, value: Any) -> int:
    try:
        return byte_size(value, LEAST_SIZE)
    except DeclarationError as error:
        raise OptionError(f"record: {key}: {error}") from None

"""The quality of a value, as in OPC and BACnet."""

from collections.abc import Iterator, Sequence
from enum import IntEnum
from itertools import repeat
from typing import Any


class Quality(IntEnum):
    """The degree to which a value can be trusted. Control laws accept GOOD and STALE. They accept other qualities only
    if the call names them."""

    GOOD = 0
    OUT_OF_RANGE = 1
    """The value is outside the range by more than half a resolution."""
    UNREFERENCED = 2
    """The sensor is incremental, and homing has not called `referenced()` yet."""
    STALE = 3
    """The device failed; this is the last value, not older than `max_age`. For an actuator this is the last value that
    the device confirmed; another value may be pending."""
    BAD = 4
    """The device failed; do not use the value."""

    def __str__(self) -> str:
        return self.name


QUALITIES = tuple(Quality)
"""The qualities, by their numbers. A lookup here takes a fifth of the time of `Quality(number)`."""
NOT_GOOD = "not_good"
"""The name of the column of a table in which each row names its values that are not GOOD."""


def told_not_good(paths: Sequence[str], qualities: Any) -> Iterator[str]:
    """Return a text for each row of `qualities`, an array of their numbers with a column for each path: the values that
    are not GOOD, such as `level=STALE flow=BAD`; "" if all are GOOD. Other numbers, as in a damaged file, are BAD."""
    if not qualities.any():
        return repeat("", len(qualities))
    return (
        " ".join(f"{paths[place]}={QUALITIES[min(row[place], Quality.BAD)]}" for place in row.nonzero()[0])
        for row in qualities
    )


def is_good(told: str, path: str) -> bool:
    """Return True if such a text does not name this path."""
    return not any(each.startswith(f"{path}=") for each in told.split())

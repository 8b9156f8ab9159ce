"""The quality of a value, as in OPC and BACnet."""

from enum import IntEnum


class Quality(IntEnum):
    """How far a value can be trusted. Control laws accept GOOD and STALE; the others only if the call accepts them
    explicitly."""

    GOOD = 0
    OUT_OF_RANGE = 1
    """The value is outside the range by more than half a resolution."""
    UNREFERENCED = 2
    """An incremental sensor before homing has called `referenced()`."""
    STALE = 3
    """The device failed; this is the last value, not older than `max_age`. For an actuator: the last value that the
    device confirmed; another one may be pending."""
    BAD = 4
    """The device failed; do not use the value."""

    def __str__(self) -> str:
        return self.name


QUALITIES = tuple(Quality)
"""The quality with each number. A lookup here takes a fifth of the time of `Quality(number)`."""

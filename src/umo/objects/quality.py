"""The quality of a value, as in OPC and BACnet."""

from enum import IntEnum


class Quality(IntEnum):
    """How far a value can be trusted. Control laws accept GOOD and STALE; they accept other qualities only if the call
    names these."""

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
"""The quality with each number. A lookup here takes a fifth of the time of `Quality(number)`."""

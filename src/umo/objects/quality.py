"""The quality of a value, as in OPC and BACnet."""

from enum import IntEnum


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

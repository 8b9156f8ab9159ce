"""The quality of a value, as OPC and BACnet know it."""

from enum import IntEnum


class Quality(IntEnum):
    """What a value is worth. GOOD and STALE feed control laws, the others only where a call accepts them."""

    GOOD = 0
    OUT_OF_RANGE = 1
    """More than half a resolution beyond a bound."""
    UNREFERENCED = 2
    """An incremental sensor before homing has called `referenced()`."""
    STALE = 3
    """The device failed; this is the last value, still younger than `max_age`."""
    BAD = 4
    """The device failed; the value is not to be used."""

    def __str__(self) -> str:
        return self.name

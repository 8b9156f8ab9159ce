"""Computes the age of a station's data on arrival."""

from __future__ import annotations

import time


class ArrivalAges:
    """Computes ages from the monotonic clocks of both computers. The difference of these clocks is not known, and UTC
    may be wrong. What is known are limits of the difference: data cannot arrive before it was made, and data that was
    asked for is not older than a known age. The ages are the greatest that these limits permit."""

    def __init__(self) -> None:
        self._difference: int | None = None
        """The smallest possible difference in ns of this computer's clock to that of the station."""

    def know(self, made: int, earliest: int) -> None:
        """Take as known that data made at `made`, in ns of the station's clock, was made at `earliest` or later, in ns
        of this computer's clock. This replaces what was known before: the clock of a computer stands still while the
        computer sleeps."""
        self._difference = earliest - made

    def age(self, made: int, now: int | None = None) -> float:
        """Return the greatest possible age in s of data made at `made`, in ns of the station's clock. Without a call of
        `know` it is infinite. `now` is in ns of this computer's clock; default: the present time."""
        now = time.monotonic_ns() if now is None else now
        if self._difference is None:
            return float("inf")
        self._difference = min(self._difference, now - made)
        return (now - made - self._difference) * 1e-9

"""Computes the age of a station's data on arrival."""

from __future__ import annotations

import time

WINDOW = 30_000_000_000
"""Length in ns of a window in which the quickest arrival is searched. Only the last two windows are used, because the
clocks of a computer that slept have shifted."""


class ArrivalAges:
    """Computes ages from the monotonic clocks of both computers, relative to the quickest arrival so far. This is
    necessary because the difference of the clocks is not known, and UTC may be wrong."""

    def __init__(self) -> None:
        self._quickest: int | None = None
        self._before: int | None = None
        self._since = 0

    def age(self, made: int, now: int | None = None) -> float:
        """Return the age in s of data made at `made`, in ns of the station's clock. `now` is in ns of this computer's
        clock; default: the present time."""
        now = time.monotonic_ns() if now is None else now
        way = now - made
        if self._quickest is None or now - self._since > WINDOW:
            self._before, self._quickest, self._since = self._quickest, way, now
        self._quickest = min(self._quickest, way)
        floor = self._quickest if self._before is None else min(self._quickest, self._before)
        return (way - floor) * 1e-9

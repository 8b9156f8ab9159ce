"""A plant in wall-clock time: its drivers are opened and advanced with a clock. This module has no network and no
registers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from umo.cycle.segments import DriverSegments
from umo.cycle.transfer import Transfer
from umo.drivers.contract import Direction
from umo.errors import DriverError, Failure, text_of
from umo.wiring import Wired

MAX_PERIODS = 20
"""The largest number of periods of the plant that are carried out in succession. After them, waiting requests are
answered."""
MAX_LAG = 1000
"""Largest number of periods by which the plant may be late. If it is later than that, the missed periods are
skipped."""


class Pace:
    """A count of the periods of the plant that are due, on a time grid that begins at `start`."""

    def __init__(self, period: float, start: float) -> None:
        self._period = period
        self._start = start
        self._passed = 0
        self.given_up = 0

    def due(self, now: float) -> int:
        """Take the periods that have passed, at most `MAX_PERIODS`."""
        passed = int((now - self._start) / self._period) - self._passed
        if passed > MAX_LAG:
            self.given_up += passed - MAX_PERIODS
            self._passed += passed - MAX_PERIODS
            passed = MAX_PERIODS
        due = max(0, min(passed, MAX_PERIODS))
        self._passed += due
        return due

    def left(self, now: float) -> float:
        """Return the time in s until the next period is due; 0 if it is already due."""
        return max(0.0, self._start + (self._passed + 1) * self._period - now)


class Simulation:
    """The drivers of a simulated wiring. `with simulation:` opens them, with all outputs at their defaults; from then
    on time passes. For each period that passes on `clock` (s), the timer's channel is read once.

    Slots are indexes of `wired.wires`. Raises DriverError if a driver cannot be opened or closed.
    """

    def __init__(self, wired: Wired, clock: Callable[[], float]) -> None:
        timer = wired.timer_wire
        assert timer is not None
        assert wired.period is not None
        self.clock = clock
        self.pace = Pace(wired.period, clock())
        self.failure: Exception | None = None
        """The exception that the plant raised while time passed, or an error in its code. After that the plant cannot
        continue."""
        self._wired = wired
        self._timer = wired.wires.index(timer)
        if wired.injection is not None:
            wired.injection.clock = self
        self._transfer = Transfer(wired.wires, wired, self._timer)
        self._segments = DriverSegments(self._transfer, wired)
        self._transfer.bind((), ())
        self._periods = 0
        self._opened: list[str] = []
        self._initialized: list[int] = []

    @property
    def now(self) -> float:
        """The time of the plant in s, for injected faults."""
        return self._periods * (self._wired.period or 0.0)

    def __enter__(self) -> Simulation:
        try:
            for name in self._wired.drivers:
                self._opened.append(name)
                self._segments.open(name)
            for slot in range(len(self._wired.wires)):
                self._initialized.append(slot)
                failure = self._segments.initialize(slot)
                if failure is not None:
                    raise DriverError("the plant could not be initialised", [failure])
        except BaseException:
            self._close()
            raise
        self.pace = Pace(self._wired.period or 0.0, self.clock())
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        failures = self._close()
        if failures and kind is None:
            raise DriverError("the plant could not be closed", failures)

    def _close(self) -> list[Failure]:
        """Bring outputs to their defaults, then release everything. Return the failures."""
        segments, wires = self._segments, self._wired.wires
        outputs = [slot for slot in self._initialized if wires[slot].item.direction is Direction.OUTPUT]
        found = [failure for _, failure in segments.bring_to_default(outputs)]
        found += map(segments.finalize, reversed(self._initialized))
        failures = [failure for failure in found if failure is not None]
        for name in reversed(self._opened):
            try:
                segments.close(name)
            except Exception as error:
                failures.append(Failure(f"driver {name}", "-", text_of(error)))
        self._opened, self._initialized = [], []
        return failures

    def catch_up(self) -> None:
        """Carry out the periods that are due by the clock, at most `MAX_PERIODS`. An error of the plant is also stored
        as `failure`."""
        try:
            for _ in range(self.pace.due(self.clock())):
                self._periods += 1
                self._transfer.read(self._timer)
        except Exception as error:
            self.failure = error
            raise

    def read(self, slot: int) -> int:
        """Return the present raw integer of a sensor's channel."""
        return self._transfer.read(slot)

    def write(self, slot: int, raw: int) -> None:
        self._transfer.write(slot, raw)

    def report(self) -> dict[str, Any]:
        """Return the reports of all drivers as one. If a report fails, the reason takes its place."""
        found: dict[str, Any] = {}
        for name in self._opened:
            try:
                found |= self._segments.report(name)
            except Exception as error:
                found[f"the report of {name} failed"] = text_of(error.__cause__ or error)
        return found

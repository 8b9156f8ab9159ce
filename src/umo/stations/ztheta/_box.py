"""The controller box behind the served plant: its registers, its watchdog and its time. No network in here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from umo.drivers.contract import Channel

from ._modbus_server import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionAnswer, answer

MOST_PERIODS = 20
"""Periods of physics in one go; requests are answered in between."""
FAR_BEHIND = 1000
"""More periods behind than this, the box stops catching up and lets them go."""
WRITES = frozenset((5, 6, 15, 16))


@dataclass(frozen=True)
class Point:
    """A channel's place in the register map, and for an output (coil, holding) its level at power-up."""

    table: str
    address: int
    channel: str
    level: int = 0
    words: int = 1

    @property
    def output(self) -> bool:
        return self.table in ("coil", "holding")


C = TypeVar("C", bound=Channel)


class ServedPlant(Protocol[C]):
    """What the box needs of a plant; tests have a smaller one than the station's."""

    period: float

    @property
    def z_um(self) -> float: ...
    @property
    def theta_deg(self) -> float: ...
    def open(self) -> None: ...
    def close(self) -> None: ...
    def channel(self, text: str) -> C: ...
    def initialize(self, channel: C, default: int | None) -> None: ...
    def read(self, channel: C) -> int: ...
    def write(self, channel: C, raw: int) -> None: ...
    def advance(self, periods: int = 1) -> None: ...
    def truth(self) -> Any: ...


class Watchdog:
    """Armed by a write, fed by every request; expires once after `seconds` without one (0: never)."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.drops = 0
        self._armed = False
        self._fed = 0.0

    def feed(self, now: float, *, write: bool) -> None:
        self._fed = now
        self._armed = self._armed or write

    def expired(self, now: float) -> bool:
        """True once: the outputs are to be dropped now."""
        if not self._armed or self.seconds == 0 or now - self._fed < self.seconds:
            return False
        self._armed = False
        self.drops += 1
        return True


class Pace:
    """How many periods of physics are due, on a grid that begins at `start`."""

    def __init__(self, period: float, start: float) -> None:
        self._period = period
        self._start = start
        self._taken = 0
        self.given_up = 0

    def due(self, now: float) -> int:
        """Take the periods that have passed, at most `MOST_PERIODS`."""
        passed = int((now - self._start) / self._period) - self._taken
        if passed > FAR_BEHIND:
            self._give_up(passed - MOST_PERIODS)
            passed = MOST_PERIODS
        take = max(0, min(passed, MOST_PERIODS))
        self._taken += take
        return take

    def left(self, now: float) -> float:
        """Seconds until the next period is due; 0 when it is already."""
        return max(0.0, self._start + (self._taken + 1) * self._period - now)

    def _give_up(self, periods: int) -> None:
        self.given_up += periods
        self._taken += periods


class Box(Generic[C]):
    """The plant behind its registers.

    The physics is brought up to the moment of each request, so that it answers with what is, however coarse
    the timer of the event loop. Reads of outputs give what was written, as the plant's outputs have no way back.
    """

    def __init__(
        self,
        plant: ServedPlant[C],
        points: Sequence[Point],
        *,
        watchdog_register: int,
        watchdog: float,
        period: float,
        clock: Callable[[], float],
    ) -> None:
        self.plant = plant
        self.watchdog = Watchdog(watchdog)
        self.requests = 0
        self.pace = Pace(period, clock())
        self._clock = clock
        self._period = period
        self._watchdog_cell = ("holding", watchdog_register)
        self._outputs = [point for point in points if point.output]
        self._channels = {point: plant.channel(point.channel) for point in points}
        self._levels = {point: point.level for point in self._outputs}
        self._cells = {
            (point.table, point.address + word): (point, 16 * (point.words - 1 - word))
            for point in points
            for word in range(point.words)
        }

    def power_up(self) -> None:
        """Open the plant with its outputs at their levels; from now on time passes."""
        self.plant.period = self._period
        self.plant.open()
        for point in self._outputs:
            self.plant.initialize(self._channels[point], point.level)
        self.pace = Pace(self._period, self._clock())

    def request(self, request: bytes) -> bytes:
        """The answer to one request, both from their function code on."""
        now = self._clock()
        self._step(now)
        self.requests += 1
        self.watchdog.feed(now, write=request[0] in WRITES)
        try:
            return answer(request, self)
        except OSError:  # the plant's own: a DriverError
            return bytes([request[0] | 0x80, DEVICE_FAILURE])

    def turn(self) -> float:
        """Keep pace, and look at the watchdog; returns the seconds until the next period.

        Only here does the watchdog bite. A request that lies waiting is read before the next turn, so a
        slow turn of the box itself is not held against its client.
        """
        now = self._clock()
        self._step(now)
        if self.watchdog.expired(now):
            for point in self._outputs:
                self._set(point, point.level)
        return self.pace.left(self._clock())

    def _step(self, now: float) -> None:
        periods = self.pace.due(now)
        if periods:
            self.plant.advance(periods)

    # The four tables ------------------------------------------------------------------------------

    def read(self, table: str, address: int, count: int) -> list[int]:
        return [self._cell(table, address + i) for i in range(count)]

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """All or nothing: every address and value is looked at before the first is set."""
        if (table, address) == self._watchdog_cell and len(values) == 1:
            self.watchdog.seconds = values[0] / 1000
            return
        points = [self._point(table, address + i)[0] for i in range(len(values))]
        raws = [self._fitting(point, value) for point, value in zip(points, values, strict=True)]
        for point, raw in zip(points, raws, strict=True):
            self._set(point, raw)

    def _cell(self, table: str, address: int) -> int:
        if (table, address) == self._watchdog_cell:
            return min(round(self.watchdog.seconds * 1000), 0xFFFF)
        point, shift = self._point(table, address)
        if point.output:
            return self._levels[point] & 0xFFFF
        return self.plant.read(self._channels[point]) >> shift & 0xFFFF

    def _point(self, table: str, address: int) -> tuple[Point, int]:
        try:
            return self._cells[table, address]
        except KeyError:
            raise ExceptionAnswer(ILLEGAL_ADDRESS) from None

    def _fitting(self, point: Point, value: int) -> int:
        channel = self._channels[point]
        raw = value - (1 << 16) if channel.signed and value >> 15 else value
        if not channel.lowest <= raw <= channel.highest:
            raise ExceptionAnswer(ILLEGAL_VALUE)
        return raw

    def _set(self, point: Point, raw: int) -> None:
        self.plant.write(self._channels[point], raw)
        self._levels[point] = raw

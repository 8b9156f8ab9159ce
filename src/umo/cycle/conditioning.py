"""Conditioning of sensors: rollover of a counter, filter, velocity, debounce.

Conditioning takes place when raw integers are converted to values. It computes with the times of the readings. So it is
correct at any sampling rate, after missed ticks, and for a driver off the cycle. A missing reading changes nothing. The
raw integers stay unchanged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import expm1, isnan

from umo.cycle.columns import Block, Columns
from umo.duration import TIME_TOLERANCE
from umo.objects import Atomic
from umo.objects.scaling import FloatArray
from umo.wiring.wired import Wire


class Conditioner:
    """The conditioning of one sensor."""

    velocity = 0.0
    """The velocity in units per s; 0 before the second reading."""

    def begin(self) -> None:
        """Start again with the next reading, because the circuit was initialised."""

    def count_of(self, raw: int) -> int:
        """Return the raw integer, or the continuous count of a counter that rolls over."""
        return raw

    @property
    def reading(self) -> float | None:
        """The value of the last reading, or None before the first one."""
        return None

    def conditioned(self, value: float, time: float, inside: bool) -> float:
        """Return the conditioned value of a reading at this time in s. A value outside the range is shown
        unfiltered."""
        if inside:
            return self.value_of(value, time)
        self.leave()
        return value

    def value_of(self, value: float, time: float) -> float:
        """Return the conditioned value of a reading within the range. A filter ignores a second reading at the same
        time."""
        return value

    def shift(self, distance: float) -> None:
        """Take into account that the zero offset has changed by this distance."""

    def leave(self) -> None:
        """Leave the range: the reading is shown unfiltered, and the filter starts again with the next reading."""


class NumberConditioner(Conditioner):
    def __init__(self, sensor: Atomic, bits: int) -> None:
        """`bits`: the width of the counter, or 0 if it does not roll over."""
        self._filter, self._velocity_filter = sensor._filter, sensor._velocity
        self._half = 1 << bits >> 1
        self._no_readings()

    def _no_readings(self) -> None:
        self._count: int | None = None
        self.leave()

    def begin(self) -> None:
        self._no_readings()

    def leave(self) -> None:
        self._time: float | None = None
        self._reading: float | None = None
        self.velocity = self._last = self._value = 0.0

    def count_of(self, raw: int) -> int:
        if not self._half:
            return raw
        if self._count is not None:  # by the shortest way
            raw = self._count + (raw - self._count + self._half) % (2 * self._half) - self._half
        self._count = raw
        return raw

    @property
    def reading(self) -> float | None:
        return self._reading

    def value_of(self, value: float, time: float) -> float:
        self._reading = value
        if self._time is None:
            self._time, self._last, self._value = time, value, value
            return value
        dt = time - self._time
        if dt <= 0.0:
            if self._filter is None:
                self._value = value
            return self._value
        if self._velocity_filter is not None:
            self.velocity += _share(dt, self._velocity_filter) * ((value - self._last) / dt - self.velocity)
        if self._filter is None:
            self._value = value
        else:
            self._value += _share(dt, self._filter) * (value - self._value)
        self._time, self._last = time, value
        return self._value

    def shift(self, distance: float) -> None:
        self._last += distance
        self._value += distance
        if self._reading is not None:
            self._reading += distance


class StateConditioner(Conditioner):
    """The debounce of a binary sensor. A change of level is shown once it has lasted from one reading to another
    reading at least `debounce` later. The level between two readings is unknown."""

    def __init__(self, debounce: float) -> None:
        self._debounce = debounce
        self.begin()

    def begin(self) -> None:
        self._level: float | None = None
        self._since: float | None = None

    def value_of(self, value: float, time: float) -> float:
        if self._level is None:
            self._level = value
        elif value == self._level:
            self._since = None
        elif self._since is None:
            self._since = time
        if self._since is not None and time - self._since >= self._debounce - TIME_TOLERANCE:
            self._level, self._since = value, None
        return self._level


def _share(dt: float, time_constant: float) -> float:
    """Return the share of a step that a low pass of the first order passes on in this time; 1 without a time
    constant."""
    return -expm1(-dt / time_constant) if time_constant else 1.0


def conditioner_of(wire: Wire) -> Conditioner | None:
    """Return the conditioner of an object, or None if it has none."""
    item, bits = wire.item, wire.rollover_bits
    if item._debounce is not None:
        return StateConditioner(item._debounce)
    if bits or item._filter is not None or item._velocity is not None:
        return NumberConditioner(item, bits)
    return None


class ConditionedInputs:
    """The conversion of a block with sensors that are conditioned. `refused` is a function that returns whether a raw
    integer means an invalid reading."""

    def __init__(
        self,
        block: Block,
        columns: Columns,
        conditioners: Mapping[int, Conditioner],
        refused: Callable[[int, int], bool],
    ) -> None:
        self._block, self._columns, self._convert = block, columns, block.convert
        self._refused = refused
        self._each = [(slot - block.start, slot, conditioners[slot]) for slot in conditioners]
        self.stamps: FloatArray | None = None
        """The times in s of the readings, NaN before the first reading. None means that the time of the call is the
        time of all readings."""

    def convert(self, now: float) -> Sequence[tuple[int, float]]:
        """Convert the block as `Block.convert` does."""
        view, raws, values = self._block.view, self._columns.raws, self._columns.values
        read = [
            (place, slot, each, raw)
            for place, slot, each in self._each
            if not self._refused(slot, raw := view[place]) and (self.stamps is None or not isnan(self.stamps[place]))
        ]
        for place, _, each, raw in read:
            view[place] = each.count_of(raw)
        try:
            outside = self._convert(now)
        finally:
            for place, slot, _, raw in read:
                view[place] = raws[slot] = raw
        beyond = {slot for slot, _ in outside}
        for place, slot, each, _ in read:
            time = now if self.stamps is None else float(self.stamps[place])
            value = each.conditioned(float(values[slot]), time, slot not in beyond)
            if slot not in beyond:
                values[slot] = value
        return outside

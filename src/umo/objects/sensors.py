"""The two atomic sensors (the paper's Listing 3)."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Literal, TypeAlias, get_args

from umo.drivers.contract import Direction
from umo.duration import seconds
from umo.errors import BadInput, DeclarationError
from umo.objects.atomic import Atomic, Binary, Digital, S
from umo.objects.linearization import Linearization
from umo.objects.quality import Quality
from umo.objects.truth import checked_truth, is_one_of

MIN_COUNTER, MAX_COUNTER = 2, 62
"""Least and greatest number of bits of a counter that rolls over."""
OnError: TypeAlias = Literal["raise", "hold", "mark"]
"""The effect of a failed reading."""


class Sensor(Atomic):
    """The common part of binary and digital sensors."""

    __slots__ = ()

    direction = Direction.INPUT
    _max_age: float | None
    """Time in s for which the last value is held after a failure; None means not at all."""
    _marks: bool
    """True if a failure marks the value BAD and raises no error."""

    def sample(self) -> bool:
        """Read the hardware and keep the value if the sensor is synchronous. Return False if the quality of the value
        is not GOOD."""
        return self._image.sample_some((self._slot,)) if self._synchronous else True


class BinarySensor(Sensor, Binary[S]):
    """One input bit: a switch, a light barrier. EPICS bi, Modbus discrete input, OPC UA TwoState, BACnet BI.

    `debounce`: time in s (or "20 ms") for which the input must differ before the state changes; default: none.
    """

    __slots__ = ("_debounce", "_marks", "_max_age")

    def __init__(
        self,
        states: type[S],
        *,
        one: S,
        synchronous: bool = True,
        on_error: OnError = "raise",
        max_age: str | float | None = None,
        debounce: str | float | None = None,
    ) -> None:
        super().__init__(states, one, synchronous)
        self._debounce = _time("debounce", debounce)
        self._max_age, self._marks = _on_error(on_error, max_age)

    def read(self) -> S:
        """Return the state that the last `sample` has kept; an asynchronous sensor reads the hardware now. Raises
        BadInput for a sensor that was never read (`on_error="mark"`), because it has no state."""
        image = self._image
        level = image.values[self._slot] if self._synchronous else image.read_now(self._slot)
        if not level:
            return self._zero
        if level == 1.0:
            return self._one
        raise BadInput(self.path, Quality.BAD, why="it was never read")


class DigitalSensor(Sensor, Digital):
    """A group of input bits: a counter, an ADC. EPICS ai, Modbus input register, OPC UA AnalogItem, BACnet AI.

    `incremental=True`: the value is UNREFERENCED until homing calls `referenced()`. `linearization`: a `Polynomial`,
    `LookupTable` or `Thermocouple` from the electrical quantity, raw * resolution + zero_offset, to the value; without
    a linearization both are the same. `invalid_raws`: raw values with which the circuit reports an invalid reading,
    such as 0x7FFF for an open thermocouple. Such a reading counts as failed.

    `rollover`: the bits of a counter that starts again at 0 after its highest number, such as 16 for a line encoder;
    True means the bits of its channel. The value changes by the shortest way from one count to the next. So between two
    readings the counter must change by less than half of its range. `filter`: time constant in s (or "20 ms") of a low
    pass of the first order on the value. `velocity`: the sensor also has `sensor.velocity`, the change of the
    unfiltered value per second. It is shown as `PATH.velocity`. The setting is the time constant of the velocity's low
    pass; 0 means no low pass. By default a sensor has no rollover, filter or velocity. `on_error` is the reaction to a
    failed reading. "raise" (default): the quality becomes BAD, and DriverError is raised. "hold": the last value is
    kept for `max_age` (s, or a string such as "50 ms") with the quality STALE, which control laws accept. After
    `max_age` the reaction is that of "raise". "mark": the quality becomes BAD (only after `max_age`, if this is given),
    and no error is raised. Control laws refuse the value, `quality` is BAD, and the other sensors and the run continue.
    `read` then returns the last value, or NaN if there was none. In conditions, such as those of interlocks, therefore
    use `value_of` of `umo.control`, which raises BadInput.
    """

    __slots__ = ("_filter", "_incremental", "_marks", "_max_age", "_velocity")

    def __init__(
        self,
        units: str,
        *,
        minimum: float,
        maximum: float,
        resolution: float,
        zero_offset: float = 0.0,
        synchronous: bool = True,
        incremental: bool = False,
        linearization: Linearization | None = None,
        invalid_raws: Sequence[int] = (),
        on_error: OnError = "raise",
        max_age: str | float | None = None,
        rollover: bool | int = False,
        filter: str | float | None = None,
        velocity: str | float | None = None,
    ) -> None:
        scale = minimum, maximum, resolution, zero_offset
        super().__init__(units, *scale, synchronous, linearization, invalid_raws, checked_rollover(rollover))
        self._incremental = checked_truth("incremental", incremental)
        self._filter, self._velocity = _time("filter", filter), _time("velocity", velocity)
        self._max_age, self._marks = _on_error(on_error, max_age)

    @property
    def incremental(self) -> bool:
        return self._incremental

    def read(self) -> float:
        """Return the value in `units` that the last `sample` has kept; an asynchronous sensor reads the hardware now.
        NaN if the sensor was never read."""
        image = self._image
        value: float = image.values[self._slot] if self._synchronous else image.read_now(self._slot)
        return value

    @property
    def velocity(self) -> float:
        """The change of the value in `units` per s at the last reading; 0 before the second reading. Raises
        DeclarationError for a sensor that is declared without `velocity`."""
        if self._velocity is None:
            raise DeclarationError(
                f'{self.path} is declared without `velocity`; give it a time constant such as "10 ms"'
            )
        return self._image.velocity(self._slot)

    def referenced(self, known: bool = True, *, at: float | None = None) -> None:
        """Mark the value as referenced by homing. With False the reference is lost, and the quality is UNREFERENCED
        again.

        `at` is the true value in `units` of the last reading, for a counter that homing cannot preset. `zero_offset` is
        then changed so that `read`, the range, frames and traces agree with `at`, until the machine is disconnected.
        Raises BadInput if there is no reading, DeclarationError for a sensor with a linearization.
        """
        if not self._incremental:
            raise DeclarationError(f"{self.path} is not declared incremental")
        if at is not None and self.linearization is not None:
            raise DeclarationError(f"{self.path}: referenced(at=...) is for sensors without a linearization")
        if at is not None and not known:
            raise DeclarationError(f"{self.path}: referenced(False) takes no value")
        if at is not None:
            self._image.set_reading(self._slot, self._number(at))
        self._image.set_referenced(self._slot, known)


def checked_rollover(bits: bool | int) -> bool | int:
    """Check the setting `rollover`. Raises DeclarationError unless it is True, False or a number of bits from 2 to
    62."""
    if isinstance(bits, bool) or (isinstance(bits, int) and MIN_COUNTER <= bits <= MAX_COUNTER):
        return bits
    raise DeclarationError(f"rollover={bits!r} is not the number of a counter's bits, {MIN_COUNTER} to {MAX_COUNTER}")


def _time(name: str, duration: str | float | None) -> float | None:
    """Return a setting as a time in s. Raises DeclarationError unless the time is finite and not negative."""
    if duration is None:
        return None
    found = seconds(duration)
    if isinstance(duration, bool) or not 0.0 <= found < inf:
        raise DeclarationError(f'{name}={duration!r} is not a time from 0 on, such as "20 ms"')
    return found


def _on_error(on_error: str, max_age: str | float | None) -> tuple[float | None, bool]:
    """Return two values: the longest time in s for which the last value is held (None: not at all), and whether a
    failure is only marked."""
    if not is_one_of(on_error, get_args(OnError)):
        raise DeclarationError(f"on_error={on_error!r} is none of {', '.join(map(repr, get_args(OnError)))}")
    if on_error == "hold" and max_age is None:
        raise DeclarationError('on_error="hold" needs a max_age')
    if on_error == "raise" and max_age is not None:
        raise DeclarationError('max_age is for on_error="hold" and on_error="mark"')
    return None if max_age is None else seconds(max_age), on_error == "mark"

"""The two atomic sensors (the paper's Listing 3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

from umo.drivers.contract import Direction
from umo.duration import seconds
from umo.errors import BadInput, DeclarationError
from umo.objects.atomic import Atomic, Binary, Digital, S
from umo.objects.linearization import Linearization
from umo.objects.quality import Quality

OnError: TypeAlias = Literal["raise", "hold", "mark"]
"""The effect of a failed reading."""


class Sensor(Atomic):
    """The common part of the two."""

    __slots__ = ()

    direction = Direction.INPUT
    _max_age: float | None
    """Time in s for which the last value is held after a failure; None: not at all."""
    _marks: bool
    """Whether a failure marks the value BAD and raises nothing."""

    def sample(self) -> bool:
        """Synchronous: read the hardware and keep the value; True if its quality is GOOD. Asynchronous: True."""
        return self._image.sample_some((self._slot,)) if self._synchronous else True


class BinarySensor(Sensor, Binary[S]):
    """One input bit: a switch, a light barrier. EPICS bi, Modbus discrete input, OPC UA TwoState, BACnet BI."""

    __slots__ = ("_marks", "_max_age")

    def __init__(
        self,
        states: type[S],
        *,
        one: S,
        synchronous: bool = True,
        on_error: OnError = "raise",
        max_age: str | float | None = None,
    ) -> None:
        super().__init__(states, one, synchronous)
        self._max_age, self._marks = _on_error(on_error, max_age)

    def read(self) -> S:
        """Synchronous: the state kept by the last `sample`. Asynchronous: reads the hardware now. BadInput for a sensor
        that was never read (`on_error="mark"`): it has no state."""
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
    `LookupTable` or `Thermocouple` from the electrical quantity, raw * resolution + zero_offset, to the value; default:
    they are the same. `invalid_raws`: raw values with which the circuit reports an invalid reading, such as 0x7FFF for
    an open thermocouple; such a reading has failed.

    `on_error` is what a failed reading does. "raise" (default): the quality is BAD, DriverError. "hold": the last value
    is kept for `max_age` (s, or a text such as "50 ms") with the quality STALE, which control laws accept; then as
    "raise". "mark": with or without such a `max_age` before it, the quality is BAD, and nothing is raised: control laws
    refuse the value, `quality` tells, the other sensors and the run go on. `read` then returns the last value, NaN if
    there was none: in conditions, such as those of interlocks, use `value_of` of `umo.control`, which raises.
    """

    __slots__ = ("_incremental", "_marks", "_max_age")

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
    ) -> None:
        super().__init__(units, minimum, maximum, resolution, zero_offset, synchronous, linearization, invalid_raws)
        self._incremental = incremental
        self._max_age, self._marks = _on_error(on_error, max_age)

    @property
    def incremental(self) -> bool:
        return self._incremental

    def read(self) -> float:
        """The value in `units`; NaN if it was never read. Synchronous: kept by the last `sample`. Asynchronous: reads
        the hardware now."""
        image = self._image
        value: float = image.values[self._slot] if self._synchronous else image.read_now(self._slot)
        return value

    def referenced(self, known: bool = True, *, at: float | None = None) -> None:
        """Mark the value as referenced by homing. False: the reference is lost, the quality is UNREFERENCED again.

        `at` is the true value in `units` of the last reading, for a counter that homing cannot preset: from now on
        `zero_offset` is such that `read`, the range, frames and traces agree with it. It holds until the machine is
        disconnected. BadInput if there is no reading, DeclarationError for a sensor with a linearization.
        """
        if not self._incremental:
            raise DeclarationError(f"{self.path} is not declared incremental")
        if at is not None and self._linearization is not None:
            raise DeclarationError(f"{self.path}: referenced(at=...) is for sensors without a linearization")
        if at is not None and not known:
            raise DeclarationError(f"{self.path}: referenced(False) takes no value")
        if at is not None:
            self._image.set_reading(self._slot, self._number(at))
        self._image.set_referenced(self._slot, known)


def _on_error(on_error: str, max_age: str | float | None) -> tuple[float | None, bool]:
    """The longest time in s that a last value is held, None: not at all; and whether a failure is only marked."""
    if on_error not in get_args(OnError):
        raise DeclarationError(f"on_error={on_error!r} is none of {', '.join(map(repr, get_args(OnError)))}")
    if on_error == "hold" and max_age is None:
        raise DeclarationError('on_error="hold" needs a max_age')
    if on_error == "raise" and max_age is not None:
        raise DeclarationError('max_age is for on_error="hold" and on_error="mark"')
    return None if max_age is None else seconds(max_age), on_error == "mark"

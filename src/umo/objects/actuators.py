"""The two atomic actuators (the paper's Listing 2)."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Literal, TypeAlias, get_args

from umo.digits import number_text
from umo.drivers.contract import Direction
from umo.duration import duration, seconds
from umo.errors import DeclarationError, RangeError
from umo.objects.atomic import Atomic, Binary, Digital, S, _finite
from umo.objects.claims import Claim
from umo.objects.keywords import declared_reaction
from umo.objects.linearization import Linearization
from umo.objects.presentation.value_text import measure, span
from umo.objects.truth import is_one_of
from umo.states import shown

OnWriteError: TypeAlias = Literal["raise", "retry"]
"""The reaction to a write that the device did not confirm."""


class Actuator(Atomic):
    """The common part of binary and digital actuators."""

    __slots__ = ()

    direction = Direction.OUTPUT
    _expires: float | None
    _when_suspended: Literal["default", "hold"] | None
    _max_age: float | None
    """Time in s for which a value that was not confirmed is sent again; None means not at all."""
    _clamp: bool = False
    """True if a value beyond the range is replaced by the nearest bound."""

    @property
    @abstractmethod
    def default(self) -> Any:
        """The safe value: written on connect, on reset and when the connection ends."""
        raise NotImplementedError

    @property
    def expires(self) -> float | None:
        """Time in s without a write after which the default is sent; None means never."""
        return self._expires

    @property
    def when_suspended(self) -> Literal["default", "hold"]:
        """The reaction of the value to a change to manual mode, if no law writes it: as declared by the actuator or, if
        it declares nothing, by the nearest compound ("run on" then means "hold")."""
        reaction = self._when_suspended or declared_reaction(self) or "default"
        return "default" if reaction == "default" else "hold"

    @property
    def _holds(self) -> bool:
        """True if the actuator keeps its value while nothing controls it."""
        return self.when_suspended == "hold"

    @property
    def inhibited(self) -> str | None:
        """The reason why writes of the program are not accepted: the reason of the interlock that keeps the actuator at
        its default, or the client that has taken the actuator. None if writes are accepted."""
        return self._image.claims.inhibited(self._slot)

    @property
    def claim(self) -> Claim:
        """The claim in force. It says who drives the actuator now, and what happens when this claim ends."""
        return self._image.claims.claim(self._slot)

    def update(self) -> bool:
        """Send the pending value if the actuator is synchronous. Return False if the driver did not accept the
        value."""
        return self._image.update_some((self._slot,)) if self._synchronous else True

    def _default_value(self) -> float:
        """The default as a number of the process image. For a state, this is its level."""
        return self._number(self.default)

    def _about(self) -> dict[str, Any]:
        about: dict[str, Any] = {"actuator": True, "default": self._plain(self.default), "expires": self._expires}
        return about | {"when_suspended": self.when_suspended} | super()._about()

    def _guard_text(self) -> str:
        expiry = "" if self._expires is None else f", expires after {duration(self._expires)}"
        retry = "" if self._max_age is None else f", sent again for {duration(self._max_age)}"
        return expiry + retry + (", held when suspended" if self._holds else "")


class BinaryActuator(Actuator, Binary[S]):
    """One output bit: a valve, a relay, a step input. EPICS bo, Modbus coil, OPC UA TwoState, BACnet BO.

    `expires` (s, or a string such as "100 ms"): without a write for this time the default is sent. Default: never.
    `on_error` is the reaction to a write that the device did not confirm. "raise" (default): the quality becomes BAD,
    and DriverError is raised. "retry": the value is sent again in every period, with the quality STALE, until it is
    confirmed. If it is still not confirmed after `max_age` (s, or a string such as "2 s"), the reaction is that of
    "raise". `max_age` is counted from the last confirmation; for an asynchronous actuator it is counted from the write.
    Use "retry" only for channels that hold a level, because a pulse must not be sent twice. `when_suspended`: with
    "hold" the actuator keeps its value in a change to manual mode. With "default" it goes to its default, unless a law
    writes it. Without this setting, the declaration of the nearest compound applies. If there is no such declaration,
    "default" applies.
    """

    __slots__ = ("_default", "_expires", "_max_age", "_when_suspended")

    def __init__(
        self,
        states: type[S],
        *,
        one: S,
        default: S,
        synchronous: bool = True,
        expires: str | float | None = None,
        on_error: OnWriteError = "raise",
        max_age: str | float | None = None,
        when_suspended: Literal["default", "hold"] | None = None,
    ) -> None:
        super().__init__(states, one, synchronous)
        self._expires, self._when_suspended = _expiry(expires), _reaction(when_suspended)
        self._max_age = _retried(on_error, max_age)
        if type(default) is not states:
            known = " or ".join(map(shown, states))
            raise DeclarationError(f"default={default!r} is not a state of {states.__name__}: write {known}")
        self._default = default

    @property
    def default(self) -> S:
        """The safe state: written on connect, on reset and when the connection ends."""
        return self._default

    def describe(self) -> str:
        return super().describe() + self._guard_text()

    @property
    def pending(self) -> S:
        """The state last written, sent by the next `update`."""
        return self._one if self._image.pending[self._slot] else self._zero

    def write(self, value: S) -> bool:
        """Set a new state. The next `update` sends it; an asynchronous actuator sends it immediately.

        Returns True if the state is accepted, or is sent again with on_error="retry". Returns False if it is not
        accepted (see `inhibited`). Raises StateError for a state of another type, and then changes nothing. An
        asynchronous actuator also raises DriverError.
        """
        level = 1.0 if value is self._one else 0.0 if value is self._zero else float(self._level(value))
        write = self._image.write  # a local name: calling an attribute takes longer
        return write(self._slot, level)

    def read(self) -> S:
        """Return the state last accepted by the hardware."""
        return self._one if self._image.values[self._slot] else self._zero


class DigitalActuator(Actuator, Digital):
    """A group of output bits: a DAC, a PWM duty cycle. EPICS ao, Modbus holding register, BACnet AO.

    `limits` sets what `write` does with a value outside the range. "raise" (default): RangeError, nothing changes.
    "clamp": the nearest bound is taken and `write` returns False. NaN and infinities always raise RangeError. `expires`
    (s, or a string such as "100 ms"): without a write for this time the default is sent. `slew_rate` (units per s,
    synchronous only): the largest rate of change of the value sent. `pending` is the value written, `read` the value
    sent. `linearization`: a `Polynomial`, `LookupTable` or `Thermocouple`; its inverse at the value gives the
    electrical quantity, raw * resolution + zero_offset. Without a linearization, value and electrical quantity are the
    same. `on_error`, `max_age` and `when_suspended` are those of a BinaryActuator.
    """

    __slots__ = ("_clamp", "_default", "_expires", "_max_age", "_slew_rate", "_when_suspended")

    def __init__(
        self,
        units: str,
        *,
        default: float,
        minimum: float,
        maximum: float,
        resolution: float,
        zero_offset: float = 0.0,
        linearization: Linearization | None = None,
        limits: Literal["raise", "clamp"] = "raise",
        synchronous: bool = True,
        expires: str | float | None = None,
        slew_rate: float | None = None,
        on_error: OnWriteError = "raise",
        max_age: str | float | None = None,
        when_suspended: Literal["default", "hold"] | None = None,
    ) -> None:
        super().__init__(units, minimum, maximum, resolution, zero_offset, synchronous, linearization)
        self._expires, self._when_suspended = _expiry(expires), _reaction(when_suspended)
        self._max_age = _retried(on_error, max_age)
        self._slew_rate = None if slew_rate is None else _finite("slew_rate", slew_rate)
        if self._slew_rate is not None and self._slew_rate <= 0:
            raise DeclarationError(f"slew_rate must be above 0 {units}/s, not {number_text(self._slew_rate)}")
        if self._slew_rate is not None and not synchronous:
            raise DeclarationError("slew_rate needs a synchronous actuator: one step is sent per period")
        if not is_one_of(limits, ("raise", "clamp")):
            raise DeclarationError(f'limits={limits!r} is neither "raise" nor "clamp"')
        self._default = _finite("default", default)
        self._clamp = limits == "clamp"
        if not self._minimum <= self._default <= self._maximum:
            raise DeclarationError(f"default {number_text(default)} is outside {span(minimum, maximum, units)}")

    @property
    def default(self) -> float:
        """The safe value: written on connect, on reset and when the connection ends."""
        return self._default

    @property
    def slew_rate(self) -> float | None:
        """The largest rate of change of the value sent, in `units` per s; None means not limited."""
        return self._slew_rate

    def describe(self) -> str:
        rate = "" if self._slew_rate is None else f", at most {measure(self._slew_rate, self._units)}/s"
        return super().describe() + rate + self._guard_text()

    @property
    def limits(self) -> Literal["raise", "clamp"]:
        return "clamp" if self._clamp else "raise"

    @property
    def pending(self) -> float:
        """The value last written, sent by the next `update`."""
        return self._image.pending[self._slot]

    def write(self, value: float) -> bool:
        """Set a new value in `units`. The next `update` sends it; an asynchronous actuator sends it immediately.

        Returns True if the value is accepted unchanged (except for rounding to the resolution), or is sent again with
        on_error="retry". Returns False if it is clamped or not accepted (see `inhibited`). Raises RangeError if the
        value is outside the range with limits="raise", or is not a finite number; then nothing changes. An asynchronous
        actuator also raises DriverError.
        """
        if value.__class__ is not float:
            value = self._number(value)
        if not self._minimum <= value <= self._maximum:
            return self._write_beyond(value)
        write = self._image.write  # a local name: calling an attribute takes longer
        return write(self._slot, value)

    def read(self) -> float:
        """Return the value last accepted by the hardware, in `units`, as written (not as quantised)."""
        return self._image.values[self._slot]

    def _write_beyond(self, value: float) -> bool:
        value = self._number(value)
        if not self._clamp:
            outside = f"is outside {span(self._minimum, self._maximum)}"
            raise RangeError(f"{self.path}: {measure(value, self._units)} {outside}")
        write = self._image.write
        write(self._slot, self._minimum if value < self._minimum else self._maximum)
        return False


def _expiry(expires: str | float | None) -> float | None:
    limit = None if expires is None else seconds(expires)
    if limit == 0:
        raise DeclarationError("expires must be above 0: it is the time for which a command is valid")
    return limit


def _reaction(when_suspended: Literal["default", "hold"] | None) -> Literal["default", "hold"] | None:
    if when_suspended is not None and not is_one_of(when_suspended, ("default", "hold")):
        raise DeclarationError(f'when_suspended={when_suspended!r} is neither "default" nor "hold"')
    return when_suspended


def _retried(on_error: str, max_age: str | float | None) -> float | None:
    """Return the time in s for which a value that was not confirmed is sent again; None means not at all."""
    if not is_one_of(on_error, get_args(OnWriteError)):
        raise DeclarationError(f"on_error={on_error!r} is none of {', '.join(map(repr, get_args(OnWriteError)))}")
    if on_error == "retry" and max_age is None:
        raise DeclarationError('on_error="retry" needs a max_age')
    if on_error == "raise" and max_age is not None:
        raise DeclarationError('max_age is for on_error="retry"')
    return None if max_age is None else seconds(max_age)

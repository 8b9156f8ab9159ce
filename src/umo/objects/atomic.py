"""The common part of the four atomic objects (the paper's section 4.5 suggests the hierarchy itself)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from enum import Enum
from math import nan
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar, cast

import numpy as np

from umo.digits import NO_VALUE, digits_of, number_text
from umo.drivers.contract import Direction
from umo.errors import DeclarationError, RangeError, StateError
from umo.objects.attributes import assign, check_declared
from umo.objects.linearization import Linearization, fitted
from umo.objects.link import Unconnected
from umo.objects.node import Node
from umo.objects.presentation.value_text import measure, quality_text, span
from umo.objects.quality import QUALITIES, Quality
from umo.objects.range import Range
from umo.objects.truth import checked_truth
from umo.objects.units import check_unit, convert
from umo.states import TwoState, comparisons, shown
from umo.text import cut_repr, did_you_mean
from umo.user_code import incomplete

if TYPE_CHECKING:
    from umo.objects.link import Image

S = TypeVar("S", bound=TwoState)


class Atomic(Node):
    """An object with one value: an actuator or sensor together with its electronics and circuit (the paper's section
    4.4)."""

    __slots__ = ("_image", "_slot", "_synchronous")

    direction: ClassVar[Direction]
    """Direction of the value: OUTPUT for an actuator, with `write` and `update`; INPUT for a sensor, with `sample`."""
    _word: ClassVar[str]
    """The kind of the value: "binary" or "digital"."""
    _has_states: ClassVar[bool]
    """True if the value is one of several named states, False if it is a number in a unit."""
    _states: type[Enum] | None = None
    """The type of the states, or None if the object has none."""
    _raws: tuple[int, ...] | None = None
    """The raw integers that the channel of the object can have; None means all integers within the range."""
    _incremental: bool = False
    """True if the value is meaningless until it is referenced."""
    _debounce: float | None = None
    _filter: float | None = None
    _velocity: float | None = None
    """Times in s of the conditioning of the value; each is None if the object does not have this kind of
    conditioning."""
    _slew_rate: float | None = None
    """The largest rate of change of the value that is sent, in units per s; None means not limited."""
    _image: Image

    def __init__(self, synchronous: bool) -> None:
        if self._abstract:
            raise incomplete(type(self), self._abstract)
        self._parent = None
        self._name = ""
        self._synchronous = checked_truth("synchronous", synchronous)
        self._slot = -1
        self._disconnect()

    @property
    def path(self) -> str:
        """The place of the object in the machine, such as `z.motor` or `axes.0.motor`."""
        return self._path

    @property
    @abstractmethod
    def calibration(self) -> Calibration:
        """The range and scale of the object."""
        raise NotImplementedError

    @property
    def synchronous(self) -> bool:
        """True: transferred once per period by `sample` or `update`. False: transferred by each `read` or `write`."""
        return self._synchronous

    @property
    def raw(self) -> int:
        """The raw value at the hardware: for a sensor as last read (0 before the first reading), for an actuator as
        last accepted."""
        return self._image.raws[self._slot]

    @property
    def time(self) -> float:
        """Time at which the value was read or accepted, in s on the cycle's clock."""
        return self._image.times[self._slot]

    @property
    def quality(self) -> Quality:
        return QUALITIES[self._image.quality[self._slot]]

    @property
    def connected(self) -> bool:
        return not isinstance(self._image, Unconnected)

    def reset(self) -> None:
        """Reset the object immediately, even if it is synchronous: an actuator goes to its default, a sensor clears
        faults of its circuit."""
        self._image.reset_some((self._slot,))

    def acknowledge(self) -> bool:
        return self._image.claims.acknowledge(frozenset((self._slot,)))

    @abstractmethod
    def describe(self) -> str:
        """Return range and units as a short text, for tables."""
        raise NotImplementedError

    @abstractmethod
    def _about(self) -> dict[str, Any]:
        """Return the meaning of the object's values as plain data (`umo.objects.presentation.described`)."""
        return {}

    @abstractmethod
    def _number(self, value: Any) -> float:
        """Return the number in the image for a value in the form that `write` takes. Raises StateError or RangeError
        for anything else."""
        raise NotImplementedError

    @abstractmethod
    def _plain(self, value: Any) -> Any:
        """Return a value as plain data."""
        raise NotImplementedError

    @abstractmethod
    def _from_plain(self, value: Any) -> float:
        """Return the number in the image for a value given as plain data. Raises StateError or RangeError if it is not
        a value of this object within the range."""
        raise NotImplementedError

    def _levels(self, inverted: bool) -> Calibration:
        """Return the calibration of an object with states on a channel, inverted or not. Raises DeclarationError if the
        object cannot be inverted."""
        if inverted:
            raise DeclarationError(f"a {type(self).__name__} cannot be inverted")
        return self.calibration

    @abstractmethod
    def _calibrate(self, calibration: Calibration) -> None:
        """Take range and scale from a wiring entry."""
        raise NotImplementedError

    if not TYPE_CHECKING:  # typed, any attribute could be assigned

        def __setattr__(self, name, value):
            if name not in self._class_names:
                check_declared(self, name, self._instead_of_setting("..."))
            try:
                assign(self, name, value)
            except AttributeError as error:
                raise AttributeError(f"{error}{self._instead_of_setting('...')}") from None

    def _instead_of_setting(self, value: str) -> str:
        """Return what to write instead of an assignment to the object or to one of its attributes."""
        if self.direction is Direction.OUTPUT:
            return f"; its value is written: `{self.path or type(self).__name__}.write({value})`"
        return "; a sensor is only read"

    def _connect(self, image: Image, slot: int) -> None:
        self._image = image
        self._slot = slot

    def _disconnect(self) -> None:
        self._image = cast("Image", Unconnected(self))

    def _shown(self) -> str:
        """The value of the object as text."""
        value = self._image.values[self._slot]
        return NO_VALUE if value != value else number_text(value)

    def __repr__(self) -> str:
        name = f"{type(self).__name__} {self.path}".rstrip()
        now = f" = {self._shown()} {quality_text(self.quality)}" if self.connected else ""
        return f"<{name}{now}; {self.describe()}>"


class Binary(Atomic, Generic[S]):
    """A single bit with a logical meaning (the paper's section 4.4)."""

    __slots__ = ("_inverted", "_one", "_states", "_zero")

    _word, _has_states, _raws = "binary", True, (0, 1)
    _states: type[S]

    def __init__(self, states: type[S], one: S, synchronous: bool) -> None:
        if not (isinstance(states, type) and issubclass(states, TwoState)) or states is TwoState:
            raise DeclarationError(f"{states!r} is not a two-state type")
        if type(one) is not states:
            raise DeclarationError(f"one={one!r} is not a state of {states.__name__}")
        super().__init__(synchronous)
        self._states = states
        self._one: S = one
        self._zero: S = next(state for state in states if state is not one)
        self._inverted = False

    @property
    def states(self) -> type[S]:
        return self._states

    @property
    def one(self) -> S:
        """The state of the electrical 1 (before an inversion in the wiring)."""
        return self._one

    @property
    def zero(self) -> S:
        return self._zero

    @property
    def calibration(self) -> Calibration:
        """The calibration of the object: `LEVEL`, or `INVERTED`."""
        return self._levels(self._inverted)

    def _levels(self, inverted: bool) -> Calibration:
        return INVERTED if inverted else LEVEL

    def _calibrate(self, calibration: Calibration) -> None:
        self._inverted = calibration == INVERTED

    def describe(self) -> str:
        return f"{self._one}=1 {self._zero}=0"

    def _about(self) -> dict[str, Any]:
        return {"one": str(self._one), "zero": str(self._zero)}

    def _number(self, value: Any) -> float:
        return float(self._level(value))

    def _plain(self, value: Any) -> Any:
        return str(value)

    def _from_plain(self, value: Any) -> float:
        names = {state.name: state for state in self._states}
        if not isinstance(value, str) or value not in names:
            raise StateError(f"{self.path} has no state {value!r}{did_you_mean(str(value), names)}: {', '.join(names)}")
        return self._number(names[value])

    def _meant(self, name: str, sign: str, other: object) -> str:
        meant = other if isinstance(other, str | TwoState) else self._zero if other == 0 else self._one
        return f"write {comparisons(self._states, meant, f'{name}.read() ')}"

    def _level(self, state: S) -> int:
        if state is self._one:
            return 1
        if state is self._zero:
            return 0
        raise StateError(
            f"{self.path or type(self).__name__}: {state!r} is not a state of {self._states.__name__} "
            f"({self._one} or {self._zero}){self._nearest(state)}"
        )

    def _nearest(self, given: object) -> str:
        """Return the state that was probably meant by a text, a truth value or a number, or "" if no state is near."""
        for state in (self._one, self._zero):
            if isinstance(given, str) and given.casefold() in (state.name.casefold(), str(state.value).casefold()):
                return f": write {shown(state)}"
        if isinstance(given, bool | int | np.bool_) and given in (0, 1):
            return f": write {shown(self._one)} or {shown(self._zero)}; its wiring, not a truth value, says which is 1"
        return ""

    def _shown(self) -> str:
        level = self._image.values[self._slot]
        return "-" if level != level else str(self._one if level else self._zero)  # NaN: never read


class Calibration(NamedTuple):
    """Range and scale of a digital object: as declared, or as a wiring entry overrides them."""

    minimum: float
    maximum: float
    resolution: float
    zero_offset: float
    linearization: Linearization | None = None
    invalid_raws: tuple[int, ...] = ()
    rollover: bool | int = False
    """The number of bits of a counter that rolls over. True means the bits of its channel; False means that the object
    is not a counter that rolls over."""


LEVEL, INVERTED = Calibration(0.0, 1.0, 1.0, 0.0), Calibration(0.0, 1.0, -1.0, 1.0)
"""Calibrations of binary objects: the value is the raw integer of the channel or, inverted, 1 - raw."""


class Digital(Atomic):
    """A group of bits with a numeric meaning (the paper's section 4.4)."""

    __slots__ = ("_calibration", "_maximum", "_minimum", "_units")

    _word, _has_states = "digital", False

    def __init__(
        self,
        units: str,
        minimum: float,
        maximum: float,
        resolution: float,
        zero_offset: float,
        synchronous: bool,
        linearization: Linearization | None = None,
        invalid_raws: Sequence[int] = (),
        rollover: bool | int = False,
    ) -> None:
        super().__init__(synchronous)
        self._units = check_unit(units)
        low, high = _finite("minimum", minimum), _finite("maximum", maximum)
        scale = _finite("resolution", resolution), _finite("zero_offset", zero_offset)
        if scale[0] == 0:
            raise DeclarationError("resolution must not be 0: it is the change of the value for one bit")
        if low >= high:
            raise DeclarationError(f"minimum {number_text(minimum)} is not below maximum {number_text(maximum)}")
        if linearization is not None:
            linearization = fitted(linearization, units, low, high)
        self._calibrate(Calibration(low, high, *scale, linearization, _raws(invalid_raws), rollover))

    @property
    def units(self) -> str:
        return self._units

    @property
    def minimum(self) -> float:
        return self._minimum

    @property
    def maximum(self) -> float:
        return self._maximum

    @property
    def resolution(self) -> float:
        """The change of the value for one bit; negative if the circuit counts the other way. With a linearization: the
        change of the electrical quantity."""
        return self._calibration.resolution

    @property
    def zero_offset(self) -> float:
        """The value of raw 0. With a linearization: the electrical quantity of raw 0."""
        return self._calibration.zero_offset

    @property
    def linearization(self) -> Linearization | None:
        """The function from the electrical quantity to the value, or None if the value is raw * resolution +
        zero_offset."""
        return self._calibration.linearization

    @property
    def calibration(self) -> Calibration:
        return self._calibration

    def _calibrate(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._minimum, self._maximum = calibration[:2]  # each write looks at them

    def read_in(self, unit: str) -> float:
        """Return the result of `read()` in another unit of the same dimension."""
        return convert(self.read(), self._units, unit)

    @abstractmethod
    def read(self) -> float:
        raise NotImplementedError

    def describe(self) -> str:
        of = "" if self.linearization is None else f" through a {self.linearization}"
        return f"{span(self._minimum, self._maximum, self._units)} by {number_text(abs(self.resolution))}{of}"

    def _about(self) -> dict[str, Any]:
        """Return unit and range and, without a linearization, also the resolution and the zero offset, from which the
        digits follow."""
        about: dict[str, Any] = {"unit": self._units, "minimum": self._minimum, "maximum": self._maximum}
        if self.linearization is None:
            about |= {"resolution": self.resolution, "zero_offset": self.zero_offset}
        return about

    def _plain(self, value: Any) -> Any:
        return value

    def _from_plain(self, value: Any) -> float:
        return Range.of(self).check(self.path, value)

    def _meant(self, name: str, sign: str, other: object) -> str:
        number = cut_repr(other) if isinstance(other, int | float) else "..."
        return f"write `{name}.read() {sign} {number}`"

    def _number(self, value: Any) -> float:
        """Return the value as a finite float. A bool, a text or a state is refused."""
        name = self.path or type(self).__name__
        if isinstance(value, bool | np.bool_) or not hasattr(value, "__float__"):
            raise RangeError(f"{name}: {value!r} is not a number in {self._units}")
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError) as error:  # an array of many, an integer beyond floats
            raise RangeError(f"{name}: this is not a number in {self._units} ({error})") from None
        if not math.isfinite(number):
            raise RangeError(f"{name}: {number} is not finite")
        return number

    def _shown(self) -> str:
        digits = digits_of(self.resolution, self.zero_offset) if self.linearization is None else None
        value = self._image.values[self._slot]
        return measure(value, self._units, digits) if math.isfinite(value) else NO_VALUE


def _finite(name: str, number: float) -> float:
    is_number = isinstance(number, float | int) and not isinstance(number, bool)
    try:
        value = float(number) if is_number else nan
    except OverflowError:
        value = nan
    if not math.isfinite(value):
        raise DeclarationError(f"{name}={cut_repr(number)} is not a finite number")
    return value


def _raws(raws: Iterable[int]) -> tuple[int, ...]:
    """Return raw values as a tuple. Raises DeclarationError for anything except a list of integers."""
    each = tuple(raws) if isinstance(raws, Iterable) else ()
    if not isinstance(raws, Iterable) or any(isinstance(raw, bool) or not isinstance(raw, int) for raw in each):
        raise DeclarationError(f"invalid_raws must be a list of integers, not {raws!r}")
    return each

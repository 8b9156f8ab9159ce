"""Many objects of one kind that are read or written together, with the methods of a single object."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np

from umo.drivers.contract import Direction
from umo.errors import DeclarationError, RangeError, StateError
from umo.objects.actuators import BinaryActuator, DigitalActuator
from umo.objects.atomic import Atomic, Binary, Digital
from umo.objects.presentation.value_text import measure, span
from umo.objects.scaling import BoolArray, ByteArray, FloatArray, IntArray
from umo.objects.sensors import BinarySensor, DigitalSensor
from umo.states import TwoState, is_plain, shown
from umo.text import cut_repr

if TYPE_CHECKING:
    from umo.objects.link import Image

A = TypeVar("A", bound=Atomic)
FLOAT64 = np.dtype(np.float64)


class Vector(Generic[A]):
    """Objects of one kind: `motors = Vector(axis.motor for axis in m.axes)`, `motors.write(array)`.

    Objects of one kind have the same class and the same units or two-state type, and are all synchronous or all
    asynchronous. Values are float64 arrays in the order given. For binary objects 1.0 is the state declared as `one`
    (before an inversion in the wiring); `write` takes one state for all, a sequence of states, or an array of levels. A
    Vector can be created before or after connecting.
    """

    def __init__(self, objects: Iterable[A]) -> None:
        if not isinstance(objects, Iterable):
            raise DeclarationError(f"a Vector takes objects, such as a list of them, not {cut_repr(objects)}")
        self._objects = tuple(objects)
        if not self._objects:
            raise DeclarationError("a Vector needs at least one object")
        if len(set(map(id, self._objects))) < len(self._objects):
            raise DeclarationError("an object is in the Vector twice")
        likes = {_likeness(item) for item in self._objects}
        if len(likes) > 1:
            raise DeclarationError(
                f"the objects of a Vector must be of one kind, not {' and '.join(map(str, sorted(likes)))}"
            )
        self._where: _Slots | None = None

    if not TYPE_CHECKING:  # typed, mypy would not look at `vector == 1.0`

        def __eq__(self, other):
            if self is not other and is_plain(other):
                what = "compares a Vector, not its values"
                raise TypeError(f"`vector == {shown(other)}` {what}; write `vector.read() == ...`, levels of states")
            return True if self is other else NotImplemented

        __hash__ = object.__hash__

    def __len__(self) -> int:
        return len(self._objects)

    def __iter__(self) -> Iterator[A]:
        return iter(self._objects)

    def __getitem__(self, index: int) -> A:
        return self._objects[index]

    def read(self) -> FloatArray:
        """Return the values as a new array of shape (n,), with NaN for objects that were never read; asynchronous
        sensors are read from the hardware now."""
        slots = self._located()
        if not self._objects[0].synchronous and self._objects[0].direction is Direction.INPUT:
            slots.image.sample_some(slots.all_slots)
        return np.array(slots.image.columns.values[slots.slots])

    @property
    def quality(self) -> ByteArray:
        """The numbers of `Quality` as a new uint8 array of shape (n,); 0 is GOOD. `read` returns every value,
        regardless of its quality; `value_of` of `umo.control` refuses the qualities that control laws refuse."""
        slots = self._located()
        return np.array(slots.image.columns.quality[slots.slots])

    @property
    def all_good(self) -> bool:
        """True if the quality of every object is GOOD."""
        slots = self._located()
        sampled = self._objects[0].synchronous and self._objects[0].direction is Direction.INPUT
        return (sampled and slots.image.sampled_good is True) or not np.count_nonzero(self.quality)

    @property
    def pending(self) -> FloatArray:
        """The values last written to actuators, which the next `update` sends; a new array of shape (n,)."""
        slots = self._located()
        return np.array(slots.image.columns.pending[slots.slots])

    def write(
        self,
        values: FloatArray | Sequence[float] | float | TwoState | Sequence[TwoState],
        *,
        where: BoolArray | None = None,
    ) -> bool:
        """Set new values: an array of shape (n,), or one value for all objects. Raises RangeError if a value is
        refused; then no value is changed.

        `where`: booleans of shape (n,); objects where it is False are not written. Default: all are written. Returns
        True if all were accepted unchanged. Returns False if a value was clamped (limits="clamp"), an interlock
        inhibits an actuator, or the device of an asynchronous actuator did not accept its value. The next `update`
        sends the values; asynchronous actuators send them immediately.
        """
        if self._objects[0].direction is not Direction.OUTPUT:
            raise DeclarationError(f"{self!r} contains sensors; only actuators can be written")
        slots = self._located()
        if where is not None:
            return self._write_some(slots, values, self.mask(where))
        numbers, taken = self._levels(values) if slots.limits is None else slots.limits.check(self._objects, values)
        free = slots.image.write_many(slots.slots, slots.all_slots, numbers)
        return taken and free

    def mask(self, where: BoolArray) -> BoolArray:
        """Return the mask. Raises RangeError unless the mask has one bool for each object."""
        if not isinstance(where, np.ndarray) or where.dtype != np.bool_ or where.shape != (len(self),):
            raise RangeError(f"{where!r} is not an array of {len(self)} booleans")
        return where

    def _write_some(self, slots: _Slots, values: Any, where: BoolArray) -> bool:
        if slots.limits is None:
            numbers, taken = self._levels(values)
        else:
            given = slots.limits.numbers(values)
            numbers, taken = slots.limits.check(self._objects, np.where(where, given, slots.limits.minimum))
        each = [slot for slot, wanted in zip(slots.all_slots, where.tolist(), strict=True) if wanted]
        free = slots.image.write_many(np.array(each, np.int64), each, numbers[where])
        return taken and free

    def sample(self) -> bool:
        """Read these synchronous sensors now, and no others. Return True if all are GOOD."""
        slots = self._located()
        return slots.image.sample_some(slots.all_slots) if self._objects[0].synchronous else True

    def update(self) -> bool:
        """Send the pending values of these synchronous actuators now, and no others."""
        slots = self._located()
        return slots.image.update_some(slots.all_slots) if self._objects[0].synchronous else True

    def _located(self) -> _Slots:
        image = self._objects[0]._image
        if self._where is None or self._where.image is not image:
            self._where = _Slots(image, self._objects)
        return self._where

    def _levels(self, states: Any) -> tuple[FloatArray, bool]:
        if isinstance(states, np.ndarray) and states.dtype.kind in "bfiu":
            return self._given_levels(states), True
        first = cast("Binary[Any]", self._objects[0])
        if not isinstance(states, TwoState | list | tuple):
            raise StateError(f"{states!r} is neither a state nor a list of states")
        each = [states] * len(self) if isinstance(states, TwoState) else list(states)
        if len(each) != len(self):
            raise StateError(f"{len(each)} states for {len(self)} objects")
        one, zero = first.one, first.zero
        if self._located().alike:
            levels = [1.0 if state is one else 0.0 if state is zero else first._level(state) for state in each]
        else:
            levels = [
                float(item._level(state))
                for item, state in zip(cast("tuple[Binary[Any], ...]", self._objects), each, strict=True)
            ]
        return np.array(levels), True

    def _given_levels(self, levels: Any) -> FloatArray:
        numbers: FloatArray = levels.astype(np.float64, copy=False)
        alike = np.equal(numbers, numbers.astype(np.bool_))  # 0.0 and 1.0 only
        if numbers.shape != (len(self),) or alike.tobytes() != self._located().all_true:
            raise StateError(f"levels must be an array of {len(self)} zeros and ones, as `read` returns them")
        return numbers

    def __repr__(self) -> str:
        return f"<Vector of {len(self)}: {self._objects[0].path} ... {self._objects[-1].path}>"


class _Slots:
    """The slots of the objects in one image, and the limits of the objects as arrays."""

    def __init__(self, image: Image, objects: Sequence[Atomic]) -> None:
        self.image = image
        image.values  # noqa: B018  (NotConnected before anything is indexed)
        if any(item._image is not image for item in objects):
            raise DeclarationError("a Vector holds objects of one machine")
        self.all_slots = [item._slot for item in objects]
        self.slots = _as_slice(self.all_slots)
        self.all_true = bytes([True]) * len(objects)
        self.limits: _Limits | None = None
        if isinstance(objects[0], Digital):
            self.limits = _Limits(cast("Sequence[Digital]", objects))
        else:
            first = cast("Binary[Any]", objects[0])
            self.alike = all(cast("Binary[Any]", item).one is first.one for item in objects)


class _Limits:
    def __init__(self, objects: Sequence[Digital]) -> None:
        self.minimum = np.array([item.minimum for item in objects])
        self.maximum = np.array([item.maximum for item in objects])
        rates = [item.slew_rate if isinstance(item, DigitalActuator) else None for item in objects]
        self.slew_rate = None if not any(rates) else np.array([rate or inf for rate in rates])
        """Rates of actuators; None if none of them is limited."""
        self.all_true = bytes([True]) * len(objects)
        self.clamps = np.array([isinstance(item, DigitalActuator) and item.limits == "clamp" for item in objects])

    def numbers(self, values: Any) -> FloatArray:
        """Return one number for each object. Raises RangeError for anything else."""
        if values.__class__ is np.ndarray and values.dtype is FLOAT64 and values.shape == self.minimum.shape:
            return cast(FloatArray, values)
        count = len(self.minimum)
        try:
            given = np.asarray(values)
        except ValueError as error:  # lists of different lengths
            raise RangeError(f"{values!r} is not an array of {count} numbers: {error}") from None
        if given.dtype.kind not in "fiu" or given.shape not in ((), self.minimum.shape):
            raise RangeError(f"{given.dtype} of shape {given.shape} is not an array of {count} numbers")
        return given.astype(np.float64, copy=False) if given.shape else np.full(count, given, np.float64)

    def check(self, objects: Sequence[Atomic], values: Any) -> tuple[FloatArray, bool]:
        """Return the values to write, and True if they are the given values, unchanged. Raises RangeError if a value is
        refused."""
        numbers = self.numbers(values)
        above, below = np.greater_equal(numbers, self.minimum), np.less_equal(numbers, self.maximum)  # False for NaN
        if above.tobytes() == self.all_true and below.tobytes() == self.all_true:  # a tenth of the time of all()
            return numbers, True
        inside = above & below
        refused = ~np.isfinite(numbers) | ~(inside | self.clamps)
        if refused.any():
            index = int(np.argmax(refused))
            item = cast(Digital, objects[index])
            raise RangeError(
                f"{item.path}: {measure(numbers[index], item.units)} is outside {span(item.minimum, item.maximum)}; "
                f"{int(refused.sum())} of {len(objects)} values are refused, and none is used"
            )
        clamped = np.where(above, np.where(below, numbers, self.maximum), self.minimum)  # np.clip changes a -0.0
        return clamped, False


def _likeness(item: Atomic) -> str:
    for kind in (BinaryActuator, DigitalActuator, BinarySensor, DigitalSensor):
        if isinstance(item, kind):
            what = item.units if isinstance(item, Digital) else cast("Binary[Any]", item).states.__name__
            return f"{'' if item.synchronous else 'asynchronous '}{kind.__name__}({what})"
    raise DeclarationError(f"a Vector holds atomic objects, not {item!r}")


def _as_slice(slots: list[int]) -> slice | IntArray:
    """Return a slice if the stride is constant, because numpy then makes no copy; otherwise return the indices."""
    steps = {b - a for a, b in pairwise(slots)} or {1}
    if len(steps) == 1 and (step := steps.pop()) > 0:
        return slice(slots[0], slots[-1] + 1, step)
    return np.array(slots, dtype=np.int64)

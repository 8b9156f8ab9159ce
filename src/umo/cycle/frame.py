"""One finished period, as shown to observers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import EnumMeta
from types import MappingProxyType
from typing import Any, NamedTuple

from umo.cycle.image import Image
from umo.cycle.stage import Progress
from umo.objects import Atomic, MachineNumber, described
from umo.objects.numbers import number_in
from umo.user_code import read_numbers


class Signal(NamedTuple):
    """A number that is shown together with the objects."""

    path: str
    """Path of the signal, such as `z.servo.error`."""
    unit: str
    owner: Any
    name: str
    states: Mapping[int, str] = MappingProxyType({})
    """The names of the values by number; empty for a plain number."""


class _Numbered:
    """A value with named states, read as the number of its state."""

    def __init__(self, number: MachineNumber) -> None:
        self._of = number

    @property
    def number(self) -> int:
        kind: Any = self._of.kind
        return number_in(kind, getattr(self._of.owner, self._of.name))


def signals_of(numbers: Mapping[str, MachineNumber]) -> tuple[Signal, ...]:
    """Return the numbers of a machine that are shown or kept."""
    shown = (each for each in numbers.values() if each.declared.shown or each.declared.kept)
    return tuple(_signal(each) for each in shown)


def _signal(each: MachineNumber) -> Signal:
    owner, name = (_Numbered(each), "number") if isinstance(each.kind, EnumMeta) else (each.owner, each.name)
    return Signal(each.path, each.declared.unit, owner, name, each.states)


def velocities(items: Sequence[Atomic]) -> tuple[Signal, ...]:
    """Return the velocities of the sensors that are declared with `velocity`."""
    moving = (item for item in items if item._velocity is not None)
    return tuple(Signal(f"{item.path}.velocity", f"{described(item).unit}/s", item, "velocity") for item in moving)


class Frame:
    """The data of one period: a view of the live image, valid only during the call of the observer."""

    def __init__(self, image: Image, signals: Sequence[Signal] = ()) -> None:
        self.items: list[Atomic] = image.items
        """The objects, in the order of the values."""
        self.values: Any = image.values
        """The value of each object."""
        self.raws: Any = image.raws
        self.quality: Any = image.quality
        self.alarms: Any = image.columns.alarms
        """The number of the `AlarmState` of each alarm, in the order of frames."""
        self.signals = signals
        """The numbers of the control code that are shown together with the objects."""
        self._signal_values: list[float] | None = None
        self.number = 0
        """Number of ticks since connecting."""
        self.time = 0.0
        """Time in s on the cycle's clock."""
        self.missed = 0
        """Number of ticks that had already passed when the timer was read."""
        self.began = 0
        """Time at which the timer returned, in ns of CLOCK_MONOTONIC."""
        self.execution = 0.0
        """Wall-clock time in s from the timer's return to the end of `update`."""
        self.progress = Progress()
        """The last progress of the machine."""

    @property
    def signal_values(self) -> list[float]:
        """The value of each signal. The values are read when the first observer requests them."""
        if self._signal_values is None:
            self._signal_values = read_numbers(self.signals)
        return self._signal_values

    def renew(self) -> None:
        """Prepare for another period."""
        self._signal_values = None


Observer = Callable[[Frame], None]

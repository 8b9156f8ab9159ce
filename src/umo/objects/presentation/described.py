"""The meaning of a value of a machine: its kind, unit, range, states and digits, and the value as a text.

The meaning is read from the plain data in frames and recordings. The data describe an object (`umo.objects.description`
makes them), a signal, a tunable number, an argument, or the state of equipment. Only this module examines the data to
find out which of these they describe.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite
from typing import Any

from umo.digits import NO_VALUE, digits_of, number_text
from umo.objects.presentation.value_text import measure, shown_unit, span

_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z])")


@dataclass(frozen=True)
class Described:
    """Describes a value: a number with a unit, a level with two states, or one of several named states."""

    plain: Mapping[str, Any]
    """The plain data."""

    # What it is ----------------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        return str(self.plain.get("path", ""))

    @property
    def kind(self) -> str:
        """The class of an object, "DigitalSensor"; for an argument, its type; "" for a signal, a tunable number or a
        state."""
        return str(self.plain.get("kind", ""))

    @property
    def is_object(self) -> bool:
        """True if the value is that of an object, so that it is among the values of a frame."""
        return "kind" in self.plain

    @property
    def is_actuator(self) -> bool:
        return bool(self.plain.get("actuator"))

    @property
    def is_synchronous(self) -> bool:
        """True if the value belongs to the period. This is so for all values except those of asynchronous objects."""
        return bool(self.plain.get("synchronous", True))

    @property
    def is_binary(self) -> bool:
        """True if the value is a level, with the two states 1 and 0."""
        return "one" in self.plain

    @property
    def is_number(self) -> bool:
        """True if the value has no states."""
        return not self.is_binary and "states" not in self.plain

    @property
    def wire(self) -> str:
        """The channel of an object; "" if the object is not connected."""
        return str(self.plain.get("wire", ""))

    @property
    def is_inspected(self) -> bool:
        """True if the driver of a sensor can show the content of the circuit."""
        return bool(self.plain.get("inspected"))

    # Its values ----------------------------------------------------------------------------------------

    @property
    def unit(self) -> str:
        """The unit as declared, "mm/s**2"; "" if there is none."""
        return str(self.plain.get("unit") or "")

    @property
    def minimum(self) -> float | None:
        return self.plain.get("minimum")

    @property
    def maximum(self) -> float | None:
        return self.plain.get("maximum")

    @property
    def bounds(self) -> tuple[float, float]:
        """Minimum and maximum; infinite if there is none."""
        low, high = self.minimum, self.maximum
        return -inf if low is None else float(low), inf if high is None else float(high)

    @property
    def resolution(self) -> float | None:
        """The change of the value for one bit, or None if the values have no such scale."""
        return self.plain.get("resolution")

    @property
    def zero_offset(self) -> float:
        """The value of raw 0."""
        return float(self.plain.get("zero_offset", 0.0))

    @cached_property
    def states(self) -> Mapping[int, str]:
        """The names of the states by number; empty for a number."""
        if self.is_binary:
            return {0: str(self.plain["zero"]), 1: str(self.plain["one"])}
        states = self.plain.get("states", {})
        named = enumerate(states) if isinstance(states, Sequence) else ((int(n), name) for n, name in states.items())
        return {number: str(name) for number, name in named}

    def number_of(self, state: str) -> float | None:
        """Return the value of the state with this name; None if there is no such state."""
        return next((float(number) for number, name in self.states.items() if name == state), None)

    @cached_property
    def default(self) -> float | None:
        """The safe value of an actuator; for a state, the number of the state."""
        default = self.plain.get("default")
        return self.number_of(str(default)) if self.states else default

    @property
    def expires(self) -> float | None:
        """Time in s without a write after which the default is sent; None means never."""
        return self.plain.get("expires")

    @property
    def is_held(self) -> bool:
        """True if an actuator keeps its value when the machine is suspended."""
        return self.plain.get("when_suspended") == "hold"

    # In words ------------------------------------------------------------------------------------------

    @cached_property
    def digits(self) -> int | None:
        """The number of digits after the point; None if the value has no resolution."""
        return digits_of(float(self.resolution), self.zero_offset) if self.resolution else None

    def state(self, value: float) -> str:
        """Return the name of a state; if there is no such state, the number as a string."""
        if self.is_binary:
            return self.states[int(value > 0.5)]
        return self.states.get(int(value), number_text(value))

    def value(self, value: float) -> float | str:
        """Return the name of the state, or the number if there are no states."""
        return value if self.is_number or not isfinite(value) else self.state(value)

    def text(self, *values: float) -> str:
        """Return the value with its unit, or the state. For a family, return the range from the least to the greatest
        value, or the number of objects in each state. For named values, return the name of each."""
        known = [value for value in values if isfinite(value)]
        if not known:
            return NO_VALUE
        if self.is_number:
            least, most = number_text(min(known), self.digits), number_text(max(known), self.digits)
            text = least if least == most else f"{least} to {most}"
            return f"{text} {shown_unit(self.unit)}".rstrip()
        names = [self.state(value) for value in known]
        if self.is_binary and len(set(names)) > 1:
            return ", ".join(f"{names.count(self.states[number])} {self.states[number]}" for number in (1, 0))
        return ", ".join(dict.fromkeys(names))

    @property
    def kind_text(self) -> str:
        """The kind in words, such as `digital actuator`."""
        return _CAPITAL.sub(" ", self.kind).lower()

    @property
    def range_text(self) -> str:
        """The range in words, such as `0 to 10 V` or `OFF or ON`."""
        return " or ".join(self.states.values()) or span(self.minimum, self.maximum, self.unit)

    @property
    def default_text(self) -> str:
        """The safe value of an actuator, or the declared value of a number, as text, or "" if it has none."""
        if (default := self.plain.get("default")) is None:
            return ""
        return measure(default, self.unit) if self.is_number else str(default)

    @property
    def heading(self) -> str:
        """The heading of a column: `z.encoder[um]`, `gripper.valve[open=1]`, `mixer.step[FILL=0 STIR=1]`."""
        return column_heading(self.path, self.unit, {1: self.states[1]} if self.is_binary else self.states)

    @property
    def file_form(self) -> str:
        """The format of the number in a file. The number of an object has enough digits to stand for one raw integer;
        other numbers have all of their digits."""
        digits = 0 if self.is_binary else self.digits
        return "{}" if digits is None else f"{{:z.{digits}f}}"

    def in_unit(self, unit: str, line: tuple[float, float] | None) -> Described:
        """Return the description of the number in another unit. `line`: factor and offset of the conversion, or None if
        the resolution varies in the other unit."""
        about = {name: fact for name, fact in self.plain.items() if name not in ("resolution", "zero_offset")}
        if line is not None and self.resolution is not None:
            factor, offset = line
            about |= {"resolution": self.resolution * factor, "zero_offset": self.zero_offset * factor + offset}
        return Described(about | {"unit": unit})

    @property
    def shown(self) -> dict[str, Any]:
        """The plain data for the page: with the printed form of its unit (`look`), the digits of its values, and its
        range as text."""
        shown = dict(self.plain)
        if "unit" in shown:
            shown |= {"look": shown_unit(self.unit), "digits": self.digits}
            shown["range"] = span(self.minimum, self.maximum)
        return shown


def column_heading(path: str, unit: str, states: Mapping[int, str]) -> str:
    """The path with its unit, or with the names of its states and their numbers."""
    return f"{path}[{' '.join(f'{name}={number}' for number, name in states.items()) or unit}]"


def shown_all(plain: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Plain data for the page."""
    return [Described(each).shown for each in plain]

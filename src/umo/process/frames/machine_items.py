"""The declaration of a running machine for faces: all its values as one list of items."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import floor, isfinite, log10
from typing import Any

from umo.objects.presentation.described import Described
from umo.objects.presentation.identity import Identities, escaped, is_encodable
from umo.objects.presentation.value_text import shown_unit
from umo.operation.alarms.alarm_states import PUT_AWAY, AlarmState
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.verb import Verb
from umo.operation.commands.verbs import MODE, TUNE, WRITE
from umo.process.frames import RunReader
from umo.process.frames.layout import Layout


class ItemKind(Enum):
    """The kind of an item."""

    SENSOR = "sensor"
    ACTUATOR = "actuator"
    SIGNAL = "signal"
    """A number or a named value that the control code shows."""
    TUNABLE = "tunable"
    EQUIPMENT = "equipment"
    """The state of equipment: normal, or in fault."""
    AXIS = "axis"
    """The state of an axis, in PLCopen's words."""
    ALARM = "alarm"
    """The state of an alarm, in ISA-18.2's words."""
    RUN = "run"
    """A number of the run itself: its mode, missed periods, execution time."""


MODE_ITEM = MODE.name
RUN_ITEMS: Mapping[str, Mapping[str, Any]] = {
    MODE_ITEM: {"states": {"-1": "no commands"} | {str(int(mode)): str(mode) for mode in Mode}},
    "periods": {"unit": ""},
    "missed": {"unit": ""},
    "execution": {"unit": "s"},
    "wake": {"unit": "s"},
}
"""The items of each run. `wake` is the time from the tick to waking up, and `execution` the time from waking up to the
end of the period; both are the greatest values since the last look."""


QUIET = tuple(str(each) for each in AlarmState if each is AlarmState.NORMAL or each in PUT_AWAY)
"""The names of the states of an alarm or of equipment in which nothing is wrong, or in which an operator has shelved
the alarm or removed it from service."""
DIGITS, MAX_DIGITS = 6, 15
"""DIGITS: the number of significant digits of the greatest value, if no resolution determines the digits. MAX_DIGITS:
the largest number of digits after the point."""


@dataclass(frozen=True)
class MachineItem:
    """One value of a machine."""

    number: int
    """Place of the item in `Declaration.items` and in the arrays of `Changes`."""
    kind: ItemKind
    path: str
    about: Mapping[str, Any] = field(repr=False)
    """Description of the item in the frames (`umo.process.frames.layout`)."""
    unit: str = ""
    """The unit as declared, such as "mm/s**2"; "" if there is none."""
    minimum: float | None = None
    maximum: float | None = None
    states: Mapping[int, str] = field(default_factory=dict)
    """The names of the values of an item that has states; empty for a number."""

    @property
    def name(self) -> str:
        """Name of the item, unique among all items: the path, preceded by the kind if a path may have several items."""
        return self.path if self.kind.value in PLAIN else f"{self.kind.value}:{self.path}"

    def identity(self, names: Identities) -> str:
        """Return the name of the item in the alphabet of a protocol."""
        return names.of(self.path, "" if self.kind.value in PLAIN else self.kind.value)

    @property
    def look(self) -> str:
        """The unit of the item in printed form."""
        return shown_unit(self.unit)

    def state_of(self, value: float) -> str | None:
        """Return the name of a state; None if the value is none of the states."""
        return self.states.get(int(value)) if float(value).is_integer() else None

    @property
    def digits(self) -> int | None:
        """The number of digits after the point: from the resolution, otherwise from six significant digits of the
        greatest value; None if neither is known."""
        if (digits := Described(self.about).digits) is not None:
            return min(digits, MAX_DIGITS)
        ends = [abs(end) for end in (self.minimum, self.maximum) if end is not None and isfinite(end)]
        greatest = max(ends, default=0.0)
        return min(max(DIGITS - 1 - floor(log10(greatest)), 0), MAX_DIGITS) if greatest else None

    @property
    def resolution(self) -> float:
        """The change of the value for one bit; 0 if the values have no such scale."""
        return abs(float(Described(self.about).resolution or 0.0))

    @property
    def verb(self) -> Verb | None:
        """The verb that sets the item; None if it can only be read."""
        if self.kind is ItemKind.RUN:
            return MODE if self.path == MODE_ITEM else None
        return {ItemKind.ACTUATOR: WRITE, ItemKind.TUNABLE: TUNE}.get(self.kind)

    @property
    def writable(self) -> bool:
        """True if the item is an actuator or a tunable number."""
        return self.verb is not None and self.kind is not ItemKind.RUN


PLAIN = ("sensor", "actuator", "signal")
"""The kinds of items that never share a path."""


@dataclass(frozen=True)
class Declaration:
    """The declaration of a running machine. A declaration does not change from `begin` to `end`."""

    station: str
    wiring: str
    run: str
    """The pid and the start, which identify the run on this computer."""
    period: float
    """The period in s, or 0 if there is none."""
    started: float
    """Start of the run in s since 1970."""
    items: tuple[MachineItem, ...]
    actions: tuple[Mapping[str, Any], ...]
    """Path, help and arguments of each action (`umo.objects.action`)."""
    axes: tuple[Mapping[str, Any], ...]
    """The objects of each axis, and its limits (`umo.control.axis_state`)."""
    units: tuple[Mapping[str, Any], ...]
    """Path, states and commands of each state machine (`umo.operation`)."""
    takes_commands: bool

    @property
    def by_name(self) -> Mapping[str, MachineItem]:
        return {item.name: item for item in self.items}

    def of_kind(self, *kinds: ItemKind) -> list[MachineItem]:
        return [item for item in self.items if item.kind in kinds]


def declaration_of(reader: RunReader) -> Declaration:
    """Return the declaration of a run from its frames."""
    layout, about = reader.layout, reader.about
    return Declaration(
        escaped(str(about["station"]), is_encodable),
        escaped(str(about.get("wiring") or "-"), is_encodable).removeprefix("-"),
        f"{about['pid']}-{about.get('started_monotonic', 0)}",
        float(about["period"]),
        float(about["started"]),
        items_of(layout),
        layout.actions,
        layout.axes,
        layout.units,
        reader.now().mode is not None,
    )


def items_of(layout: Layout) -> tuple[MachineItem, ...]:
    """Return all items that have a value: objects, signals, tunable numbers, states, the run."""
    objects = layout.described.objects
    found = [(ItemKind.ACTUATOR if each.is_actuator else ItemKind.SENSOR, each) for each in objects]
    groups: Sequence[tuple[ItemKind, Iterable[Mapping[str, Any]]]] = (
        (ItemKind.SIGNAL, layout.signals),
        (ItemKind.TUNABLE, layout.tunables),
        (ItemKind.EQUIPMENT, layout.equipment),
        (ItemKind.AXIS, layout.axes),
        (ItemKind.ALARM, layout.alarms),
        (ItemKind.RUN, ({"path": path, **each} for path, each in RUN_ITEMS.items())),
    )
    found += [(kind, Described(each)) for kind, group in groups for each in group]
    return tuple(_item(number, *each) for number, each in enumerate(found))


def _item(number: int, kind: ItemKind, value: Described) -> MachineItem:
    low, high = value.minimum, value.maximum
    if value.states:  # the limits of an axis are those of its position
        low = high = None
    return MachineItem(number, kind, value.path, value.plain, value.unit, low, high, value.states)

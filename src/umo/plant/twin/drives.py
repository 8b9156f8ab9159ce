"""The values that move, colour and show the bodies of a twin: objects and signals, named by their paths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from umo.errors import DeclarationError
from umo.objects.presentation.described import Described
from umo.objects.units import check_unit, convert
from umo.plant.twin.shapes import HERE, Numbers, check_colour, number, numbers, unit_vector
from umo.text import did_you_mean


class Values:
    """The objects and signals of a machine, by path."""

    def __init__(self, entries: Sequence[Described]) -> None:
        self._entries = {entry.path: entry for entry in entries}

    def entry(self, path: str) -> Described:
        """Return the entry at a path. Raises DeclarationError with the nearest path if there is none."""
        if path not in self._entries:
            raise DeclarationError(f"there is no object or signal {path!r}{did_you_mean(path, self._entries)}")
        return self._entries[path]

    def level(self, path: str, state: str) -> float:
        """Return the value that stands for a state."""
        entry = self.entry(path)
        if not entry.states:
            raise DeclarationError(f"{path!r} is a number in {entry.unit!r}; it has no state {state!r}")
        level, names = entry.number_of(state), list(entry.states.values())
        if level is None:
            raise DeclarationError(f"{path!r} has no state {state!r}{did_you_mean(state, names)}: {', '.join(names)}")
        return level

    def line(self, path: str, unit: str, quantity: str) -> tuple[float, float]:
        """Return factor and offset from an entry's values to a unit; the state declared as `one` of a binary object
        counts as 1."""
        entry = self.entry(path)
        if entry.is_binary:
            return 1.0, 0.0
        source = entry.unit
        try:
            zero, one, two = (convert(x, source, unit) for x in (0.0, 1.0, 2.0))
        except DeclarationError:
            what = f"a drive in {unit!r}" if quantity == "" else quantity
            raise DeclarationError(
                f"{path!r} is in {source!r}, which is not {what}: give `scale` for one unit of it, and `per={source!r}`"
            ) from None
        if not math.isclose(two - one, one - zero, rel_tol=1e-6):
            raise DeclarationError(f"{path!r}: the way from {source!r} to {unit!r} is not linear")
        return one - zero, zero


@dataclass(frozen=True)
class Drive:
    """The conversion of a value to a motion: the number in the unit `per`, times `scale`, plus `offset`.

    The result is in m for a slide and in rad for a hinge. `per`: by default m and rad, so that an object in a unit of
    length or angle needs neither `scale` nor `per`. The state declared as `one` of a binary object counts as 1.
    """

    path: str
    scale: float = 1.0
    offset: float = 0.0
    per: str | None = None

    def __post_init__(self) -> None:
        numbers(f"{type(self).__name__} {self.path!r}: scale and offset", (self.scale, self.offset), 2)
        if self.per is not None:
            check_unit(self.per)

    def line(self, values: Values, unit: str) -> tuple[float, float]:
        """Return factor and offset from the object's value to m or rad."""
        quantity = {"m": "a length", "rad": "an angle"}[unit] if self.per is None else ""
        factor, zero = values.line(self.path, self.per or unit, quantity)
        return self.scale * factor, self.scale * zero + self.offset


@dataclass(frozen=True)
class Joint(Drive):
    """Base of the joints, which describe how a body moves relative to its parent. `axis` is in the frame of the body.
    `range`: the stops, beyond which the body is not drawn."""

    axis: Numbers = (0.0, 0.0, 1.0)
    range: tuple[float, float] | None = None

    kind: ClassVar[str]
    unit: ClassVar[str]

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"{type(self).__name__} {self.path!r}"
        unit_vector(f"{what}: axis", self.axis)
        if self.range is not None:
            lowest, highest = numbers(f"{what}: range", self.range, 2)
            if not lowest < highest:
                raise DeclarationError(f"{what}: range is the lower stop, then the upper one, not {self.range!r}")

    def describe(self, values: Values) -> dict[str, Any]:
        factor, offset = self.line(values, self.unit)
        return {
            "kind": self.kind,
            "path": self.path,
            "axis": list(unit_vector("axis", self.axis)),
            "factor": factor,
            "offset": offset,
            "range": None if self.range is None else list(map(float, self.range)),
        }


@dataclass(frozen=True)
class Slide(Joint):
    """Motion along an axis, in m."""

    kind = "slide"
    unit = "m"


@dataclass(frozen=True)
class Hinge(Joint):
    """Rotation about an axis, in rad; positive is counterclockwise, seen against the direction of the axis. `anchor`: a
    point on the axis, m."""

    anchor: Numbers = HERE
    kind = "hinge"
    unit = "rad"

    def __post_init__(self) -> None:
        super().__post_init__()
        numbers(f"Hinge {self.path!r}: anchor", self.anchor, 3)

    def describe(self, values: Values) -> dict[str, Any]:
        return super().describe(values) | {"anchor": list(map(float, self.anchor))}


@dataclass(frozen=True)
class Colour:
    """The colour of a body that depends on a value: `Colour("valve", {"ON": "#2ea043", "OFF": "#555555"})`, or between
    numbers in the object's unit: `Colour("oven", {20: "#333333", 1000: "#ff5020"})`. `shape`: the number of the shape
    that is coloured, from 0; by default all shapes are coloured."""

    path: str
    colours: Mapping[str, str] | Mapping[int, str] | Mapping[float, str]
    shape: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.colours, Mapping):
            raise DeclarationError(
                f"Colour {self.path!r}: `colours` must map states or numbers to colours, not {self.colours!r}"
            )
        for colour in self.colours.values():
            check_colour(f"Colour {self.path!r}", colour)
        if len(self.colours) < 2:
            raise DeclarationError(f"Colour {self.path!r} has {len(self.colours)} colours; it needs at least 2")

    def describe(self, values: Values) -> dict[str, Any]:
        stops = sorted((self._place(values, key), colour) for key, colour in self.colours.items())
        return {"path": self.path, "stops": [list(stop) for stop in stops], "shape": self.shape}

    def _place(self, values: Values, key: str | float) -> float:
        if isinstance(key, str):
            return values.level(self.path, key)
        if values.entry(self.path).is_binary:
            raise DeclarationError(f"{self.path!r} has states, not numbers: name them instead of {key!r}")
        return number(f"Colour {self.path!r}: a place", key)


@dataclass(frozen=True)
class Visible:
    """A condition that shows a body only in one state of an object: `Visible("gripper.pressure", "PASS")`."""

    path: str
    state: str

    def describe(self, values: Values) -> dict[str, Any]:
        return {"path": self.path, "level": values.level(self.path, self.state)}


@dataclass(frozen=True)
class Carried:
    """Loads on a belt. While a sensor is in `state`, a load passes the sensor. The load begins at the body's origin,
    and travels with the belt along the x axis of the body. A load is drawn as a box whose length is computed from the
    time in front of the sensor. `speed`: the path of the belt's speed. `over`: distance in m after which a load is no
    longer drawn. `size`: the width (y) and height (z) of a load, m.
    """

    sensor: str
    state: str
    speed: str
    over: float
    size: Numbers
    colour: str = "#c58b4e"

    def __post_init__(self) -> None:
        numbers(f"Carried {self.sensor!r}: size", self.size, 2)
        check_colour(f"Carried {self.sensor!r}", self.colour)
        if not number(f"Carried {self.sensor!r}: over", self.over) > 0.0:
            raise DeclarationError(f"Carried {self.sensor!r}: over must be above 0 m, not {self.over!r}")

    def describe(self, values: Values) -> dict[str, Any]:
        factor, offset = values.line(self.speed, "m/s", "a speed")
        return {
            "sensor": self.sensor,
            "level": values.level(self.sensor, self.state),
            "speed": self.speed,
            "factor": factor,
            "offset": offset,
            "over": float(self.over),
            "size": list(map(float, self.size)),
            "colour": self.colour,
        }

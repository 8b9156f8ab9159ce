"""Shapes of the bodies of a twin. Lengths are in m, in the frame of the body."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from umo.errors import DeclarationError

Numbers = Sequence[float]
HERE = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
GREY = "#9aa3ad"


def turned(axis: Numbers, degrees: float) -> tuple[float, float, float, float]:
    """Return the rotation by an angle about an axis, as the unit quaternion (w, x, y, z) that `rotation` takes."""
    x, y, z = unit_vector("the axis of a rotation", axis)
    half = math.radians(degrees) / 2
    return math.cos(half), x * math.sin(half), y * math.sin(half), z * math.sin(half)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Base of the shapes. `position`: the centre in m; `rotation`: as `turned` returns it; `colour`: "#rrggbb";
    `opacity`: 0 to 1."""

    position: Numbers = HERE
    rotation: Numbers = UPRIGHT
    colour: str = GREY
    opacity: float = 1.0

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        what = type(self).__name__
        numbers(f"{what}: position", self.position, 3)
        unit_quaternion(f"{what}: rotation", self.rotation)
        check_colour(what, self.colour)
        if not 0.0 <= number(f"{what}: opacity", self.opacity) <= 1.0:
            raise DeclarationError(f"{what}: opacity is 0 to 1, not {self.opacity!r}")
        for name, size in self.sizes().items():
            if not number(f"{what}: {name}", size) > 0.0:
                raise DeclarationError(f"{what}: {name} must be above 0 m, not {size!r}")

    def sizes(self) -> dict[str, float]:
        """Return the lengths of the shape by name, in m."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return the description for the page."""
        return {
            "kind": self.kind,
            "size": list(map(float, self.sizes().values())),
            "position": list(map(float, self.position)),
            "rotation": list(map(float, self.rotation)),
            "colour": self.colour,
            "opacity": float(self.opacity),
        }


@dataclass(frozen=True)
class Cuboid(Shape):
    """A cuboid. `size`: its full lengths along x, y and z."""

    size: Numbers
    kind = "box"

    def sizes(self) -> dict[str, float]:
        return dict(zip(("size x", "size y", "size z"), numbers("Cuboid: size", self.size, 3), strict=True))


@dataclass(frozen=True)
class Ellipsoid(Cuboid):
    """An ellipsoid. `size`: its diameters along x, y and z."""

    kind = "ellipsoid"


@dataclass(frozen=True)
class Sphere(Shape):
    radius: float
    kind = "sphere"

    def sizes(self) -> dict[str, float]:
        return {"radius": self.radius}


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder along z."""

    radius: float
    length: float
    kind = "cylinder"

    def sizes(self) -> dict[str, float]:
        return {"radius": self.radius, "length": self.length}


@dataclass(frozen=True)
class Capsule(Cylinder):
    """A capsule along z, with a half sphere beyond each end of its length."""

    kind = "capsule"


@dataclass(frozen=True)
class Mesh(Shape):
    """A surface of triangles: vertices in m, and for each triangle the numbers of its three vertices, counterclockwise
    from outside."""

    vertices: Sequence[Numbers]
    faces: Sequence[Sequence[int]]
    kind = "mesh"

    def __post_init__(self) -> None:
        super().__post_init__()
        for vertex in self.vertices:
            numbers("Mesh: a vertex", vertex, 3)
        if any(len(face) != 3 or not all(0 <= corner < len(self.vertices) for corner in face) for face in self.faces):
            raise DeclarationError(f"Mesh: a face is three numbers of vertices, 0 to {len(self.vertices) - 1}")

    def describe(self) -> dict[str, Any]:
        vertices = [float(x) for vertex in self.vertices for x in vertex]
        return super().describe() | {"vertices": vertices, "faces": [int(i) for face in self.faces for i in face]}


def number(what: str, given: Any) -> float:
    """Return a finite number; raises DeclarationError otherwise."""
    if isinstance(given, str):
        raise DeclarationError(f"{what} is a number, not {given!r}")
    return numbers(what, (given,), 1)[0]


def numbers(what: str, given: Any, count: int) -> tuple[float, ...]:
    """Return the given number of finite numbers; raises DeclarationError otherwise."""
    try:
        found = tuple(float(x) for x in given)
    except (TypeError, ValueError):
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        many = "a finite number" if count == 1 else f"{count} finite numbers"
        raise DeclarationError(f"{what} is {many}, not {given[0] if count == 1 else given!r}")
    return found


def unit_vector(what: str, given: Any) -> tuple[float, ...]:
    """Return a direction, scaled to length 1."""
    found = numbers(what, given, 3)
    length = math.hypot(*found)
    if length < 1e-9:
        raise DeclarationError(f"{what} has no direction: {given!r}")
    return tuple(x / length for x in found)


def unit_quaternion(what: str, given: Any) -> tuple[float, ...]:
    found = numbers(what, given, 4)
    if abs(math.hypot(*found) - 1.0) > 1e-3:
        raise DeclarationError(f"{what} is a unit quaternion (w, x, y, z), not {given!r}; turned((0, 0, 1), 90) is one")
    return found


def check_colour(what: str, colour: Any) -> str:
    if not (isinstance(colour, str) and re.fullmatch(r"#[0-9a-fA-F]{6}", colour)):
        raise DeclarationError(f'{what}: a colour is written "#rrggbb", not {colour!r}')
    return colour

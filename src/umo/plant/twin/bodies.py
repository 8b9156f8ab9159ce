"""The bodies of a twin, and the viewpoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from umo.errors import DeclarationError
from umo.plant.twin.drives import Carried, Colour, Joint, Values, Visible
from umo.plant.twin.shapes import HERE, UPRIGHT, Numbers, Shape, numbers, unit_quaternion

Driven = Joint | Colour | Visible | Carried


@dataclass(frozen=True)
class Body:
    """A rigid body of the machine: its shapes, and its drives.

    `parent`: the name of the body that carries it, or None if it stands in the world. `position` (m) and `rotation` (as
    `turned` returns it) are relative to the parent while every joint is at 0. `drives` may contain joints, each of
    which acts after the previous one, a colour, a state in which the body is visible, and the loads that the body
    carries.
    """

    name: str
    shapes: Sequence[Shape] = ()
    parent: str | None = None
    position: Numbers = HERE
    rotation: Numbers = UPRIGHT
    drives: Sequence[Driven] = ()

    def __post_init__(self) -> None:
        numbers(f"body {self.name!r}: position", self.position, 3)
        unit_quaternion(f"body {self.name!r}: rotation", self.rotation)
        for shape in self.shapes:
            if not isinstance(shape, Shape):
                raise DeclarationError(f"body {self.name!r}: {shape!r} is not a shape")
        for drive in self.drives:
            if not isinstance(drive, Driven):
                kinds = "Slide, Hinge, Colour, Visible or Carried"
                raise DeclarationError(f"body {self.name!r}: {drive!r} is not a drive ({kinds})")
        for colour in self._all(Colour):
            if colour.shape is not None and not 0 <= colour.shape < len(self.shapes):
                raise DeclarationError(
                    f"body {self.name!r}: Colour {colour.path!r} names shape number {colour.shape}, but the body has "
                    f"only {len(self.shapes)} shapes, counted from 0"
                )

    def _all(self, kind: type[Any]) -> list[Any]:
        return [drive for drive in self.drives if isinstance(drive, kind)]

    def describe(self, values: Values) -> dict[str, Any]:
        """Return the description for the page, with the drives by their effects."""
        try:
            driven = {
                name: [drive.describe(values) for drive in self._all(kind)]
                for name, kind in {"joints": Joint, "colours": Colour, "visible": Visible, "carried": Carried}.items()
            }
        except DeclarationError as error:
            raise DeclarationError(f"twin: body {self.name!r}: {error}") from None
        shapes = [shape.describe() for shape in self.shapes]
        place = {"position": list(map(float, self.position)), "rotation": list(map(float, self.rotation))}
        return {"name": self.name, "parent": self.parent, "shapes": shapes} | place | driven


@dataclass(frozen=True)
class Viewpoint:
    """The view with which the twin is first shown: the positions of the eye and of its target, in m."""

    eye: Numbers
    target: Numbers

    def __post_init__(self) -> None:
        if numbers("Viewpoint: eye", self.eye, 3) == numbers("Viewpoint: target", self.target, 3):
            raise DeclarationError(f"Viewpoint: eye and target are the same place, {self.eye!r}")

    def describe(self) -> dict[str, Any]:
        """Return the description for the page."""
        return {"eye": list(map(float, self.eye)), "target": list(map(float, self.target))}

"""The declaration of a twin: its bodies, how they are connected, and the values that move them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

from umo.cycle.frame import signals_of
from umo.errors import DeclarationError
from umo.objects import Compound, atoms, described, numbers_of
from umo.objects.presentation.described import Described
from umo.plant.twin.bodies import Body, Viewpoint
from umo.plant.twin.drives import Drive, Values
from umo.plant.twin.shapes import number
from umo.process.frames.layout import Layout, describe_signals
from umo.text import did_you_mean


class Twin:
    """The bodies of a machine, in SI units; z is up. `floor`: the height of a floor, m, or None if there is none.
    `view`: the viewpoint; by default everything is seen from the front, the right and above. Raises DeclarationError
    for two bodies with one name, a missing parent, and a circle of parents.
    """

    def __init__(self, bodies: Iterable[Body], *, floor: float | None = 0.0, view: Viewpoint | None = None) -> None:
        self.bodies = tuple(bodies)
        self.floor = None if floor is None else number("twin: floor", floor)
        self.view = view
        known = {body.name: body for body in self.bodies}
        for name, count in Counter(body.name for body in self.bodies).items():
            if count > 1:
                raise DeclarationError(f"twin: {count} bodies are named {name!r}")
        for body in self.bodies:
            if body.parent is not None and body.parent not in known:
                raise DeclarationError(
                    f"twin: body {body.name!r} has no parent {body.parent!r}{did_you_mean(body.parent, known)}"
                )
        try:
            TopologicalSorter({body.name: [body.parent] for body in self.bodies if body.parent}).prepare()
        except CycleError as error:
            circle = error.args[1][::-1]
            text = f"body {circle[0]!r} is carried by itself: {' < '.join(circle)}"
            raise DeclarationError(f"twin: {text}") from None

    @classmethod
    def from_mujoco(
        cls, model: str | os.PathLike[str] | Any, joints: Mapping[str, str | Drive], *, more: Iterable[Body] = ()
    ) -> Twin:
        """Make a twin from the bodies, geoms and joints of a MuJoCo model, given as the path of its file, its XML or an
        `MjModel`.

        `joints`: for each joint that moves, the object that drives the joint: `{"z": "z.encoder"}`, or a `Drive` with
        scale and offset. The object's value in m or rad is the joint's coordinate in MuJoCo (its `qpos`). The other
        joints keep the initial position of the model. `more`: additional bodies. Their parents are bodies of the model,
        given by name. The first camera of the model is the view, its first plane is the floor. Raises DeclarationError
        if MuJoCo is not installed, the model cannot be read, or a joint does not exist.
        """
        from umo.plant.twin.mujoco import parts

        bodies, floor, view = parts(model, joints)
        return cls([*bodies, *more], floor=floor, view=view)

    def describe(self, machine: Compound | Layout) -> dict[str, Any]:
        """Return plain data (JSON) for the page, with values in the units of the frames.

        Raises DeclarationError, with the body and the nearest valid name, for a path that the machine does not have, a
        state that an object does not have, and a unit that does not fit.
        """
        values = Values(entries_of(machine))
        bodies = [body.describe(values) for body in self.bodies]
        view = None if self.view is None else self.view.describe()
        paths = [dict(values.entry(path).plain) for path in sorted(set(_paths(bodies)))]
        return {"bodies": bodies, "floor": self.floor, "view": view, "paths": paths}


def entries_of(machine: Compound | Layout) -> list[Described]:
    """Return the objects and signals, as frames describe them."""
    if isinstance(machine, Layout):
        return machine.described.traced
    return [*map(described, atoms(machine)), *map(Described, describe_signals(signals_of(numbers_of(machine))))]


def _paths(bodies: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yield the paths of all values that the bodies show."""
    for body in bodies:
        for kind in ("joints", "colours", "visible"):
            yield from (drive["path"] for drive in body[kind])
        for load in body["carried"]:
            yield from (load["sensor"], load["speed"])

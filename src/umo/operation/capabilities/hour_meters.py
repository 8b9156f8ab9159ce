"""Hour meters, which count for how long each actuator has been on in all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from umo.objects import Actuator, Number, atoms
from umo.operation.capabilities.attached_part import AttachedPart

HOUR = 3600.0
"""An hour in s."""


class Meter:
    """The hour meter of one actuator."""

    def __init__(self) -> None:
        self.hours = 0.0
        """Time in h for which the device had another value than the default."""


class _Branch:
    """A step of the way to meters: `meters.tank` of `meters.tank.inlet`."""

    def __init__(self, path: str = "") -> None:
        self._path = path

    def add(self, way: Sequence[str], name: str, meter: Meter) -> None:
        """A meter below this step."""
        branch = self
        for step in way:
            branch = vars(branch).setdefault(step, _Branch(f"{branch._path}{step}."))
        vars(branch)[name] = meter

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"there is no actuator at {self._path}{name}")


def _numbers(meters: HourMeters) -> Mapping[str, Number]:
    declared = Number("h", 0.0, kept=True, shown=True)
    return {f"{path}.hours": declared for path in meters._of_actuators()}


class HourMeters(AttachedPart, numbers=_numbers):
    """An hour meter of each actuator of the machine. Write `meters: HourMeters` in the class of the machine, and
    `meters=HourMeters()` where the machine is made. `meters.PATH.hours` is a number that is shown and kept
    (`docs/howto-keep-values.md`).

    An actuator counts as on while its device has another value than its default. The time is measured on the machine's
    clock.
    """

    @cached_property
    def _meters(self) -> dict[str, Meter]:
        """The meters, by path."""
        return {}

    @cached_property
    def _tree(self) -> _Branch:
        """The meters as a tree, by the steps of their paths."""
        return _Branch()

    def _of_actuators(self) -> dict[str, Meter]:
        """The meters by path; an actuator that has none yet gets one."""
        for item in atoms(self._root):
            if isinstance(item, Actuator) and (path := item.path) not in self._meters:
                *way, name = path.split(".")
                self._meters[path] = meter = Meter()
                self._tree.add(way, name, meter)
        return self._meters

    def __getattr__(self, name: str) -> Any:
        """Return the meter of an actuator, or the next part of a path: `meters.tank.inlet`."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in vars(self._tree):
            self._of_actuators()
        return getattr(self._tree, name)

    def attach(self, machine: Any) -> None:
        image, clock, meters = machine.image, machine.clock, self._of_actuators()
        slots = np.array([slot for slot, item in enumerate(image.items) if isinstance(item, Actuator)], np.intp)
        found = [meters[image.items[slot].path] for slot in slots]
        values, defaults = image.columns.values, image.scales.defaults[slots]

        def count() -> None:
            """The hour meters of the actuators."""
            hours = clock.dt / HOUR
            for place in np.flatnonzero(values[slots] != defaults):
                found[place].hours += hours

        machine.phases.showing.append(count)

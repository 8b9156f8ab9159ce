"""How long each actuator has been at work, kept over restarts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from umo.capabilities.attached_part import AttachedPart
from umo.objects import Actuator, Number, atoms

HOUR = 3600.0
"""s."""


class Meter:
    """Of one actuator."""

    def __init__(self) -> None:
        self.hours = 0.0
        """Time in h for which its device had another value than the default."""


def _numbers(meters: HourMeters) -> Mapping[str, Number]:
    declared = Number("h", 0.0, kept=True, shown=True)
    return {f"{path}.hours": declared for path in meters._of_actuators()}


class HourMeters(AttachedPart, numbers=_numbers):
    """An hour meter of each actuator of the machine: `meters: HourMeters` in its class, `meters=HourMeters()` where it
    is made. `meters.PATH.hours` is a number that is shown and kept (`docs/howto-keep-values.md`).

    An actuator is at work while its device has another value than its default. The time is that of the machine's clock.
    """

    def setup(self) -> None:
        self._meters: dict[str, Meter] = {}

    def _of_actuators(self) -> dict[str, Meter]:
        meters: dict[str, Meter] = self.__dict__.setdefault("_meters", {})
        for item in atoms(self._root):
            if isinstance(item, Actuator):
                meters.setdefault(item.path, Meter())
        return meters

    def __getattr__(self, name: str) -> Any:
        """The meter of an actuator, or a step of the way there: `meters.tank.inlet`."""
        if name.startswith("_"):
            raise AttributeError(name)
        return _Way(self._of_actuators(), "").step(name)

    def attach(self, machine: Any) -> None:
        image, clock = machine.image, machine.clock
        meters = self._of_actuators()
        items = [item for item in image.items if item.path in meters]
        slots = np.array([image.slot_of[id(item)] for item in items], np.intp)
        found = [meters[item.path] for item in items]
        values, defaults = image.columns.values, image.scales.defaults[slots]

        def count() -> None:
            hours = clock.dt / HOUR
            for place in np.flatnonzero(values[slots] != defaults):
                found[place].hours += hours

        machine.phases.showing.append(count)


class _Way:
    """The steps of a path, as attributes."""

    def __init__(self, meters: Mapping[str, Meter], path: str) -> None:
        self._meters, self._path = meters, path

    def step(self, name: str) -> Any:
        path = f"{self._path}.{name}".lstrip(".")
        if path in self._meters:
            return self._meters[path]
        if any(each.startswith(f"{path}.") for each in self._meters):
            return _Way(self._meters, path)
        raise AttributeError(f"there is no actuator at {path}")

    __getattr__ = step

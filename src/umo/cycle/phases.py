"""What each phase of a period took: the timer, each driver's sample, the control code, each driver's update.

Watching costs about 0.3 us a transfer, so it is put between the image and its drivers only where someone
looks at it (`umo.frames`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from time import monotonic_ns
from typing import Any, cast

from umo.cycle.image import Image
from umo.drivers.contract import Channel, Driver, IntArray

UNKNOWN = -1


class Phases:
    """Watches one connected image; `names` stand in the order of a period, `ns` holds the last period's times."""

    def __init__(self, image: Image, drivers: Mapping[str, Driver]) -> None:
        names = {id(driver): name for name, driver in drivers.items()}
        inputs = [f"sample {names[id(block.driver)]}" for block in image.inputs]
        outputs = [f"update {names[id(block.driver)]}" for block in image.outputs]
        self.names = ["timer", *inputs, "control", *outputs]
        self._none = [0] * len(self.names)
        self.ns = list(self._none)
        """Duration of each phase in ns; "control" is whatever the drivers did not take."""
        self._control = 1 + len(inputs)
        self._timer: Any = None
        for index, block in enumerate(image.inputs, 1):
            block.driver = cast(Driver, _Watched(block.driver, self.ns, index))
        for index, block in enumerate(image.outputs, self._control + 1):
            block.driver = cast(Driver, _Watched(block.driver, self.ns, index))
        if image.timer >= 0:
            wire = image.wires[image.timer]
            self._timer = wire.driver
            watched = cast(Driver, _Watched(wire.driver, self.ns, 0))
            image.wires[image.timer] = dataclasses.replace(wire, driver=watched)

    def finish(self, execution: int) -> None:
        """The period is over: what is left of its execution time (ns) was spent in control code and in umo."""
        ns = self.ns
        ns[self._control] = execution - sum(ns) + ns[0]

    def clear(self) -> None:
        """A part that is not transferred in the next period took no time in it."""
        self.ns[:] = self._none

    @property
    def wake(self) -> int:
        """ns from the tick to the timer's waking up; UNKNOWN where the timer has no grid of its own."""
        ticker = getattr(self._timer, "ticker", None)
        return UNKNOWN if ticker is None else ticker.woke - ticker.due


class _Watched:
    """Stands before a driver and times its transfers; everything else goes straight through."""

    def __init__(self, driver: Driver, ns: Any, index: int) -> None:
        self._driver = driver
        self._ns = ns
        self._index = index

    def __getattr__(self, name: str) -> Any:
        return getattr(self._driver, name)

    def read(self, channel: Channel) -> int:
        began = monotonic_ns()
        try:
            return self._driver.read(channel)
        finally:
            self._ns[self._index] = monotonic_ns() - began

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        began = monotonic_ns()
        try:
            self._driver.read_many(channels, out)
        finally:
            self._ns[self._index] = monotonic_ns() - began

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        began = monotonic_ns()
        try:
            self._driver.write_many(channels, raws)
        finally:
            self._ns[self._index] = monotonic_ns() - began

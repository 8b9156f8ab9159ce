"""Rate groups: the parts of a machine that act at one rate. The group with the machine's rate is `whole`. Each part
that has another rate (class keyword `every`) is a separate group, with a clock whose ticks are the periods of the part.
If a period of a part has passed during a missed tick, the part runs once, late; the time grid of its periods does not
change.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from types import MethodType

from umo.cycle.clock import Clock
from umo.cycle.image import Image
from umo.objects import Node
from umo.wiring.rates import MACHINE_RATE, Rate


class PartClock(Clock):
    """The clock of a part: its ticks are the part's own periods."""

    __slots__ = ("_base", "_last", "group", "in_c")
    _base: Clock

    def __init__(self, base: Clock, every: int, group: int) -> None:
        self._base = base
        self._last = 0, 0.0
        super().__init__(every * base.period)
        self.group = group
        """The index of the part's group in `RateGroups.parts`."""
        self.in_c = array("d", (self.dt, self.ticks))
        """The values of `dt` and `ticks` in the form that laws in C read."""
        self.restart()

    @property
    def now(self) -> float:
        """The machine's time in s. It also advances between the part's periods."""
        return self._base.now

    @now.setter
    def now(self, value: float) -> None:
        """Do nothing, because the time is the machine's; `Clock` sets this attribute."""

    def read(self) -> float:
        return self._base.read()

    def restart(self) -> None:
        """Restart the clock now."""
        self._last = self._base.number, self._base.now

    def step(self, ticks: int) -> None:
        """Begin a period of the part, `ticks` periods of the part after the last one. `dt` becomes the time since the
        last period."""
        self.missed = ticks if ticks > 1 else 0
        self.missed_in_all += max(ticks - 1, 0)
        self.ticks = max(ticks, 1)
        self.number += self.ticks
        self.measure()

    def measure(self) -> None:
        """Set `dt` to the time since the laws last acted."""
        base, (number, then) = self._base, self._last
        self.dt = (base.number - number) * base.period if base.period else base.now - then
        self.in_c[0], self.in_c[1] = self.dt, self.ticks
        self.restart()


class RateGroup:
    """One group of parts with the same rate: its clock, its blocks and the laws that act in it."""

    def __init__(self, number: int, path: str, clock: Clock, image: Image) -> None:
        self.number = number
        """The index of the group in `Wired.rates`; `MACHINE_RATE` for the machine's rate."""
        self.path = path
        self.clock = clock
        self.inputs = [block for block in image.inputs if block.part == number]
        self.outputs = [block for block in image.outputs if block.part == number]
        self.laws: list[MethodType] = []
        """The laws that act, without those of equipment in fault (`umo.cycle.acting_laws`)."""


class PartGroup(RateGroup):
    """The group of a part that does not have the machine's rate."""

    clock: PartClock

    def __init__(self, number: int, rate: Rate, image: Image, group: int) -> None:
        super().__init__(number, rate.part._path, PartClock(image.clock, rate.every, group), image)
        self.every, self.phase = rate.every, rate.phase
        self.due = 0
        """The number of the period in which the group is due next."""
        self.took: Callable[[int], object] = lambda ns: None
        """The function that is called with the duration in ns of the group's control."""

    def schedule(self, number: int) -> int:
        """Record that the group acts in this period, and compute when it is due next. Return the number of the group's
        periods since the last time."""
        ticks = max((number - self.due) // self.every + 1, 0)
        self.due += ticks * self.every
        return ticks

    def restart(self, number: int) -> None:
        self.clock.restart()
        self.due = number + 1 + (self.phase - number - 1) % self.every


class RateGroups:
    """The groups of one machine."""

    def __init__(self, image: Image) -> None:
        self._rates = rates = image.rates
        self.whole = RateGroup(MACHINE_RATE, "", image.clock, image)
        own = [(number, rate) for number, rate in enumerate(rates) if rate.every > 1]
        self._parts = {number: PartGroup(number, rate, image, group) for group, (number, rate) in enumerate(own)}
        self.parts = list(self._parts.values())
        """The groups of parts, the fastest first."""
        self.all = [self.whole, *self.parts]
        self._queue: list[tuple[int, int]] = []
        """A heap with the period in which each part is due next, and the number of the part."""
        self.restart()

    def of(self, node: Node) -> RateGroup:
        """Return the group to which an object belongs."""
        return self.whole if not self.parts else self._parts.get(self._rates.number(node), self.whole)

    def restart(self) -> None:
        """Make every part due at its next phase."""
        for part in self.parts:
            part.restart(self.whole.clock.number)
        self._queue = [(part.due, part.number) for part in self.parts]
        heapify(self._queue)

    @property
    def any_due(self) -> bool:
        """True if a part is due in this period."""
        return self._queue[0][0] <= self.whole.clock.number

    def take_due(self) -> list[PartGroup]:
        """Return the parts that are due in this period, the fastest first. The periods of these parts begin."""
        number, queue, due = self.whole.clock.number, self._queue, []
        while queue[0][0] <= number:
            key = heappop(queue)[1]
            part = self._parts[key]
            part.clock.step(part.schedule(number))
            heappush(queue, (part.due, key))
            due.append(key)
        return [self._parts[key] for key in sorted(due)]  # numbered from the fastest on

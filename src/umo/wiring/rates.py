"""Rates: the parts of a machine that run at a multiple of its period (the class keyword `every`).

Each part gets a phase, the number of the period in which the part runs first. The phases are chosen so that as few
parts as possible run in the same period.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import gcd
from typing import NamedTuple

from umo.duration import duration, seconds
from umo.objects import Compound, Node, atoms

MACHINE_RATE = -1
"""The value in place of a part's number for an object that runs at the machine's rate."""
MAX_PHASES = 1000
"""The largest number of phases from which the phase of a part is chosen."""
TOLERANCE = 1e-6
"""Permitted deviation of a period from a multiple, as a share of the period."""


class Rate(NamedTuple):
    """The rate of a part of a machine that does not have the machine's rate."""

    part: Compound
    every: int
    """Number of the machine's periods in one period of the part. 1 means that the part lies in another part with
    another rate."""
    phase: int
    """The number of the first period in which the part is due, from 0 to below `every`."""


class RateMap(tuple[Rate, ...]):
    """The parts that do not have the machine's rate, the fastest first, and the part in which each object lies."""

    @cached_property
    def _numbers(self) -> dict[int, int]:
        return {id(rate.part): number for number, rate in enumerate(self)}

    def number(self, node: Node | None) -> int:
        """Return the part's number; `MACHINE_RATE` if the object runs at the machine's rate."""
        while node is not None:
            if (number := self._numbers.get(id(node))) is not None:
                return number if self[number].every > 1 else MACHINE_RATE
            node = node._parent
        return MACHINE_RATE

    def every(self, node: Node | None) -> int:
        """Return the number of the machine's periods in one period of the object."""
        number = self.number(node)
        return 1 if number == MACHINE_RATE else self[number].every


NO_RATES = RateMap()
"""The rates of a machine whose parts all run at the machine's rate."""


def rates_of(root: Compound, period: float | None, mistake: Callable[[str], object]) -> RateMap:
    """Return the parts that do not have the machine's rate, the fastest first. `period` is in s; None without a timer.
    `mistake` is called with each `every` that does not fit the period."""
    found: list[tuple[Compound, int]] = []

    def look_below(node: Node, every: int) -> None:
        for child in node._children.values() if isinstance(node, Compound) else ():
            own = every
            if isinstance(child, Compound):
                own = _multiple(child, period, mistake) or every
                if own != every:
                    found.append((child, own))
            look_below(child, own)

    look_below(root, 1)
    return RateMap(_spread(sorted(found, key=lambda each: each[1])))


def _multiple(part: Compound, period: float | None, mistake: Callable[[str], object]) -> int | None:
    """Return the number of periods that the class of a part declares; None if the class declares none, or none that
    fits."""
    given = part._settings.every
    if not isinstance(given, str):
        return given
    name = f"`every` of {part._path}, {given}"
    if period is None:
        mistake(f'{name}: the machine has no timer, and so no period; give a number of samplings, "every=10"')
        return None
    wanted = seconds(given)
    multiple = max(round(wanted / period), 1)
    if abs(multiple * period - wanted) <= TOLERANCE * wanted:
        return multiple
    below = max(int(wanted / period), 1)
    nearest = " and ".join(
        duration(each * period) for each in dict.fromkeys((below, below + (below < wanted / period)))
    )
    mistake(f"{name}, is not a multiple of {duration(period)}; the nearest: {nearest}")
    return None


def _spread(parts: Sequence[tuple[Compound, int]]) -> Iterator[Rate]:
    """Give each part the first of those phases in which it meets the fewest other parts. Parts of n and m periods meet
    if their phases are equal modulo the greatest common divisor of n and m."""
    placed: dict[int, Counter[int]] = {}
    """The objects in each phase, by the number of periods."""
    for part, every in parts:
        met = [(gcd(every, other), phases) for other, phases in placed.items()]
        loads = [(divisor, _folded(phases, divisor)) for divisor, phases in met]
        phases = range(min(every, MAX_PHASES))
        phase = min(phases, key=lambda each: sum(load[each % divisor] for divisor, load in loads))
        if every > 1:
            placed.setdefault(every, Counter())[phase] += 1 + len(list(atoms(part)))
        yield Rate(part, every, phase)


def _folded(phases: Counter[int], divisor: int) -> Counter[int]:
    found: Counter[int] = Counter()
    for phase, load in phases.items():
        found[phase % divisor] += load
    return found

"""A machine with kept numbers, on the circuit of `process_box`."""

from __future__ import annotations

from dataclasses import KW_ONLY, field
from enum import Enum
from typing import Annotated

from helpers import process_box
from umo.cycle.sequences import next_period
from umo.objects.range import Number


class Mode(Enum):
    SLOW = "slow"
    FAST = "fast"


class Counting(process_box.Machine):
    """All its kept numbers are those of one period: `count`, twice it, whether it is odd."""

    _: KW_ONLY
    count: Annotated[int, Number("", 0, 1e9, kept=True)] = 0
    double: Annotated[float, Number("mm", 0.0, 1e9, kept=True, tunable=True)] = 0.0
    odd: Annotated[bool, Number(kept=True)] = False
    mode: Annotated[Mode, Number(kept=True)] = Mode.SLOW
    gain: Annotated[float, Number("", 0.0, 10.0, tunable=True)] = field(default=1.0)

    def control(self) -> None:
        self.count += 1
        self.double = 2.0 * self.count
        self.odd = self.count % 2 == 1
        self.mode = Mode.FAST if self.odd else Mode.SLOW


def machine() -> Counting:
    made = process_box.machine(Counting)
    assert isinstance(made, Counting)
    return made


async def count(m: Counting, periods: int = 20) -> int:
    before = m.count
    for _ in range(periods):
        await next_period()
    return before


async def forever(m: Counting) -> int:
    return await count(m, 10**9)

"""The table: which implementation does which work, timed in turns.

Every case runs in short batches, all cases one after the other, round after round, so that a busy neighbour or a change
of the clock's frequency hits all alike. A figure is microseconds per period (or per writing of all actuators); minimum
and median are over the batches. Python's garbage collector is off while timing, as umo's control process has it.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter_ns
from typing import Any

from bench import native
from bench.byhand import ByHand
from bench.driver import Fill, Loop
from bench.machine import Umo
from bench.mix import SIZES, commands, layout, readings

ROWS = {
    "a": "umo",
    "b": "the paper's design in C++, -O2",
    "c": "plain C loops over arrays",
    "d": "Python written by hand",
}
SCAN_LOOP = "sample + update, driver in plain Python"
SCAN_FILL = "sample + update, driver fills arrays"
WRITE = "write every actuator, each by itself"
VECTOR = "write every actuator, by Vector"
PERIOD = "sample, write each, update, driver in plain Python"
BATCH_US = 800.0


@dataclass
class Case:
    """One implementation at one work: `run(periods)` is timed."""

    work: str
    count: int
    row: str
    run: Callable[[int], None]
    periods: int = 1
    times: list[float] = field(default_factory=list)

    def calibrate(self) -> None:
        """As many periods as fill a batch, by the shortest of three: one held up would leave few, and cold."""
        self.run(3)
        while self.periods < 100_000 and (took := min(self.once() for _ in range(3))) < BATCH_US / 2:
            self.periods = max(self.periods + 1, int(self.periods * min(10.0, BATCH_US / max(took, 1.0))))
        self.times.clear()

    def once(self) -> float:
        """Run one batch; how long it took, in us."""
        start = perf_counter_ns()
        self.run(self.periods)
        took = (perf_counter_ns() - start) * 1e-3
        self.times.append(took / self.periods)
        return took


@dataclass(frozen=True)
class Figure:
    minimum: float
    median: float


Table = dict[tuple[str, int, str], Figure]
"""Figures by work, number of objects and row."""


def measure(rounds: int, sizes: Sequence[int] = SIZES) -> Table:
    """All cases in turns."""
    with ExitStack() as stack:
        cases = [case for count in sizes for case in make(count, stack)]
        with quiet():
            take_turns(cases, rounds)
    table = {(case.work, case.count, case.row): Figure(min(case.times), median(case.times)) for case in cases}
    for (work, count, row), figure in list(table.items()):
        if work == SCAN_LOOP and row in "bc":
            table[SCAN_FILL, count, row] = figure  # their driver is the same in both
        if work == WRITE and row in "bcd":
            table[VECTOR, count, row] = figure  # they have no vector: the same writing of each
    return table


def make(count: int, stack: ExitStack) -> Iterator[Case]:
    """The cases of one number of objects, loaded and run once."""
    looped = implementations(count, Loop, stack)
    filled = implementations(count, Fill, stack)
    for row, one in looped.items():
        yield Case(SCAN_LOOP, count, row, one.sample_update)
        yield Case(WRITE, count, row, one.write)
        if count == 13:
            yield Case(PERIOD, count, row, one.period)
    yield Case(VECTOR, count, "a", looped["a"].write_vectors)
    for row in "ad":
        yield Case(SCAN_FILL, count, row, filled[row].sample_update)


def implementations(count: int, driver: type[Loop], stack: ExitStack) -> dict[str, Any]:
    """Those of one number of objects by row, all with the same readings and the same commands."""
    plan = layout(count)
    found: dict[str, Any] = {"a": Umo(plan, driver(plan.sensors, plan.actuators))}
    stack.callback(found["a"].close)
    if native.missing() is None:
        found |= {"b": native.Native("paper", plan), "c": native.Native("floor", plan)}
    found["d"] = ByHand(plan, driver(plan.sensors, plan.actuators))
    for one in found.values():
        one.prepare(commands(plan))
        one.load(readings(plan))
        one.period(1)
    return found


def take_turns(cases: Sequence[Case], rounds: int) -> None:
    for case in cases:
        case.calibrate()
    for _ in range(rounds):
        for case in cases:
            case.once()


@contextmanager
def quiet() -> Iterator[None]:
    """No garbage collection."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()

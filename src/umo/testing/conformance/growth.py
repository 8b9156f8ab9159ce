"""Memory that is left over by calls that are repeated."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic

from umo.testing.conformance.rules import RuleBroken
from umo.testing.conformance.trial import Trial

ROUNDS, MAX_ROUNDS = 3, 9
"""Measurements of memory: a cache may still fill in the first ones. There are more if it grew in each of them."""
CACHE_FILLING_CALLS = 5000
"""Calls after which a cache is full, if there is time for so many."""
CYCLES = 1000
"""Cycles of one measurement at most."""
FREE_GROWTH = 4096
"""Bytes by which the memory may grow at any rate."""


@dataclass(frozen=True)
class Allowed:
    """Memory that may be left over each time."""

    fewest: int = 30
    """Repetitions that are made at any rate."""
    size: float = 4.0
    """Bytes: less than one entry of a list."""
    circular: float = 0.5
    """Objects that only the garbage collector frees."""


def grows(trial: Trial, repeat: Callable[[], object], what: str, each: Allowed = Allowed()) -> str:
    """RuleBroken if memory is left over; else what was measured."""
    most = CYCLES if trial.cycles is None else max(10, min(CYCLES, trial.cycles // ROUNDS))
    began, count = monotonic(), 0
    while count < min(each.fewest, most) or (count < most and trial.budget.more and monotonic() - began < 1.0):
        repeat()  # warm, and how many fit
        count += 1
    allowed = FREE_GROWTH + each.size * count
    growths: list[int] = []
    circular = 1 << 60
    with _traced():
        while len(growths) < ROUNDS or (min(growths) > allowed and _may_fill(trial, len(growths), count)):
            trial.share = len(growths) / max(ROUNDS, len(growths) + 1)
            gc.collect()
            gc.disable()
            before = tracemalloc.get_traced_memory()[0]
            for _ in range(count):
                repeat()
            circular = min(circular, gc.collect())
            growths.append(tracemalloc.get_traced_memory()[0] - before)
    if circular >= each.circular * count:
        raise RuleBroken(
            f"{circular / count:.3g} objects are left in a circle of references by each of {count} {what}: only the "
            "garbage collector frees them, and it is off in the control process"
        )
    if (growth := min(growths)) > allowed:
        raise RuleBroken(f"the memory grew by {growth} bytes in each {count} {what}, {growth / count:.0f} each time")
    return f"{len(growths)} rounds of {count} {what}"


def _may_fill(trial: Trial, rounds: int, count: int) -> bool:
    return rounds < MAX_ROUNDS or (rounds * count < CACHE_FILLING_CALLS and trial.budget.more)


@contextmanager
def _traced() -> Iterator[None]:
    """What is allocated is counted, and no garbage is collected by itself."""
    own, on = not tracemalloc.is_tracing(), gc.isenabled()
    if own:
        tracemalloc.start()
    if frozen := not gc.get_freeze_count():
        gc.freeze()  # what is there already need not be looked at again and again
    try:
        yield
    finally:
        if frozen:
            gc.unfreeze()
        if on:
            gc.enable()
        if own:
            tracemalloc.stop()

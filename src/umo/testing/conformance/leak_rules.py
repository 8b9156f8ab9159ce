"""Rules of what adds up over many calls: descriptors, threads, memory; the time per transfer."""

from __future__ import annotations

import gc
import os
import threading
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from time import monotonic, perf_counter, sleep
from typing import Any

import numpy as np

from umo.testing.conformance.certificate import TransferTime
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.trial import Trial

DESCRIPTORS = "/proc/self/fd"
RARE = 100
"""Cycles for each time that the driver is opened and closed, and that its connection is dropped."""
FADE = 2.0
"""s until what was closed has ended at the other end too."""
ROUNDS, MOST_ROUNDS = 3, 9
"""Measurements of memory: a cache may still fill in the first ones. More, if it grew in each of them."""
PER_CYCLE = 4.0
"""Bytes by which the memory may grow in each cycle: less than one entry of a list."""
FREE = 4096
"""Bytes by which the memory may grow at any rate."""
TIMED = 1000


@rule("descriptors", "No descriptor is left open over many cycles, openings and lost connections.")
def descriptors(trial: Trial) -> str:
    if not os.path.isdir(DESCRIPTORS):
        raise NotTried("the open descriptors can be counted on Linux only")
    before, after = _churned(trial)["descriptors"]
    if after > before:
        raise RuleBroken(f"{after - before} more descriptors are open after {_openings(trial)} openings")
    return f"{_openings(trial)} openings"


@rule("threads", "No thread is left over.")
def threads(trial: Trial) -> str:
    before, after = _churned(trial)["threads"]
    if after > before:
        raise RuleBroken(f"{after - before} more threads run after {_openings(trial)} openings")
    return f"{_openings(trial)} openings"


def _openings(trial: Trial) -> int:
    return max(3, trial.cycles // RARE)


def _churned(trial: Trial) -> dict[str, tuple[int, int]]:
    """Counts before and after the driver was opened, used, cut off and closed many times; once for both rules."""
    if "churned" not in trial.kept:
        _open_often(trial, 2)  # imports, caches
        before = _counts(trial, None)
        _open_often(trial, _openings(trial))
        after = _counts(trial, before)
        trial.kept["churned"] = {key: (before[key], after[key]) for key in before}
    found: dict[str, tuple[int, int]] = trial.kept["churned"]
    return found


def _open_often(trial: Trial, count: int) -> None:
    line = trial.subject.line
    for number in range(count):
        trial.share = number / count
        with trial.opened() as probe:
            for call, arguments in trial.transfers(probe):
                call(*arguments)
            if line is not None:
                line.drop()
                for _ in range(2):  # the first may find the end of the connection
                    for call, arguments in trial.transfers(probe):
                        trial.failure(call, *arguments)
        if line is not None:
            with line.gone():
                probe = trial.new()
                trial.failure(probe.open)
                trial.failure(probe.close)


def _counts(trial: Trial, goal: dict[str, int] | None) -> dict[str, int]:
    """Descriptors and threads, without those of the line. What is closing is waited for, as far as the goal."""
    end = monotonic() + FADE
    while True:
        gc.collect()  # each time: a call that still runs may leave a cycle behind when it ends
        found = {"descriptors": _descriptors(trial), "threads": threading.active_count()}
        if goal is None or monotonic() >= end or all(found[key] <= goal[key] for key in found):
            return found
        sleep(0.01)


def _descriptors(trial: Trial) -> int:
    line = trial.subject.line
    with suppress(OSError):
        return len(os.listdir(DESCRIPTORS)) - (line.descriptors if line is not None else 0)
    return 0


@rule("memory", "The memory does not grow over many cycles.")
def memory(trial: Trial) -> str:
    cycles = max(10, trial.cycles // ROUNDS)
    with trial.opened(direct=True) as probe:
        cycle = _cycle(trial, probe)
        _repeat(trial, probe, cycle, max(10, cycles // 10))
        allowed = FREE + PER_CYCLE * cycles
        growths = _growths(trial, probe, cycle, cycles, allowed)
    if (growth := min(growths)) > allowed:
        raise RuleBroken(f"the memory grew by {growth} bytes in each {cycles} cycles, {growth / cycles:.0f} a cycle")
    return f"{len(growths)} rounds of {cycles} cycles"


def _growths(trial: Trial, probe: Probe, cycle: Callable[[], object], cycles: int, allowed: float) -> list[int]:
    """The growth in each of some rounds, in bytes."""
    own = not tracemalloc.is_tracing()
    if own:
        tracemalloc.start()
    gc.freeze()  # what is there already need not be looked at again and again
    try:
        growths: list[int] = []
        while len(growths) < ROUNDS or (min(growths) > allowed and len(growths) < MOST_ROUNDS):
            trial.share = len(growths) / max(ROUNDS, len(growths) + 1)
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            _repeat(trial, probe, cycle, cycles)
            gc.collect()
            growths.append(tracemalloc.get_traced_memory()[0] - before)
        return growths
    finally:
        gc.unfreeze()
        if own:
            tracemalloc.stop()


def _repeat(trial: Trial, probe: Probe, cycle: Callable[[], object], count: int) -> None:
    for _ in range(count):
        probe.call("cycle", cycle)


def _cycle(trial: Trial, probe: Probe) -> Callable[[], object]:
    """One read and one write of every channel."""
    driver = probe.driver
    readable = tuple(map(probe.channel, trial.readable))
    outputs = tuple(probe.channel(each.channel) for each in trial.subject.outputs)
    out = np.zeros(len(readable), np.int64)
    levels = [np.array([o.other(i) for o in trial.subject.outputs], np.int64) for i in (0, 1)]
    levels.append(np.array([o.default for o in trial.subject.outputs], np.int64))
    state = [0]

    def cycle() -> None:
        state[0] = (state[0] + 1) % len(levels)
        if outputs:
            driver.write_many(outputs, levels[state[0]])
            driver.write(outputs[0], trial.subject.outputs[0].default)
        if readable:
            driver.read_many(readable, out)
            driver.read(readable[0])

    return cycle


@rule("time", "The median time per transfer is within the timeout; the certificate has the times.")
def time_per_transfer(trial: Trial) -> str:
    count = max(20, min(trial.cycles, TIMED))
    with trial.opened(direct=True) as probe:
        for kind, call in _kinds(trial, probe).items():
            taken = np.zeros(count)
            for number in range(count):
                began = perf_counter()
                probe.call(kind, call)
                taken[number] = perf_counter() - began
            median, p99 = (float(np.percentile(taken, share)) for share in (50, 99))
            trial.times[kind] = TransferTime(median, p99, count)
    if not trial.times:
        raise NotTried("the subject has no channels")
    for kind, each in trial.times.items():
        if each.median > trial.subject.timeout:
            took, allowed = each.median * 1e3, trial.subject.timeout * 1e3
            raise RuleBroken(f"{kind} takes {took:.1f} ms, its timeout is {allowed:g} ms")
    return ", ".join(f"{kind} {each.median * 1e6:.0f} us" for kind, each in trial.times.items())


def _kinds(trial: Trial, probe: Probe) -> dict[str, Callable[[], Any]]:
    """Each kind of transfer of the driver, without what the kit does around it."""
    driver = probe.driver
    kinds: dict[str, Callable[[], Any]] = {}
    if trial.readable:
        readable = tuple(map(probe.channel, trial.readable))
        out = np.zeros(len(readable), np.int64)
        kinds["read"] = lambda: driver.read(readable[0])
        kinds[f"read_many of {len(readable)}"] = lambda: driver.read_many(readable, out)
    if trial.subject.outputs:
        outputs = tuple(probe.channel(each.channel) for each in trial.subject.outputs)
        raws = np.array([each.default for each in trial.subject.outputs], np.int64)
        kinds["write"] = lambda: driver.write(outputs[0], int(raws[0]))
        kinds[f"write_many of {len(outputs)}"] = lambda: driver.write_many(outputs, raws)
    return kinds

"""Rules of what adds up over many calls: descriptors, threads, memory; the time per transfer."""

from __future__ import annotations

import gc
import os
import threading
import tracemalloc
from collections.abc import Callable
from contextlib import contextmanager, suppress
from itertools import cycle
from time import monotonic, perf_counter, sleep
from typing import Any

import numpy as np

from umo.testing.conformance.certificate import TransferTime
from umo.testing.conformance.long_run import LongRun, fails_at_once
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.taps import Tap
from umo.testing.conformance.trial import Trial

DESCRIPTORS = "/proc/self/fd"
OPENINGS = 100
"""Times that the driver is opened and closed, and that its connection is dropped."""
FEWEST = 3
"""Of these, at any rate."""
SILENT = 3
"""Times that it is opened on a line where nobody answers."""
FADE = 5.0
"""s until what was closed has ended at the other end too."""
ROUNDS, MOST_ROUNDS = 3, 9
"""Measurements of memory: a cache may still fill in the first ones. More, if it grew in each of them."""
CACHE = 5000
"""Calls after which a cache is full, if there is time for so many."""
CYCLES = 1000
"""Cycles of one measurement at most."""
FEWEST_CYCLES = 30
PER_CYCLE = 4.0
"""Bytes by which the memory may grow in each cycle: less than one entry of a list."""
FREE = 4096
"""Bytes by which the memory may grow at any rate."""
CIRCULAR = 0.5
"""Objects for each call that only the garbage collector frees."""
TIMED = 300


@rule(
    "descriptors",
    "No descriptor is left open over many openings, lost connections, and openings without an answer.",
    Cost(opens=9, each=18, waits=4, more=600),
)
def descriptors(trial: Trial) -> str:
    if not os.path.isdir(DESCRIPTORS):
        raise NotTried("the open descriptors can be counted on Linux only")
    before, after, openings = _churned(trial)["descriptors"]
    if after > before:
        raise RuleBroken(f"{after - before} more descriptors are open after {openings} openings")
    return f"{openings} openings"


@rule("threads", "No thread is left over.", Cost(opens=0, each=0))
def threads(trial: Trial) -> str:
    """Counted together with the descriptors."""
    before, after, openings = _churned(trial)["threads"]
    if after > before:
        raise RuleBroken(f"{after - before} more threads run after {openings} openings")
    return f"{openings} openings"


def _churned(trial: Trial) -> dict[str, tuple[int, int, int]]:
    """Counts before and after the driver was opened, used, cut off and closed many times, and how often; once for both
    rules."""
    if "churned" not in trial.kept:
        most = OPENINGS if trial.cycles is None else max(FEWEST, trial.cycles // OPENINGS)
        _open_often(trial, 2, 2, 1)  # imports, caches
        before = _counts(trial, None)
        openings = _open_often(trial, FEWEST, most, SILENT)
        after = _counts(trial, before)
        trial.kept["churned"] = {key: (before[key], after[key], openings) for key in before}
        trial.spare("descriptors", [f"{openings} of {most} openings"] if openings < most else [])
    found: dict[str, tuple[int, int, int]] = trial.kept["churned"]
    return found


def _open_often(trial: Trial, least: int, most: int, silent: int) -> int:
    """How often it was opened and used."""
    line, number = trial.subject.line, 0
    while number < least or (number < most and trial.budget.more):
        trial.share = number / most
        _open_and_cut(trial)
        number += 1
    for _ in range(silent if line is not None else 0):
        assert line is not None
        probe = trial.new()
        trial.hurry(probe)
        with line.silent():
            trial.failure(probe.open)
            trial.failure(probe.close)
    return number


def _open_and_cut(trial: Trial) -> None:
    line = trial.subject.line
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


@rule("time", "The median time per transfer is within the timeout; the certificate has the times.", Cost(each=20))
def time_per_transfer(trial: Trial) -> str:
    with trial.opened(direct=True) as probe:
        kinds = _kinds(trial, probe)
        for kind, call in kinds.items():
            taken: list[float] = []
            most = TIMED if trial.cycles is None else max(20, min(trial.cycles, TIMED))
            while len(taken) < 5 or (len(taken) < most and trial.budget.more):
                began = perf_counter()
                probe.call(kind, call)
                taken.append(perf_counter() - began)
            median, p99 = (float(np.percentile(taken, share)) for share in (50, 99))
            trial.times[kind] = TransferTime(median, p99, len(taken))
    if not trial.times:
        raise NotTried("the subject has no channels")
    for kind, each in trial.times.items():
        if each.median > trial.subject.timeout:
            took, limit = each.median * 1e3, trial.subject.timeout * 1e3
            raise RuleBroken(f"{kind} takes {took:.1f} ms, its timeout is {limit:g} ms")
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


@rule(
    "long run",
    "Over many transfers no call fails, each reading is right, and the process does not grow.",
    Cost(each=30),
)
def long_run(trial: Trial) -> str:
    """Direct, without the line. 70,000 transfers pass the end of a number of 16 bits."""
    with trial.opened(direct=True) as probe:
        run = LongRun(trial, probe)
        run.go()
    trial.spare("long run", [f"{run.calls:,} of {run.most:,} transfers"] if run.calls < run.most else [])
    return run.remark


@rule(
    "memory",
    "Python's memory does not grow over many calls, without the garbage collector; also not by calls that fail.",
    Cost(each=100, more=2000),
)
def memory(trial: Trial) -> str:
    """As in the control process, the collector is off: an error that holds its own frame stays for ever."""
    with trial.opened(direct=True) as probe:
        run = LongRun(trial, probe)
        words = []
        for what, repeat in (("cycles", run.cycle), ("failed calls", run.fail)):
            if what == "failed calls" and not run.failing:
                words.append("no call can be made to fail at once")
                continue
            words.append(_grows(trial, repeat, what))
    if trial.subject.line is not None:
        words.append(_without_a_device(trial, trial.subject.line))
    return ", ".join(words)


def _without_a_device(trial: Trial, line: Tap) -> str:
    """As `_grows`, of calls that fail as the device is away."""
    with trial.opened() as probe, line.gone():
        trial.hurry(probe)
        calls = [call for call in trial.transfers(probe) if fails_at_once(trial, *call)]
        turns = cycle(calls)
        if not calls:
            return "calls without the device do not fail at once"

        def fail() -> None:
            call, arguments = next(turns)
            trial.failure(call, *arguments)

        return _grows(trial, fail, "calls without the device")


def _grows(trial: Trial, repeat: Callable[[], object], what: str) -> str:
    """RuleBroken if memory is left over; else what was measured."""
    most = CYCLES if trial.cycles is None else max(10, min(CYCLES, trial.cycles // ROUNDS))
    began, count = monotonic(), 0
    while count < min(FEWEST_CYCLES, most) or (count < most and trial.budget.more and monotonic() - began < 1.0):
        repeat()  # warm, and how many fit
        count += 1
    allowed = FREE + PER_CYCLE * count
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
    if circular >= CIRCULAR * count:
        raise RuleBroken(
            f"{circular / count:.3g} objects are left in a circle of references by each of {count} {what}: only the "
            "garbage collector frees them, and it is off in the control process"
        )
    if (growth := min(growths)) > allowed:
        raise RuleBroken(f"the memory grew by {growth} bytes in each {count} {what}, {growth / count:.0f} each time")
    return f"{len(growths)} rounds of {count} {what}"


def _may_fill(trial: Trial, rounds: int, count: int) -> bool:
    return rounds < MOST_ROUNDS or (rounds * count < CACHE and trial.budget.more)


@contextmanager
def _traced() -> Any:
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

"""Rules of what adds up over many calls: descriptors, threads, memory; the time per transfer."""

from __future__ import annotations

import gc
import os
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from itertools import cycle
from time import monotonic, perf_counter, sleep
from typing import Any

import numpy as np

from umo.presentation.digits import number_text
from umo.presentation.durations import duration
from umo.testing.conformance.certificate import TransferTime, time_text
from umo.testing.conformance.long_run import WARMING_CYCLES, LongRun, fails_at_once
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.taps import Tap
from umo.testing.conformance.trial import Trial

DESCRIPTORS = "/proc/self/fd"
OPENINGS = 100
"""Times that the driver is opened and closed, and that its connection is dropped."""
FEWEST_OPENINGS = 3
"""Openings that are made at any rate."""
SILENT_OPENINGS = 3
"""Openings on a line where nobody answers."""
MAX_CLOSING_TIME = 5.0
"""Time in s until what was closed has ended at the other end too."""
TIMED_CALLS = 300
"""Calls of each kind that are timed at most."""
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


PER_LOST_CONNECTION = Allowed(fewest=FEWEST_OPENINGS, size=1024.0, circular=50.0)
"""Memory that may be left over by each lost connection: one is lost seldom."""


@rule(
    "descriptors",
    "No descriptor is left open and no thread is left over, by many openings, lost connections, and calls without an "
    "answer.",
    Cost(opens=9, each=18, waits=16, more=600),
)
def descriptors(trial: Trial) -> str:
    most = OPENINGS if trial.cycles is None else max(FEWEST_OPENINGS, trial.cycles // OPENINGS)
    _open_often(trial, 2, 2, 1)  # imports, caches
    before = _counts(trial, None)
    # The closed drivers are kept: closing is not left to the garbage collector.
    closed = _open_often(trial, FEWEST_OPENINGS, most, SILENT_OPENINGS)
    after, openings = _counts(trial, before), len(closed) - SILENT_OPENINGS
    trial.left_out += [f"{openings} of {most} openings"] if openings < most else []
    for what, number in before.items():
        if after[what] > number:
            raise RuleBroken(f"{after[what] - number} {what} more than before are there after {openings} openings")
    return f"{openings} openings"


def _open_often(trial: Trial, least: int, most: int, silent: int) -> list[Probe]:
    """Opened, used and closed; the last `silent` ones on a line where nobody answers."""
    closed: list[Probe] = []
    while len(closed) < least or (len(closed) < most and trial.budget.more):
        trial.share = len(closed) / most
        closed.append(_open_and_cut(trial))
    return closed + [_open_in_silence(trial) for _ in range(silent)]


def _open_in_silence(trial: Trial) -> Probe:
    probe, line = trial.new(), trial.subject.line
    trial.hurry(probe)
    with line.silent() if line is not None else nullcontext():
        trial.failure(probe.open)
        for call in trial.transfers(probe)[::2]:
            trial.failure(call)
        trial.failure(probe.close)
    return probe


def _open_and_cut(trial: Trial) -> Probe:
    line = trial.subject.line
    with trial.opened() as probe:
        trial.use(probe)
        if line is not None:
            line.drop()
            for _ in range(2):  # the first may find the end of the connection
                trial.try_out(probe)
    if line is not None:
        with line.gone():
            other = trial.new()
            trial.failure(other.open)
            trial.failure(other.close)
    return probe


def _counts(trial: Trial, goal: dict[str, int] | None) -> dict[str, int]:
    """Descriptors and threads, without those of the line. What is closing is waited for, as far as the goal."""
    end = monotonic() + MAX_CLOSING_TIME
    while True:
        gc.collect()  # each time: a call that still runs may leave a cycle behind when it ends
        found = {"open descriptors": _descriptors(trial), "threads": threading.active_count()}
        if goal is None or monotonic() >= end or all(found[key] <= goal[key] for key in found):
            return found
        sleep(0.01)


def _descriptors(trial: Trial) -> int:
    line = trial.subject.line
    with suppress(OSError):
        return len(os.listdir(DESCRIPTORS)) - (line.descriptors if line is not None else 0)
    return 0  # they can be counted on Linux only


@rule("time", "The median time per transfer is within the timeout; the certificate has the times.", Cost(each=20))
def time_per_transfer(trial: Trial) -> str:
    with trial.opened(direct=True) as probe:
        kinds = _kinds(trial, probe)
        for kind, call in kinds.items():
            taken: list[float] = []
            most = TIMED_CALLS if trial.cycles is None else max(20, min(trial.cycles, TIMED_CALLS))
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
            raise RuleBroken(f"{kind} takes {time_text(each.median)}, its timeout is {duration(trial.subject.timeout)}")
    return ", ".join(f"{kind} {time_text(each.median)}" for kind, each in trial.times.items())


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
    "Over many transfers no call fails or becomes slow, each reading is right, and the process does not grow.",
    Cost(each=30),
)
def long_run(trial: Trial) -> str:
    """Direct, without the line. 70,000 transfers pass the end of a number of 16 bits."""
    with trial.opened(direct=True) as probe:
        run = LongRun(trial, probe)
        run.go()
    if run.slow:
        _compare_with_a_new_one(trial, run)
    trial.left_out += [f"{run.calls:,} of {run.most:,} transfers"] if run.calls < run.most else []
    return run.remark


def _compare_with_a_new_one(trial: Trial, run: LongRun) -> None:
    """RuleBroken if a new driver is quicker: else it is the computer or the device that has become slow."""
    with trial.opened(direct=True) as probe:
        new = LongRun(trial, probe)
        new.go(WARMING_CYCLES)
    if run.slower_than(new.early):
        took = f"{time_text(run.late)} after {run.calls:,} transfers, {time_text(new.early)} with a new driver"
        raise RuleBroken(f"a cycle takes {took}")


@rule(
    "memory",
    "Python's memory does not grow over many calls, without the garbage collector; also not by calls that fail.",
    Cost(each=100, more=2000),
)
def memory(trial: Trial) -> str:
    """The collector is off, as in the control process: an error that holds its own frame stays for ever."""
    with trial.opened(direct=True) as probe:
        run = LongRun(trial, probe)
        words = []
        for what, repeat in (("cycles", run.cycle), ("failed calls", run.fail)):
            if what == "failed calls" and not run.failing:
                words.append("no call can be made to fail at once")
                continue
            words.append(_grows(trial, repeat, what))
    if trial.subject.line is not None:
        words.append(_over_lost_connections(trial, trial.subject.line))
        words.append(_without_a_device(trial, trial.subject.line))
    return ", ".join(words)


def _over_lost_connections(trial: Trial, line: Tap) -> str:
    """The measurement (`_grows`) of calls that connect again."""
    with trial.opened() as probe:
        call = trial.transfers(probe)[0]

        def lose() -> None:
            line.drop()
            for _ in range(2):  # the first may find the end of the connection
                trial.failure(call)

        return _grows(trial, lose, "lost connections", PER_LOST_CONNECTION)


def _without_a_device(trial: Trial, line: Tap) -> str:
    """The measurement (`_grows`) of calls that fail as the device is away."""
    with trial.opened() as probe, line.gone():
        trial.hurry(probe)
        calls = [call for call in trial.transfers(probe) if fails_at_once(trial, call)]
        if not calls:
            return "calls without the device do not fail at once"
        turns = cycle(calls)
        return _grows(trial, lambda: trial.failure(next(turns)), "calls without the device")


def _grows(trial: Trial, repeat: Callable[[], object], what: str, each: Allowed = Allowed()) -> str:
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
        while (rounds := len(growths)) < ROUNDS or (
            min(growths) > allowed
            and (rounds < MAX_ROUNDS or (rounds * count < CACHE_FILLING_CALLS and trial.budget.more))
        ):
            trial.share = rounds / max(ROUNDS, rounds + 1)
            gc.collect()
            gc.disable()
            before = tracemalloc.get_traced_memory()[0]
            for _ in range(count):
                repeat()
            circular = min(circular, gc.collect())
            growths.append(tracemalloc.get_traced_memory()[0] - before)
    if circular >= each.circular * count:
        left = f"{number_text(circular / count)} objects are left in a circle of references by each of {count} {what}"
        raise RuleBroken(f"{left}: only the garbage collector frees them, and it is off in the control process")
    if (growth := min(growths)) > allowed:
        raise RuleBroken(f"the memory grew by {growth} bytes in each {count} {what}, {growth / count:.0f} each time")
    return f"{len(growths)} rounds of {count} {what}"


@contextmanager
def _traced() -> Iterator[None]:
    """Memory is counted within the block, and no garbage is collected by itself."""
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

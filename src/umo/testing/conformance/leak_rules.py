"""Rules about descriptors, threads and memory, whose leaks add up over many calls."""

from __future__ import annotations

import gc
import os
import sys
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from itertools import cycle
from time import monotonic, sleep

from umo.digits import number_text
from umo.drivers.optional import Looks
from umo.testing.conformance.certificate import time_text
from umo.testing.conformance.long_run import WARMING_CYCLES, LongRun, fails_at_once
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, RuleBroken, rule
from umo.testing.conformance.taps import Tap

DESCRIPTORS = "/proc/self/fd"
OPENINGS = 100
"""Number of times that the driver is opened and closed, and that its connection is dropped."""
FEWEST_OPENINGS = 3
"""Smallest number of openings."""
LOSSES = 2
"""Number of lost connections and answers within one opening."""
SILENT_OPENINGS = 3
"""Number of openings on a line on which no device answers."""
LOOK_INTERVAL = 0.005
"""Time in s between two looks. It is a period."""
MAX_CLOSING_TIME = 5.0
"""Longest time in s until a closed connection has also ended at the other end."""
ROUNDS, MAX_ROUNDS = 3, 9
"""Usual and largest number of measurements of memory. A cache may still fill during the first ones. More are made if
the memory grew in each of them."""
MAX_WARMING = 1.0
"""Longest time in s for the calls before the first measurement."""
CACHE_FILLING_CALLS = 5000
"""Number of calls after which a cache is full, if there is time for them."""
CYCLES = 1000
"""Largest number of cycles of one measurement."""
FREE_GROWTH, FREE_PIECES = 4096, 6
"""Number of bytes, and number of pieces, by which the memory may always grow."""


@dataclass(frozen=True)
class LeakLimit:
    """The memory that each repetition may leave behind at most."""

    fewest: int = 30
    """Smallest number of repetitions."""
    size: float = 4.0
    """Number of bytes; less than one entry of a list."""
    circular: float = 0.5
    """Number of objects that only the garbage collector frees."""
    pieces: float = 1.5
    """Number of pieces of memory of any size, such as an object that is kept."""


PER_LONGER_CYCLE = LeakLimit(fewest=14, pieces=2.5)  # a record of levels in this process may still fill
PER_LOST_CONNECTION = LeakLimit(fewest=FEWEST_OPENINGS, size=1024.0, circular=50.0, pieces=20.0)
"""The memory that each lost connection may leave behind at most. Connections are rarely lost."""


MORE_OPENINGS = Cost(opens=97, calls=3000, connects=400, waits=400)
"""Calls of the openings beyond the smallest number, for a driver that waits for its timeout after a wrong answer."""


@rule(Cost(opens=16, each=12, calls=115, connects=54, waits=18, sleeps=0.6, more=MORE_OPENINGS))
def descriptors(context: RuleContext) -> str:
    """No additional descriptor stays open and no additional thread stays alive after many openings, lost connections,
    looks, error answers, garbled answers, and calls without an answer, nor after a `close` that fails or ends a look.
    This holds before `close`, too. No child process inherits a descriptor."""
    most = OPENINGS if context.cycles is None else max(FEWEST_OPENINGS, context.cycles // OPENINGS)
    _open_often(context, 2, 2, 1)  # imports, caches
    before, known = _counts(context), frozenset(threading.enumerate())
    # The closed drivers are kept: closing is not left to the garbage collector.
    closed = _open_often(context, FEWEST_OPENINGS, most, SILENT_OPENINGS)
    after, openings = _counts(context, before, known), len(closed) - len(IN_SILENCE) * SILENT_OPENINGS
    context.left_out += [f"{openings} of {most} openings"] if openings < most else []
    for what, number in before.items():
        if after[what] > number:
            raise RuleBroken(f"after {openings} openings there are {after[what] - number} more {what} than before")
    _check_while_open(context)
    _check_inherited(context)
    words = [f"{openings} openings"]
    if context.subject.line is None:
        words.append("there is no line, so no connections were lost and no answers were spoiled")
    return "; ".join(words)


def _check_while_open(context: RuleContext) -> None:
    """Check that lost connections leave no descriptors or threads while the driver is open, because a driver is open as
    long as the machine runs."""
    line = context.subject.line
    if line is None:
        return
    with context.opened() as probe:
        for number in range(1 + LOSSES):
            _lose(context, probe, line)
            context.insist(context.transfers(probe)[0])
            if number == 0:
                before, known = _counts(context), frozenset(threading.enumerate())
        after = _counts(context, before, known)
        for what, count in before.items():
            if (more := after[what] - count) >= LOSSES:
                lost = f"{LOSSES} lost connections, {LOSSES} garbled and {LOSSES} lost answers, and {LOSSES} looks"
                raise RuleBroken(f"after {lost} there are {more} more {what}, while the driver is open")


def _lose(context: RuleContext, probe: Probe, line: Tap) -> None:
    """Lose a connection, garble an answer, lose another answer, and begin a look that is still in progress when the
    next call is made."""
    call = context.transfers(probe)[0]
    line.drop()
    for change in (_all_wrong, lambda answer: b""):
        context.insist(call)
        probe.timeout = context.haste
        context.spoiled(change, False, call)
        probe.timeout = context.patience
    context.look(probe)


def _check_inherited(context: RuleContext) -> None:
    """Check that child processes inherit no descriptor, because a device stays in use as long as any process has its
    descriptor."""
    before = _inherited()
    with context.opened() as probe:
        context.use(probe)
        if left := _inherited() - before:
            raise RuleBroken(
                f"child processes inherit descriptors of the driver (set_inheritable): {len(left)} of them"
            )


def _inherited() -> set[int]:
    """Return the open descriptors that a child process inherits."""
    found = set()
    with suppress(OSError):
        for descriptor in map(int, os.listdir(DESCRIPTORS)):
            with suppress(OSError):
                if os.get_inheritable(descriptor):
                    found.add(descriptor)
    return found


def _open_often(context: RuleContext, least: int, most: int, silent: int) -> list[Probe]:
    """Open, use and close drivers; the last `silent` times also on a line on which no device answers. Return the
    drivers."""
    closed: list[Probe] = []
    longest = 0.0
    while len(closed) < least or (len(closed) < most and context.budget.has(longest)):
        context.share, began = len(closed) / most, monotonic()
        closed.append(_open_and_cut(context))
        longest = max(longest, monotonic() - began)
    return closed + [each(context) for _ in range(silent) for each in IN_SILENCE]


def _open_in_silence(context: RuleContext) -> Probe:
    probe, line = context.new(), context.subject.line
    probe.timeout = context.haste
    with line.silent() if line is not None else nullcontext():
        context.failure(probe.open)
        for call in context.transfers(probe)[::2]:
            context.failure(call)
        _look_often(context, probe)
    _look_often(context, probe)
    context.failure(probe.close)
    return probe


def _close_in_silence(context: RuleContext) -> Probe:
    """Close a driver while no device answers and a look is in progress. Everything must be closed, even if `close`
    raises an error."""
    probe, line = context.new(), context.subject.line
    context.bring_up(probe)
    probe.timeout = context.haste
    with line.silent() if line is not None else nullcontext():
        context.failure(context.transfers(probe)[0])
        for text in tuple(probe.opened):
            context.failure(probe.finalize, text)
        context.look(probe)
        context.failure(probe.close)
    return probe


def _close_unnoticed(context: RuleContext) -> Probe:
    """Close a driver while no device answers, before a call has noticed this."""
    probe, line = context.new(), context.subject.line
    context.bring_up(probe)
    context.failure(context.insist, context.transfers(probe)[0])
    for text in tuple(probe.opened):
        context.failure(probe.finalize, text)
    probe.timeout = context.haste
    with line.silent() if line is not None else nullcontext():
        context.failure(probe.close)
    return probe


IN_SILENCE = (_open_in_silence, _close_in_silence, _close_unnoticed)


def _look_often(context: RuleContext, probe: Probe) -> None:
    """Look until the result is known, or until the permitted time is over."""
    end = monotonic() + 2 * context.haste
    while context.look(probe) is None and monotonic() < end:
        sleep(LOOK_INTERVAL)


def _open_and_cut(context: RuleContext) -> Probe:
    line = context.subject.line
    with context.opened() as probe:
        context.use(probe)
        for text in context.subject.refused:
            for call in context.refused_calls(probe, text):
                context.failure(call)
        if line is not None:
            _garble(context, probe)
            line.drop()
            for _ in range(2):  # the first may find the end of the connection
                context.try_out(probe)
    if line is not None:
        with line.gone():
            other = context.new()
            context.failure(other.open)
            context.failure(other.close)
    return probe


def _garble(context: RuleContext, probe: Probe) -> None:
    """Spoil answers: with every byte wrong, with the last byte wrong, and with the answer to an earlier request."""
    for call in context.transfers(probe)[:4:2]:
        earlier = context.traffic(context.insist, call).answer
        for spoil in (
            _all_wrong,
            lambda answer: answer[:-1] + b"~",
            lambda answer: earlier,  # noqa: B023
        ):
            context.failure(context.insist, call)
            probe.timeout = context.haste
            context.spoiled(spoil, False, call)
            probe.timeout = context.patience


def _all_wrong(answer: bytes) -> bytes:
    return bytes(each ^ 0x95 for each in answer)


def _counts(
    context: RuleContext, goal: dict[str, int] | None = None, known: frozenset[threading.Thread] | None = None
) -> dict[str, int]:
    """Return the number of descriptors, without those of the line, and of threads that are not `known`. Without `known`
    there are no new threads. Wait until the counts are at most those of `goal`, because closing may take time."""
    end = monotonic() + MAX_CLOSING_TIME
    while True:
        gc.collect()  # each time: a call that still runs may leave a cycle behind when it ends
        new = () if known is None else {*threading.enumerate()} - known  # one that was known may have ended meanwhile
        found = {"open descriptors": _descriptors(context), "threads": len(new)}
        if goal is None or monotonic() >= end or all(found[key] <= goal[key] for key in found):
            return found
        sleep(0.01)


def _descriptors(context: RuleContext) -> int:
    line = context.subject.line
    with suppress(OSError):
        return len(os.listdir(DESCRIPTORS)) - (line.descriptors if line is not None else 0)
    return 0  # they can be counted on Linux only


@rule(Cost(each=1, calls=26, settles=2))
def long_run(context: RuleContext) -> str:
    """Over many transfers no call fails or becomes slow, each reading is right, and the process does not grow."""
    # Direct, without the line. 70,000 transfers pass the end of a number of 16 bits
    with context.opened(direct=True) as probe:
        run = LongRun(context, probe)
        run.go()
    if run.slow:
        _compare_with_a_new_one(context, run)
    context.left_out += [f"{run.calls:,} of {run.most:,} transfers"] if run.calls < run.most else []
    return run.remark


def _compare_with_a_new_one(context: RuleContext, run: LongRun) -> None:
    """Raise RuleBroken if a new driver is quicker. Otherwise the computer or the device has become slow."""
    with context.opened(direct=True) as probe:
        new = LongRun(context, probe)
        new.go(WARMING_CYCLES)
    if run.slower_than(new.early):
        took = f"{time_text(run.late)} after {run.calls:,} transfers, {time_text(new.early)} with a new driver"
        raise RuleBroken(f"a cycle has become slower: {took}")


MORE_ROUNDS = Cost(opens=0, each=2000, sleeps=8)
"""Further calls of the rounds, and the usual time in s of those over lost connections and without a device."""


@rule(Cost(opens=3, calls=560, connects=13, sleeps=0.5, more=MORE_ROUNDS))
def memory(context: RuleContext) -> str:
    """Without the garbage collector, Python's memory does not grow over many transfers, alone and as blocks, nor over
    failed calls, lost connections, or looks for a device that is away."""
    # The collector is off, as in the control process: an error that holds its own frame stays for ever
    with context.opened(direct=True) as probe:
        run = LongRun(context, probe)
        words = []
        for what, repeat, each in (
            ("cycles", run.longer_cycle, PER_LONGER_CYCLE), ("failed calls", run.fail, LeakLimit()),
        ):  # fmt: skip
            if what == "failed calls" and not run.failing:
                words.append("no call can be made to fail immediately")
                continue
            words.append(_grows(context, repeat, what, each))
    if context.subject.line is not None:
        words.append(_over_lost_connections(context, context.subject.line))
        words.append(_without_a_device(context, context.subject.line))
    else:
        words.append("there is no line, so no connections were lost")
    return ", ".join(words)


def _over_lost_connections(context: RuleContext, line: Tap) -> str:
    """Measure (`_grows`) calls that connect again. Return the result as text."""
    with context.opened() as probe:
        call = context.transfers(probe)[0]

        def lose() -> None:
            line.drop()
            for _ in range(2):  # the first may find the end of the connection
                context.failure(call)

        return _grows(context, lose, "lost connections", PER_LOST_CONNECTION)


def _without_a_device(context: RuleContext, line: Tap) -> str:
    """Measure (`_grows`) calls that fail because the device is away. Return the result as text."""
    with context.opened() as probe, line.gone():
        probe.timeout = context.haste
        calls = [call for call in context.transfers(probe) if fails_at_once(context, call)]
        if not calls:
            return "calls without the device do not fail immediately"
        turns = cycle(calls)
        words = _grows(context, lambda: context.failure(next(turns)), "calls without the device")
        if not isinstance(probe.driver, Looks):
            return words
        return f"{words}, {_grows(context, lambda: context.look(probe), 'looks for the device')}"


def _grows(context: RuleContext, repeat: Callable[[], object], what: str, each: LeakLimit = LeakLimit()) -> str:
    """Raise RuleBroken if memory is left over; otherwise return the result of the measurement as text."""
    most = CYCLES if context.cycles is None else max(10, min(CYCLES, context.cycles // ROUNDS))
    began, took, count = context.budget.clock(), 0.0, 0
    while count < min(each.fewest, most) or (count < most and took < MAX_WARMING and context.budget.has(ROUNDS * took)):
        repeat()  # warm, and how many fit so often again
        took = context.budget.clock() - began
        count += 1
    allowed, allowed_pieces = FREE_GROWTH + each.size * count, FREE_PIECES + each.pieces * count
    growths: list[int] = []
    pieces: list[int] = []
    circular = 1 << 60
    with _traced():
        while (rounds := len(growths)) < ROUNDS or (
            (min(growths) > allowed or min(pieces) > allowed_pieces)
            and (rounds < MAX_ROUNDS or (rounds * count < CACHE_FILLING_CALLS and context.budget.more))
        ):
            context.share = rounds / max(ROUNDS, rounds + 1)
            gc.collect()
            gc.disable()
            before, there = tracemalloc.get_traced_memory()[0], sys.getallocatedblocks()
            for _ in range(count):
                repeat()
            circular = min(circular, gc.collect())
            growths.append(tracemalloc.get_traced_memory()[0] - before)
            pieces.append(sys.getallocatedblocks() - there)
    if circular >= each.circular * count:
        left = f"{number_text(circular / count)} objects are left in a reference cycle by each of {count} {what}"
        raise RuleBroken(f"{left}: only the garbage collector frees them, and it is off in the control process")
    if (growth := min(growths)) > allowed:
        raise RuleBroken(
            f"the memory grew by {growth} bytes in each round of {count} {what}, {growth / count:.0f} bytes each time"
        )
    if (more := min(pieces)) > allowed_pieces:
        raise RuleBroken(
            f"the memory grew by {more} objects and at least {growth} bytes in each round of {count} {what}"
        )
    return f"{len(growths)} rounds of {count} {what}"


@contextmanager
def _traced() -> Iterator[None]:
    """Return a context in which memory is counted, and no garbage is collected automatically."""
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

"""Rules about the process in which the driver runs: its processor time, Ctrl-C, and other changes that the driver makes
in it."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from threading import get_native_id
from time import monotonic, sleep
from types import FrameType
from typing import Any, TextIO

from umo.drivers.optional import EndsWait
from umo.duration import duration
from umo.errors import text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.process_snapshot import alarm_time, change, state, state_of_thread, threads
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.taps import Tap

IDLE_TIME = 0.25
"""Time in s for which processor time is measured."""
PAUSE = 1.2
"""Time in s for which nothing is called."""
MAX_SHARE = 0.5
"""Largest share of the available processor time that a thread may use while it waits."""
ALARM_TOLERANCE = 0.2
"""Time in s by which the end of a running timer may appear to change."""
TRIES = 2
"""Number of tries, of which the best counts."""
MOST_WAITS = 4
"""Largest number of places in one call at which it is interrupted."""
WAITING_FUNCTIONS = {
    "recv", "recv_into", "recvfrom", "recvfrom_into", "recvmsg", "select", "poll", "read", "readinto", "readline",
    "ioctl", "sleep", "connect",
}  # fmt: skip
"""Functions in C in which drivers wait for their devices."""


@rule(Cost(calls=25, connects=6, waits=6, sleeps=2.5))
def idle(context: RuleContext) -> str | None:
    """Waiting uses no processor time while the device is silent or away, while its connection has ended, between calls,
    and after `close`. A pause between two calls does no harm."""
    if not threads():
        raise NotTried("the kernel does not report the processor time of threads")
    with context.opened() as probe:
        for call in context.transfers(probe)[::2]:
            call()
        _quiet(context, lambda: sleep(IDLE_TIME), "between two calls")
        _works_after_a_pause(context, probe)
        if context.subject.line is not None:
            probe.timeout = max(context.haste, IDLE_TIME)
            for call in context.transfers(probe)[:4:2]:
                for hangup in (False, True):
                    _quiet(context, partial(context.spoiled, lambda answer: b"", hangup, call), "")
        if context.subject.line is not None or context.subject.gone is not None:
            _quiet_while_away(context, probe)
    _quiet(context, lambda: sleep(IDLE_TIME), "after close")
    return None if context.subject.line is not None else "not while the device is silent: there is no line"


def _works_after_a_pause(context: RuleContext, probe: Probe) -> None:
    """Check that each call works after a pause, unless the device has ended the connection."""
    line = context.subject.line
    before = line.open_connections if line is not None else 0
    sleep(PAUSE)
    if line is not None and line.open_connections == before:
        context.must_work(probe, f"a pause of {duration(PAUSE)}")


def _quiet_while_away(context: RuleContext, probe: Probe) -> None:
    """Before a call finds out that the connection is lost, and after it."""
    probe.timeout = context.patience
    for call in context.transfers(probe)[:1]:
        context.insist(call)
    probe.timeout = context.haste
    with context.loss():
        _quiet(context, lambda: sleep(IDLE_TIME), "while the device was away")
        context.try_out(probe)
        _quiet(context, lambda: sleep(IDLE_TIME), "while the device was away, after calls that failed")
    probe.timeout = context.patience
    context.try_out(probe)


def _quiet(context: RuleContext, wait: Callable[[], object], when: str) -> None:
    """Raise RuleBroken if threads that the driver has started, or this thread, use the processor while they should
    wait."""
    shares = []
    for _ in range(TRIES):
        before, began = threads(), monotonic()
        wait()
        took = monotonic() - began
        shares.append(_share(context, before, took))
        if took < IDLE_TIME / 2 or shares[-1] < MAX_SHARE:  # one that ends at once does not wait
            return
    when = when or f"in {context.watch.doing}, while the device was silent or its connection ended"
    raise RuleBroken(f"{min(shares):.0%} of a processor was used {when}")


def _share(context: RuleContext, before: dict[int, tuple[float, float]], took: float) -> float:
    """Return the largest share of processor time of a thread, without the time in which other threads kept it from
    running."""
    own = [tid for tid in before if tid not in context.threads or tid == get_native_id()]
    shares = [0.0]
    for tid, (ran, kept) in threads().items():
        if tid in own:
            shares.append((ran - before[tid][0]) / max(1e-3, took - (kept - before[tid][1])))
    return max(shares)


@rule(Cost(opens=6, calls=35, connects=6, more=further(10)))
def interrupt(context: RuleContext) -> str | None:
    """Ctrl-C ends a call that waits, and KeyboardInterrupt is not turned into another exception. The driver can be used
    after that, because the outputs are then reset. It does not take a late answer to the interrupted call for the
    answer to another call. The same applies after a request to end a wait (`stop_waiting`)."""
    # The interrupt is raised where the call would wait in a function in C
    kinds = len(context.transfers(context.new()))
    _asked_to_stop(context)
    waited = [number for number in range(kinds) if _interrupted(context, number)]
    for number in context.as_time_allows(waited[::2], 1, "kinds of calls that are interrupted later"):
        _interrupted_later(context, number)
        if context.subject.line is not None:
            _answered_late(context, number, context.subject.line)
    if not waited:
        raise NotTried("no call waits in a function that can be interrupted")
    return f"{kinds - len(waited)} of {kinds} kinds of calls did not wait" if len(waited) < kinds else None


def _asked_to_stop(context: RuleContext) -> None:
    """Request a stop while nothing is called. For a timer this ends its next wait."""
    probe = context.new()
    driver = probe.driver
    if not isinstance(driver, EndsWait) or driver.realtime or driver.simulates_time:
        return
    with context.leaving(probe):
        context.bring_up(probe)
        if (error := context.failure(probe.call, "stop_waiting", driver.stop_waiting)) is not None:
            why = "it is called in a signal handler, and must not raise an error"
            raise RuleBroken(f"stop_waiting failed: {text_of(error)}; {why}") from error
        context.must_work(probe, "stop_waiting was called")


def _interrupted(context: RuleContext, number: int) -> bool:
    """Return True if a call of this kind waited, and so was interrupted. A few calls may fail afterwards."""
    probe = context.new()
    try:
        context.bring_up(probe)
        raised = _raised_in(context, context.transfers(probe)[number])
        if raised:
            interrupted = context.watch.doing
            with context.in_haste(probe):
                for _ in range(TRIES):
                    context.try_out(probe)
            context.must_work(probe, f"Ctrl-C ended a {interrupted}")
    finally:
        context.failure(context.leave, probe)
    return bool(raised)


def _interrupted_later(context: RuleContext, number: int) -> None:
    """Interrupt the same call where it waits for the second time, then for the third time, and so on."""
    with context.opened() as probe:
        for waits in range(1, MOST_WAITS):
            call = context.transfers(probe)[number]
            if not _raised_in(context, call, waits):
                return
            for _ in range(TRIES):
                context.failure(call)


def _answered_late(context: RuleContext, number: int, line: Tap) -> None:
    """Check that the late answer to an interrupted call is not taken for the answer to the next call, which gets
    lost."""
    with context.opened() as probe:
        for waits in range(MOST_WAITS):
            calls = context.transfers(probe)
            probe.timeout = context.patience
            context.insist(calls[number])
            before = line.spoiled
            with line.late(behind=line.ordered):
                raised = _raised_in(context, calls[number], waits)
            interrupted, held = context.watch.doing, line.spoiled > before
            probe.timeout = context.haste
            error, lost = context.unanswered(calls[0])
            if raised and held and error is None and lost and context.made_up(probe):
                raise RuleBroken(
                    f"{context.watch.doing} used the late answer to the {interrupted} that Ctrl-C has ended"
                )
            if not raised:
                return


def _raised_in(context: RuleContext, call: Callable[[], object], waits: int = 0) -> str:
    """Interrupt a call when it waits after `waits` earlier waits. Return the function in which it was interrupted, or
    ""."""
    before, interrupt = sys.getprofile(), _Interrupt(waits)
    context.watch.interrupted = False
    sys.setprofile(interrupt)
    try:
        context.failure(call)
    finally:
        sys.setprofile(before)
    if interrupt.raised and not context.watch.interrupted:
        raise RuleBroken(f"{context.watch.doing} swallowed Ctrl-C while it waited in {interrupt.raised}")
    return interrupt.raised


class _Interrupt:
    """A profile function that raises KeyboardInterrupt once, in a function that waits, after `waits` earlier waits."""

    def __init__(self, waits: int) -> None:
        self.raised, self._waits = "", waits

    def __call__(self, frame: FrameType, event: str, function: Any) -> None:
        if event != "c_call" or self.raised or getattr(function, "__name__", "") not in WAITING_FUNCTIONS:
            return
        if self._waits:
            self._waits -= 1
        else:
            self.raised = function.__name__
            raise KeyboardInterrupt


@rule(Cost(calls=46, connects=5, waits=8))
def process(context: RuleContext) -> str | None:
    """The process stays as it was: signals, working directory, default timeout of sockets, environment, locale, time
    zone, processors, priority, limits, garbage collector, child processes, logging, blocked signals, timers, warnings,
    hooks for exceptions, errors of numpy, decimal numbers, where modules are looked for, the mask of new files,
    functions of the standard library. Nothing is printed, even if a call fails or when the driver is no longer used."""
    on, alarm, own = gc.isenabled(), alarm_time(), state_of_thread()
    gc.disable()  # as in the control process
    gc.collect()  # what prints in its destructor is the driver's from here on
    try:
        with _printed(context) as printed:
            remark = _used(context)
            gc.collect()  # its destructor, if that waits for the garbage collector
        if gc.isenabled():
            raise RuleBroken("the driver switched the garbage collector on, which is off in the control process")
    finally:
        (gc.enable if on else gc.disable)()
    if text := "".join(printed).strip():
        raise RuleBroken(f"the driver prints: {text.splitlines()[0]!r}")
    if changed := change(context.before, state()) or change(own, state_of_thread()):
        raise RuleBroken(f"the driver changed {changed}")
    if alarm is not None and (now := alarm_time()) is not None and abs(now - alarm) > ALARM_TOLERANCE:
        raise RuleBroken(
            f"the driver changed the timer of the process that was running, by {duration(round(now - alarm, 1))}"
        )
    return remark


def _used(context: RuleContext) -> str | None:
    """Open, use, leave and release a driver. Return the reason if no call could be made to fail."""
    with context.opened() as probe:
        context.use(probe)
        try:
            _fail(context, probe)
        except NotTried as reason:
            return str(reason)
    return None


def _fail(context: RuleContext, probe: Probe) -> None:
    """Make calls without an answer, with a garbled answer, and without the device. Then make the driver work again."""
    context.fail_some(probe)
    if context.subject.line is not None:
        for call in context.transfers(probe)[::3]:
            _resume(context, probe)
            probe.timeout = context.haste
            context.spoiled(lambda answer: bytes(each ^ 0x95 for each in answer), True, call)
            with context.line.gone():
                context.failure(call)
    _resume(context, probe)


def _resume(context: RuleContext, probe: Probe) -> None:
    """Make calls that may fail because of the consequences of earlier calls."""
    for timeout in (context.haste, context.patience):
        probe.timeout = timeout
        context.try_out(probe)


@contextmanager
def _printed(context: RuleContext) -> Iterator[list[str]]:
    """Return a context that yields the texts printed in it. Texts of threads that are older than the drivers do not
    count, such as the progress of the kit. Records of `logging` do not count either, because the program decides where
    they go."""
    found: list[str] = []

    class Output(StringIO):
        def __init__(self, stream: TextIO) -> None:
            super().__init__()
            self._stream = stream

        def write(self, text: str) -> int:
            if get_native_id() in context.threads:
                return self._stream.write(text)
            found.append(text)
            return len(text)

    last, logging.lastResort = logging.lastResort, logging.NullHandler()
    hook, sys.unraisablehook = sys.unraisablehook, sys.__unraisablehook__  # a test runner may have its own
    try:
        with redirect_stdout(Output(sys.stdout)), redirect_stderr(Output(sys.stderr)):
            yield found
    finally:
        logging.lastResort, sys.unraisablehook = last, hook

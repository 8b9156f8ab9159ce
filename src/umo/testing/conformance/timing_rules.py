"""Rules about the duration of a call, while the device is silent, slow or not there."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from time import monotonic, sleep
from types import ModuleType
from typing import Any, TypeVar

from umo.duration import duration
from umo.errors import text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import MADE_UP, Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.spoiling import first_only

T = TypeVar("T")
TRIES = 3
"""Number of calls of which the shortest counts. During the other calls the computer may have been busy with something
else."""
QUIET_TIME = 0.1
"""Time in s without calls. A driver is judged only if it sends nothing during this time."""
CLOCK_FACTOR = 0.9
"""Share of the elapsed time by which the clock is set back. The clock then runs at a tenth of its speed."""
TRICKLE_TIMEOUT = 0.3
"""Timeout in s of a call whose answer arrives slowly. It is long enough to distinguish two waits from one."""
TRICKLE_STEP = 0.7
"""Time between two bytes of an answer that arrives slowly, as a share of the timeout."""
QUICK_CALLS = 30
"""Number of quick calls before the call whose answer takes longer."""
LEAST_DELAY, MAX_DELAY = 0.15, 2.0
"""Smallest and largest delay in s of an answer. The delay is half of a timeout that is long enough to wait for the
answer. Between the two limits it is twice the short timeout."""
AT_ONCE = 0.1
"""Time in s after which a call that connects slowly must not have connected yet."""
SLOW_SHARE, SLOW_FACTOR = 0.85, 5.0
"""SLOW_SHARE: the time of the answers for one channel as a share of the timeout. SLOW_FACTOR: the timeout as a multiple
of the time of a transfer."""
SLOWLY_CONNECTED = 1.25
"""Timeout in s of a call that needs about 1 s to connect."""
CONNECTING_DELAY = 0.1
"""Time in s after which a request to connect is answered when it is repeated."""


@rule(Cost(opens=5, calls=20, connects=17, waits=24, sleeps=0.2))
def timeout(context: RuleContext) -> str | None:
    """A call without an answer ends within `timeout` with a TimeoutError, even if only the last of its answers is
    missing, if bytes arrive without end, or if nothing answers the request to connect. The driver reads `timeout` in
    each call. `inspect`, `report`, `physical_scale` and `watchdog` also end within the timeout."""
    line = context.line
    with context.opened() as probe:
        context.use(probe)  # what is kept of it must not be given later
        probe.timeout = context.haste
        first: list[DriverCall] = [
            partial(probe.initialize, each.channel, each.default) for each in context.subject.outputs[:1]
        ]
        for call in (*first, *context.transfers(probe)):
            error, lost = _timed(context, probe, partial(context.unanswered, call))
            if error is None and lost and context.made_up(probe):
                raise RuleBroken(f"{context.watch.doing} succeeded without an answer", MADE_UP)
            if error is not None and not isinstance(error, TimeoutError):
                raise RuleBroken(
                    f"{context.watch.doing} raised {type(error).__name__}, not a TimeoutError: {text_of(error)}"
                ) from error
        for call in context.enquiries(probe):
            _alive(context, probe, context.transfers(probe)[0])
            _timed(context, probe, partial(context.unanswered, call))
        for call in context.transfers(probe)[1::2]:  # the blocks
            with line.endless(context.haste / 4):
                in_time(context, probe, call)
            _last_missing(context, probe, call)
    probes = [context.new() for _ in range(TRIES)]
    with line.silent():
        _open_in_time(context, probes)
    return None if _without_a_connection(context) else "requests to connect are always answered on this line"


def _last_missing(context: RuleContext, probe: Probe, call: DriverCall) -> None:
    """Raise RuleBroken if a call of several requests succeeds without the last of its answers. A driver that sends
    requests between its calls is not judged. An attempt in which the last answer was never due is repeated: the
    computer may have been busy with something else."""
    for _ in range(TRIES):
        count = _answers_of_each(context, probe, call)
        if count == 1:
            return
        if count and _judged_without_the_last(context, probe, call, count):
            return


def _answers_of_each(context: RuleContext, probe: Probe, call: DriverCall) -> int:
    """Return how many answers each of two successful calls has, or 0 if their numbers differ. The driver is connected
    then, and has the short timeout."""
    counts = set()
    for _ in range(2):
        _alive(context, probe, call)
        probe.timeout = context.patience
        counts.add(_answers(context, call))
        probe.timeout = context.haste
    return counts.pop() if len(counts) == 1 else 0


def _judged_without_the_last(context: RuleContext, probe: Probe, call: DriverCall, count: int) -> bool:
    """Make the call without the last of its answers. Return True if it came to this answer, or if the driver sends
    requests between its calls."""
    with context.line.counting() as traffic:
        sleep(QUIET_TIME)
    if traffic.asked:
        return True
    seen: list[bytes] = []

    def last(answer: bytes) -> bytes:
        seen.append(answer)
        return b"" if len(seen) >= count else answer

    with context.line.spoiling(last):
        error = context.failure(call)
    if error is None and len(seen) == count and context.made_up(probe):
        raise RuleBroken(f"{context.watch.doing} succeeded without the last of {count} answers", MADE_UP)
    return len(seen) >= count


def _answers(context: RuleContext, call: DriverCall) -> int:
    """Return how many answers a successful call has."""
    seen: list[bytes] = []

    def noted(answer: bytes) -> bytes:
        seen.append(answer)
        return answer

    with context.line.spoiling(noted):
        context.insist(call)
    return len(seen)


def _alive(context: RuleContext, probe: Probe, call: DriverCall) -> None:
    """Make a call that succeeds, so that the driver is connected; then set the short timeout."""
    probe.timeout = context.patience
    context.insist(call)
    probe.timeout = context.haste


@contextmanager
def clock_set_back(seconds: Callable[[], float]) -> Iterator[None]:
    """Return a context in which `time.time` is set back by a time in s, or forward if the time is negative. This also
    affects code that has imported the function by name."""
    right = time.time

    def wrong() -> float:
        return right() - seconds()

    _replace(right, wrong)
    try:
        yield
    finally:
        _replace(wrong, right)


def _replace(old: object, new: object) -> None:
    """Replace a function by another one in all modules that have it."""
    for module in tuple(sys.modules.values()):
        names = vars(module) if isinstance(module, ModuleType) else {}
        for name in [name for name, value in tuple(names.items()) if value is old]:
            setattr(module, name, new)


def _open_in_time(context: RuleContext, probes: list[Probe]) -> None:
    """Check the duration of `open`, which may fail, and of `close`. The quickest of several drivers counts."""
    limit = allowed(context.haste)
    for probe in probes:
        probe.timeout = context.haste
        slow = ""
        for call in (probe.open, probe.close):
            context.failure(call)
            if context.watch.took > limit:
                slow = slow or _slow(context, context.haste)
        if not slow:
            return
    raise RuleBroken(slow)


def _without_a_connection(context: RuleContext) -> bool:
    """Check calls while requests to connect get no answer. Return True if this kind of line can do so."""
    others = [context.new() for _ in range(TRIES)]
    probe = context.new()
    context.bring_up(probe)
    probe.timeout = context.haste
    try:
        with context.line.unreachable() as possible:
            if possible:
                for call in context.transfers(probe, default=False)[1::2]:
                    if in_time(context, probe, call) is None:
                        raise RuleBroken(f"{context.watch.doing} succeeded without a connection")
                _open_in_time(context, others)
    finally:
        context.failure(context.leave, probe)  # whether it works again is judged by the rule vanish
    return possible


def in_time(context: RuleContext, probe: Probe, call: Callable[..., object], *arguments: Any) -> OSError | None:
    """Return the error of a call that must end within its timeout."""
    return _timed(context, probe, partial(context.failure, call, *arguments))


def _timed(context: RuleContext, probe: Probe, attempt: Callable[[], T]) -> T:
    """Return the result of a call that must end within its timeout. The quickest of several attempts counts."""
    for _ in range(TRIES):
        found = attempt()
        if context.watch.took <= allowed(probe.timeout):
            return found
    raise RuleBroken(_slow(context, probe.timeout), f"time of {context.watch.doing}")


def allowed(timeout: float) -> float:
    """Return the permitted time in s: 1.5 times the timeout, plus 50 ms for the computer."""
    return 1.5 * timeout + 0.05


def _slow(context: RuleContext, timeout: float) -> str:
    return f"{context.watch.doing} took {duration(round(context.watch.took, 3))}, its timeout is {duration(timeout)}"


@rule(Cost(calls=14, connects=11, waits=7, sleeps=4.5))
def one_deadline(context: RuleContext) -> str | None:
    """The timeout applies to the whole call. It does not start again with each byte or part of an answer, with each
    channel or request of a block, or after a reconnection, and it does not depend on the wall clock."""
    line, tried = context.line, False
    steady = max(context.haste, TRICKLE_TIMEOUT, SLOW_FACTOR * context.pace.transfer)

    def half(answer: bytes) -> bytes:
        sleep(0.8 * steady)
        return answer[: len(answer) // 2]

    with context.opened() as probe:
        for call in context.transfers(probe)[::2]:
            probe.timeout = context.patience
            context.insist(call)  # connected; what is left behind by the call before is judged by other rules
            probe.timeout = steady
            before = line.spoiled
            with line.trickling(TRICKLE_STEP * steady):
                in_time(context, probe, call)
            with line.spoiling(half):
                in_time(context, probe, call)
            _clock_is_set(context, probe, call, TRICKLE_STEP * steady)
            tried |= line.spoiled > before
        _each_answer_is_slow(context, probe, steady)
        connects = _connects_slowly(context, probe)
    if not tried:
        raise NotTried("no call was answered")
    return None if connects else "connecting cannot be made slow on this line"


def _each_answer_is_slow(context: RuleContext, probe: Probe, steady: float) -> None:
    """Check that blocks end within the timeout if the answers for one channel take most of it. The answers for a block
    then take longer than the timeout, and so do those after a reconnection."""
    calls = context.transfers(probe)
    for single, call in zip(calls[::2], calls[1::2], strict=False):
        probe.timeout = context.patience
        delay = (SLOW_SHARE * steady - context.pace.transfer) / max(1, _answers(context, single))

        def slow(answer: bytes) -> bytes:
            sleep(delay)  # noqa: B023
            return answer

        probe.timeout = steady
        with context.line.spoiling(slow):
            _timed(context, probe, partial(_connected_again, context, call))


def _connected_again(context: RuleContext, call: DriverCall) -> None:
    """Lose the connection, and make the call until it has connected again. The first call may only find the end of the
    connection."""
    context.line.drop()
    for _ in range(2):
        context.failure(call)
        if context.watch.took > AT_ONCE:
            return


def _connects_slowly(context: RuleContext, probe: Probe) -> bool:
    """Let connecting take most of the timeout, and then answer nothing. Return True if this kind of line can do so."""
    with context.line.silent(), context.line.unreachable(CONNECTING_DELAY) as possible:
        probe.timeout = SLOWLY_CONNECTED
        if possible:
            _connected_again(context, context.transfers(probe)[0])
            if context.watch.took > allowed(SLOWLY_CONNECTED):
                slow = _slow(context, SLOWLY_CONNECTED)
                raise RuleBroken(f"{slow}: connecting took about 1 s, and then nothing was answered")
    probe.timeout = context.patience
    context.try_out(probe)
    return possible


def _clock_is_set(context: RuleContext, probe: Probe, call: DriverCall, step: float) -> None:
    """Set the wall clock back repeatedly while an answer arrives slowly. The timeout must not depend on the wall
    clock."""
    began = monotonic()
    try:
        with context.line.trickling(step), clock_set_back(lambda: CLOCK_FACTOR * (monotonic() - began)):
            in_time(context, probe, call)
    except RuleBroken as broken:
        raise RuleBroken(f"{broken}; the clock of the day was set back meanwhile") from broken


@rule(Cost(opens=3, calls=4, waits=8, sleeps=1.2, more=further(60)))
def patience(context: RuleContext) -> str | None:
    """An answer within `timeout` is accepted, even if it takes half of that time, or if connecting is slow. A longer
    timeout that is set after `open` takes effect immediately, because umo sets a longer one for initialise and
    reset."""
    delay = min(max(LEAST_DELAY, 2 * context.haste), MAX_DELAY, context.patience / 2)
    quick = min(context.haste, delay / 2)
    with context.leaving(context.new()) as probe:
        hurried = _open_in_a_hurry(probe, context, quick)
        probe.timeout = context.patience
        for text in context.channels:
            probe.initialize(text, context.default(text))
        for _ in context.as_time_allows(range(QUICK_CALLS), 0, "calls with quick answers"):
            context.use(probe)  # an answer that takes longer than those is taken all the same
        for call in context.transfers(probe)[::-2]:  # the last is a reset
            probe.timeout = quick
            probe.timeout = 2 * delay
            if (error := _failure_when_late(context, call, delay)) is not None:
                times = f"a timeout of {duration(2 * delay)} and an answer after {duration(delay)}"
                raise RuleBroken(f"{context.watch.doing} failed with {times}: {text_of(error)}") from error
    _connects_late(context)
    return None if hurried else f"open needs more than {duration(quick)}: it was opened with the longer timeout"


def _failure_when_late(context: RuleContext, call: DriverCall, delay: float) -> OSError | None:
    """Return the error of a call whose first answer is late in each of several attempts; None if an attempt
    succeeds."""

    def late(answer: bytes) -> bytes:
        sleep(delay)
        return answer

    for _ in range(TRIES):
        with context.line.spoiling(first_only(late)):
            if (error := context.failure(call)) is None:
                break
    return error


def _connects_late(context: RuleContext) -> None:
    """Check that connecting succeeds if requests to connect get lost for a short time, and the kernel repeats them."""
    probe = context.new()
    with context.leaving(probe), context.line.unreachable(CONNECTING_DELAY):
        for call in (partial(context.bring_up, probe), context.transfers(probe)[0]):
            if (error := context.failure(call)) is not None:
                within = f"a timeout of {duration(context.patience)}, and connecting took about 1 s"
                raise RuleBroken(f"{context.watch.doing} failed with {within}: {text_of(error)}") from error


def _open_in_a_hurry(probe: Probe, context: RuleContext, timeout: float) -> bool:
    """Open the driver with a short timeout, and return True if this succeeded. The device or the computer may need
    longer."""
    probe.timeout = timeout
    for _ in range(TRIES):
        if context.failure(probe.open) is None:
            return True
        probe.close()
    probe.timeout = context.patience
    probe.open()
    return False

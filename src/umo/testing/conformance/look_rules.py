"""Rules about looking for a device that does not answer."""

from __future__ import annotations

from time import monotonic, sleep

from umo.drivers.optional import answers_for_device
from umo.duration import duration
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import TRIES, recovers, values

AT_ONCE = 0.1
"""Time in s that a look may take."""
LOOK_TIMEOUT = 1.0
"""Timeout in s of the driver during looks. A look that waited for an answer would take ten times as long as
permitted."""
SLOW_ANSWER = 0.3
"""Time in s after which a slow device answers. It is less than the timeout."""
LOOKS = 10
"""Number of successive looks for a device that is silent."""
LOOK_INTERVAL = 0.005
"""Time in s between two looks. It is a period."""


@rule(Cost(each=5, calls=15, connects=8, waits=6, sleeps=1.6))
def look(context: RuleContext) -> str | None:
    """A look (`look`) for a device that does not answer does not wait, does not find the device, finally reports that,
    and raises nothing except an OSError. When the device is back, a look finds it, even if its answer takes a part of
    the timeout, and the next transfers return true values."""
    kinds = [context.line.silent] if context.subject.line is not None else []
    tried = goes_on = False
    with context.opened() as probe:
        looks = answers_for_device(probe.driver)
        for away in (*kinds, context.loss):
            before = values(context, probe)
            with away():
                if not _fails(context, probe):
                    continue
                tried = True
                _looks_in_vain(context, probe)
                goes_on |= _decides(context, probe)
            _is_found(context, probe, context.patience)
            expected = before if away in kinds else values(context, probe)  # it may have lost its levels
            recovers(context, probe, expected, "it was found by a look" if looks else "it did not answer for some time")
            context.insist(context.transfers(probe)[-1])
            _is_found(context, probe, context.patience, "answers transfers")
        if goes_on and kinds:
            _finds_a_slow_one(context, probe)
    if not tried:
        raise NotTried("no transfer fails without an answer")
    return None if looks else "the driver does not look: a transfer is tried, which may wait"


def _fails(context: RuleContext, probe: Probe) -> bool:
    """Make a transfer, and return True if it fails. umo looks for a device only after a failed transfer."""
    probe.timeout = context.haste
    return context.failure(context.transfers(probe)[0]) is not None


def _looks_in_vain(context: RuleContext, probe: Probe) -> None:
    """Check the duration of looks for a device that does not answer. The quickest of several attempts counts; a failed
    transfer precedes each attempt."""
    slowest = []
    for _ in range(TRIES):
        probe.timeout = LOOK_TIMEOUT
        took = 0.0
        for _ in range(LOOKS):
            _look_in_vain(context, probe)
            took = max(took, context.watch.took)
            if took > AT_ONCE:
                break
            sleep(LOOK_INTERVAL)
        else:
            return
        slowest.append(took)
        _fails(context, probe)
    raise RuleBroken(f"a look for a device that does not answer took {duration(round(min(slowest), 3))}")


def _look_in_vain(context: RuleContext, probe: Probe) -> bool | None:
    """Look for a device that does not answer, and return the result, which must not be True."""
    found = context.look(probe)
    if found is True and answers_for_device(probe.driver) and context.readable:
        raise RuleBroken("look says that the device answers, and it does not")
    return found


def _decides(context: RuleContext, probe: Probe) -> bool:
    """Check that looks for a device that stays away finally report this. Return True if a look has returned None, which
    means "not known yet"."""
    probe.timeout = context.haste
    end, goes_on = monotonic() + context.patience, False
    while _look_in_vain(context, probe) is None:
        goes_on = True
        if monotonic() > end:
            limit = duration(context.patience)
            raise RuleBroken(f"look has not found out for {limit} that the device does not answer: it returns None")
        sleep(LOOK_INTERVAL)
    return goes_on


def _is_found(context: RuleContext, probe: Probe, timeout: float, how: str = "answers again") -> None:
    probe.timeout = timeout
    end = monotonic() + context.patience
    while context.look(probe) is not True:
        if monotonic() > end:
            raise RuleBroken(f"the device {how}, and look has not found it for {duration(context.patience)}")
        sleep(LOOK_INTERVAL)


def _finds_a_slow_one(context: RuleContext, probe: Probe) -> None:
    """Check that a look which returns "not known yet" continues up to the timeout, and finds a device that answers
    within this time."""

    def slow(answer: bytes) -> bytes:
        sleep(SLOW_ANSWER)
        return answer

    with context.line.silent():
        _fails(context, probe)
    with context.line.spoiling(slow):
        how = f"answers after {duration(SLOW_ANSWER)}, with a timeout of {duration(LOOK_TIMEOUT)}"
        _is_found(context, probe, LOOK_TIMEOUT, how)
    context.must_work(probe, "it was found by a look")

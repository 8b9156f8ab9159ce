"""Rules of looking for a device that does not answer."""

from __future__ import annotations

from time import monotonic, sleep

from umo.drivers.contract import Driver
from umo.presentation.durations import duration
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import TRIES, recovers, values

AT_ONCE = 0.1
"""Time in s that a look may take."""
LOOK_TIMEOUT = 1.0
"""Timeout in s of the driver meanwhile: a look that waits would wait ten times as long as it may."""
LOOKS = 10
"""Looks for a device that is silent, in succession."""
LOOK_INTERVAL = 0.005
"""Time in s between two looks: a period."""


@rule(Cost(each=5, calls=10, connects=6, waits=5, sleeps=1.2))
def look(context: RuleContext) -> str | None:
    """Looking for a device that does not answer (`look`) waits for nothing, does not find it, says so in the end,
    and raises nothing but an OSError; when it is back it is found, and the next transfers give true values."""
    kinds = [context.line.silent] if context.subject.line is not None else []
    tried = False
    with context.opened() as probe:
        for away in (*kinds, context.loss):
            before = values(context, probe)
            with away():
                if not _fails(context, probe):
                    continue
                tried = True
                _looks_in_vain(context, probe)
                _decides(context, probe)
            _is_found(context, probe)
            expected = before if away in kinds else values(context, probe)  # it may have lost its levels
            recovers(context, probe, expected, "it was found by a look")
            context.insist(context.transfers(probe)[-1])
    if not tried:
        raise NotTried("no transfer fails without an answer")
    return None if _has_its_own(probe) else "the driver does not look: a transfer is tried, which may wait"


def _has_its_own(probe: Probe) -> bool:
    return type(probe.driver).look is not Driver.look


def _fails(context: RuleContext, probe: Probe) -> bool:
    """Whether a transfer fails, as it does before umo looks for the device."""
    probe.timeout = context.haste
    return context.failure(context.transfers(probe)[0]) is not None


def _looks_in_vain(context: RuleContext, probe: Probe) -> None:
    """The quickest of some attempts counts, each after a transfer that has failed."""
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
    """A look for a device that does not answer, which must not find it."""
    found = context.look(probe)
    if found is True and _has_its_own(probe) and context.readable:
        raise RuleBroken("look says that the device answers, and it does not")
    return found


def _decides(context: RuleContext, probe: Probe) -> None:
    """Looks for a device that stays away come to an end."""
    probe.timeout = context.haste
    end = monotonic() + context.patience
    while _look_in_vain(context, probe) is None:
        if monotonic() > end:
            limit = duration(context.patience)
            raise RuleBroken(f"look has not found out for {limit} that the device does not answer: it returns None")
        sleep(LOOK_INTERVAL)


def _is_found(context: RuleContext, probe: Probe) -> None:
    probe.timeout = context.patience
    end = monotonic() + context.patience
    while context.look(probe) is not True:
        if monotonic() > end:
            raise RuleBroken(f"the device answers again, and look has not found it for {duration(context.patience)}")
        sleep(LOOK_INTERVAL)

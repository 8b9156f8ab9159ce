"""Rules about requests: each is sent once, and an error answer of the device becomes an error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from time import sleep
from typing import Any

from umo.drivers.contract import Direction
from umo.errors import text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.pulses import constant
from umo.testing.conformance.relay import Change, Traffic
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import first_only, recovers, values
from umo.testing.conformance.subject import Output

IDLE_TIME = 0.1
"""Time in s without calls. A driver is judged only if it sends nothing during this time."""
EQUAL_WRITES = 3
"""Number of writes of the same level whose requests are compared."""
REFERENCE_CALLS = 3
"""Number of equal calls whose requests are compared."""


@rule(Cost(opens=2, each=4, calls=66, connects=20, waits=14, sleeps=0.3))
def retry(context: RuleContext) -> str | None:
    """Within a call each request is sent only once, even if it fails, because otherwise a pulse would be sent twice."""
    line = context.line
    faults: list[tuple[str, Change, bool]] = [
        ("got no answer", lambda answer: b"", False),
        ("found the connection closed", lambda answer: b"", True),
        ("got a garbled answer", lambda answer: bytes(each ^ 0x95 for each in answer), False),
        ("got an answer with a wrong byte, but the right beginning and end", _with_a_wrong_byte, False),
        ("got an answer with a missing byte, but the right beginning and end", _without_a_byte, False),
    ]
    opening = _opening(context)  # a greeting before the second attempt is answered, or it is never made: `first_only`
    tried = False
    with context.opened() as probe:
        with line.counting() as traffic:
            sleep(max(IDLE_TIME, context.haste))
        if traffic.asked:
            raise NotTried("the driver sends requests by itself")
        for number in range(len(context.transfers(probe)) - bool(context.subject.outputs)):
            usual = [_counted(context, probe, number) for _ in range(REFERENCE_CALLS)]
            if not usual[0].asked:
                continue
            tried = True
            for what, change, hangup in faults:
                traffic = _counted(context, probe, number, lambda: line.spoiling(first_only(change), hangup=hangup))  # noqa: B023
                _check_once(context, traffic, usual, opening, what)
        _check_refused(context, probe, opening)
        if context.subject.outputs:
            _check_doubled(context, probe, context.subject.outputs[0])
    if not tried:
        raise NotTried("no call sends anything over the line")
    return None


def _with_a_wrong_byte(answer: bytes) -> bytes:
    """Return the answer with one bit of the middle byte changed, so that a digit remains a digit, and a letter usually
    a letter."""
    half = len(answer) // 2
    return answer[:half] + bytes([answer[half] ^ 1]) + answer[half + 1 :]


def _without_a_byte(answer: bytes) -> bytes:
    half = len(answer) // 2
    return answer[:half] + answer[half + 1 :]


def _opening(context: RuleContext) -> list[bytes]:
    """Return what a driver sends to open. A call that connects again may send it too."""
    probe = context.new()
    with context.line.counting() as traffic:
        probe.open()
    context.failure(probe.close)
    return traffic.requests


def _counted(context: RuleContext, probe: Probe, number: int, fault: Callable[[], Any] | None = None) -> Traffic:
    """Return the traffic of one kind of call, with or without a fault. Before the call the outputs are not at their
    defaults."""
    probe.timeout = context.patience
    if context.subject.outputs:
        texts = [each.channel for each in context.subject.outputs]
        context.insist(probe.write_many, texts, [each.other() for each in context.subject.outputs])
    else:
        context.insist(context.transfers(probe)[0])
    call = context.transfers(probe)[number]
    if fault is None:
        return context.traffic(call)
    probe.timeout = context.haste
    with context.line.counting() as traffic, fault():
        context.failure(call)
    return traffic


def _check_once(context: RuleContext, traffic: Traffic, usual: list[Traffic], opening: list[bytes], what: str) -> None:
    """Raise RuleBroken if a request was sent more often than usual."""
    kinds = list(zip(*(each.requests for each in usual), strict=False))
    for alike in kinds:
        most = max(_count(each.requests, alike) for each in usual)
        _check_count(context, traffic, alike, most, opening, what)


def _check_count(
    context: RuleContext, traffic: Traffic, alike: Sequence[bytes], most: int, opening: list[bytes], what: str
) -> None:
    """Raise RuleBroken if there are more equal requests than `most`, plus those in a greeting, which may look the same
    and is sent when the driver connects again."""
    sent = _count(traffic.requests, alike)
    if sent > most + _count(opening, alike):
        raise RuleBroken(f"{context.watch.doing} sent its request {sent} times when it {what}")


def _count(requests: Sequence[bytes], alike: Sequence[bytes]) -> int:
    """Return how many of the requests have the bytes that all of `alike` have in common; if these differ in length, how
    many are as long as the first."""
    same = constant(alike)
    if not same:
        return sum(len(each) == len(alike[0]) for each in requests)
    return sum(
        len(each) == len(alike[0]) and all(each[place] == raw for place, raw in same.items()) for each in requests
    )


def _check_refused(context: RuleContext, probe: Probe, opening: list[bytes]) -> None:
    """Check that a request which the device answers with an error is sent as often as a request that it carries out."""
    probe.timeout = context.patience
    for text in context.subject.refused:
        for number, call in enumerate(context.refused_calls(probe, text)[::2]):
            writes = number or Direction.INPUT not in probe.channel(text).direction
            usual = _usual_of(context, probe, bool(writes))
            refused = [_asked_in_vain(context, call) for _ in range(REFERENCE_CALLS)]
            alike = [each.requests[0] for each in refused if each.requests]
            if usual is not None and alike:
                most = sum(len(each) == len(alike[0]) for each in usual.requests) or 1
                _check_count(context, refused[-1], alike, most, opening, "was refused")


def _asked_in_vain(context: RuleContext, call: DriverCall) -> Traffic:
    with context.line.counting() as traffic:
        context.failure(call)
    return traffic


def _check_doubled(context: RuleContext, probe: Probe, output: Output) -> None:
    """Raise RuleBroken if a successful write sends two requests with the same level. The two requests differ only in
    bytes that also differ between equal writes, such as a number."""
    levels = dict.fromkeys((*(output.other(number) for number in range(3)), output.default))
    sent: dict[int, list[list[bytes]]] = {raw: [] for raw in levels}
    for raw in [*levels] * EQUAL_WRITES:
        with context.line.counting() as traffic:
            probe.write(output.channel, raw)
        sent[raw].append(traffic.requests)
    writes, *others = sent.values()
    for one, two in combinations(range(len(writes[0])), 2):
        first, second = _constant(writes, one), _constant(writes, two)
        common = [place for place in first if first[place] == second.get(place)]
        tells = any(raw.get(place, first[place]) != first[place] for raw in (_constant(each, one) for each in others)
                    for place in common)  # fmt: skip
        if tells and len(common) == len(first.keys() & second.keys()):
            raise RuleBroken(f"write of {output.other()} to {output.channel} sent its request twice")


def _constant(writes: list[list[bytes]], number: int) -> dict[int, int]:
    """Return, by their places, the bytes of the request with this number that are the same in equal writes; none if the
    lengths differ."""
    requests = [each[number] for each in writes if len(each) > number]
    return constant(requests) if len(requests) == len(writes) else {}


def _usual_of(context: RuleContext, probe: Probe, writes: bool) -> Traffic | None:
    """Return the traffic of a single transfer that succeeds."""
    if writes:
        output = context.subject.outputs[0]
        probe.write(output.channel, output.other())
        return context.traffic(probe.write, output.channel, output.default)
    return context.traffic(probe.read, context.readable[0]) if context.readable else None


@rule(Cost(each=4, calls=4, waits=8))
def error_answer(context: RuleContext) -> str | None:
    """An error answer of the device becomes an OSError, not a value and not a timeout."""
    if not context.subject.refused:
        raise NotTried("no channel is known that the device refuses")
    silent, kinds = [], set()
    with context.opened() as probe:
        expected = values(context, probe)
        for text in context.subject.refused:
            for call in context.refused_calls(probe, text):
                with context.in_haste(probe):
                    answered, error = _refusal(context, call)
                if answered == "seen" and isinstance(error, TimeoutError):
                    answered, error = _refusal(context, call)  # with more time: the computer may have been busy
                if not answered:
                    silent.append(context.watch.doing)
                    continue
                kinds.add("writes" if "write" in context.watch.doing else "reads")
                if error is None:
                    raise RuleBroken(f"{context.watch.doing} succeeded, although the device refuses it")
                if isinstance(error, TimeoutError) and answered == "seen":
                    raise RuleBroken(f"{context.watch.doing} timed out, although the device answers it with an error")
                if answered == "seen":
                    _goes_on(context, probe)
            recovers(context, probe, expected, "an error answer")
    words = [f"the kit knows no {each} that the device refuses" for each in ("reads", "writes") if each not in kinds]
    words += [f"the device does not answer {silent[0]}"] if silent else []
    if not kinds:
        raise NotTried("; ".join(words))
    return "; ".join(words) or None


def _goes_on(context: RuleContext, probe: Probe) -> None:
    """Check that the next call succeeds, because after an error answer nothing is pending."""
    refused = context.watch.doing
    call = partial(probe.read, context.readable[0]) if context.readable else context.transfers(probe)[0]
    if (error := context.failure(call)) is not None:
        why = f"{context.watch.doing} failed right after {refused}, which the device answered with an error"
        raise RuleBroken(f"{why}: {text_of(error)}") from error


def _refusal(context: RuleContext, call: DriverCall) -> tuple[str, OSError | None]:
    """Return whether a call that the device refuses was answered ("seen", "" if not, "perhaps" if this is unknown), and
    the error of the call."""
    if context.subject.line is None:
        return "perhaps", context.failure(call)
    with context.subject.line.counting(answers=True) as traffic:
        error = context.failure(call)
    if not traffic.asked:
        return "perhaps", error
    return "seen" if traffic.answer else "", error

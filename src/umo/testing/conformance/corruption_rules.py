"""Rules about answers that are late, old, cut short or garbled."""

from __future__ import annotations

from functools import partial
from random import Random

import numpy as np

from umo.drivers.contract import UNREAD, Direction
from umo.errors import ChannelsFailed
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.relay import Change
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import MADE_UP, Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import (
    MAX_CHANNELS,
    NO_ANSWER,
    Spoilt,
    each_spoiled,
    recovers,
    rewrite,
    spoiled_read,
    values,
    watching,
)

CHECKSUM_SIZES = (1, 2, 4)
"""Numbers of bytes that a checksum may have."""
MANY_LATE = 2
"""Number of consecutive late answers. After so many, a short request number repeats."""
UNSTEADY = (
    "it could not be seen whether answers to reads carry a number, because no input is known to stay the same "
    "(`steady` of an Input, --steady)"
)


@rule(Cost(each=6, calls=47, connects=43, waits=43, settles=2))
def late_answer(context: RuleContext) -> str | None:
    """After one or several timeouts a late answer is never taken for the answer to a later request."""
    # The answer to the later request gets lost: if the call succeeds, it took the late one
    tried = False
    with context.opened() as probe:
        for behind in (False, True) if context.line.ordered else (False,):
            for asked in _calls(context, probe):
                for later in _calls(context, probe):
                    tried |= _comes_late(context, probe, behind, asked, later)
            tried |= _late_level(context, probe, behind)
        for call in _calls(context, probe)[:1]:
            _comes_late(context, probe, False, call, call, MANY_LATE)
        recovers(context, probe, values(context, probe), "late answers")
    if not tried:
        raise NotTried(NO_ANSWER)
    return None if context.line.ordered else "on a serial line: answers that come before the next request"


def _writes(context: RuleContext, probe: Probe) -> list[DriverCall]:
    return [partial(probe.write, each.channel, each.other()) for each in context.subject.outputs[:1]]


def _calls(context: RuleContext, probe: Probe) -> list[DriverCall]:
    """Return reads of two channels, and writes."""
    return [*(partial(probe.read, text) for text in context.readable[:MAX_CHANNELS]), *_writes(context, probe)]


def _comes_late(
    context: RuleContext, probe: Probe, behind: bool, asked: DriverCall, later: DriverCall, times: int = 1
) -> bool:
    """Return True if the first call, made `times` times, had an answer that came after its timeout."""
    line = context.line
    _alive(context, probe)
    before = line.spoiled
    with line.late(behind=behind):
        errors = [context.failure(asked) for _ in range(times)]
    first = context.watch.doing
    if line.spoiled == before:
        return False
    if None in errors and context.made_up(probe):
        raise RuleBroken(f"{first} succeeded before its answer came", MADE_UP)
    error, lost = context.unanswered(later)
    if error is None and lost and context.made_up(probe):
        raise RuleBroken(f"{context.watch.doing} used the late answer to the {first}")
    return True


def _late_level(context: RuleContext, probe: Probe, behind: bool) -> bool:
    """Let a late answer with an earlier level of an output arrive together with the right answer. Return True if an
    answer was late."""
    output = next(iter(context.viewed), None)
    if output is None:
        return False
    view, line = context.view(output), context.line
    old, new = output.default, output.other()
    probe.timeout = context.patience
    probe.write(output.channel, old)
    context.is_read(probe, output, old)
    probe.timeout = context.haste
    before = line.spoiled
    with line.late(behind=behind):
        context.failure(probe.read, view)
    probe.timeout = context.patience
    rewrite(context, probe, output, new, f"a timeout of {view}")
    there, found = context.comes_to(
        lambda: context.insist(probe.read, view), lambda level: context.same(output, new, level)
    )
    if not there and not context.fallen(view, found):
        rewrite(context, probe, output, new, "late answers")
        context.confirm(probe, output, new)
        raise RuleBroken(f"{view} read {found} after a timeout of this read, but {output.channel} is at {new}")
    return line.spoiled > before


def _alive(context: RuleContext, probe: Probe) -> None:
    """Make a call that succeeds, so that the driver is connected; then set the short timeout. After a failure the call
    may fail once."""
    probe.timeout = context.patience
    context.insist(context.transfers(probe)[0])
    probe.timeout = context.haste


@rule(Cost(each=3, calls=4, sleeps=0.3))
def answer_in_pieces(context: RuleContext) -> None:
    """The driver accepts an answer that arrives in several pieces."""
    line = context.line
    with context.opened() as probe:
        expected, before = values(context, probe), line.spoiled
        with line.split():
            recovers(context, probe, expected, "an answer in pieces", tries=1)
            context.must_work(probe, "answers come in pieces")
    if line.spoiled == before:
        raise NotTried(NO_ANSWER)


@rule(Cost(each=4, calls=16, connects=8, waits=8))
def old_answer(context: RuleContext) -> str | None:
    """If answers carry a number, an earlier answer in place of the right one leads to an error."""
    # The number shows: two answers to one call, while nothing changes, are not alike
    with context.opened() as probe:
        tried = False
        why = [] if context.known or not context.readable else [UNSTEADY]
        steady: list[DriverCall] = [partial(probe.read, text) for text in context.known[:1]]
        for call in [*steady, *_writes(context, probe)]:
            _alive(context, probe)
            old = _numbered(context, probe, call)
            if isinstance(old, str):
                why.append(old)
                continue
            for later in _calls(context, probe):
                _alive(context, probe)
                found, changed = context.spoiled(lambda answer: old, False, later)  # noqa: B023
                if changed and not isinstance(found, OSError) and context.made_up(probe):
                    raise RuleBroken(f"{context.watch.doing} succeeded with an earlier answer", MADE_UP)
                tried |= changed
        recovers(context, probe, values(context, probe), "an earlier answer")
    if not tried:
        raise NotTried("; ".join(why) or NO_ANSWER)
    return "; ".join(why) or None


def _numbered(context: RuleContext, probe: Probe, call: DriverCall) -> bytes | str:
    """Return an answer to the call that contains a number, or the reason, as text, why it is not known to contain
    one."""
    probe.timeout = context.patience
    line = context.line
    line.exchanges.clear()
    for _ in range(4):
        call()
    doing = context.watch.doing
    line.settle()
    probe.timeout = context.haste
    exchanges = list(line.exchanges)[-3:]
    if len(exchanges) < 3:
        return f"{doing} has no separate answer on the line"
    requests, answers = zip(*exchanges, strict=True)
    for what, each in (("requests of", requests), ("answers to", answers)):
        if len(set(each)) < 3:
            return f"{what} {doing} carry no number: two of them are the same"
        if len(set(map(len, each))) > 1:
            return f"{what} {doing} have different lengths"
    return bytes(answers[-1])


@rule(Cost(opens=4, calls=100, connects=20, waits=10, settles=15))
def short_answer(context: RuleContext) -> str | None:
    """An answer that is cut short leads to an error, whether the connection then ends, is reset, or stays open."""

    def half(answer: bytes) -> bytes:
        return answer[: len(answer) // 2]

    whole = each_spoiled(
        context,
        [
            Spoilt("no answer and the end of the connection", lambda answer: b"", hangup=True, blind=True),
            Spoilt("no answer and a reset of the connection", lambda answer: b"", reset=True, blind=True),
            Spoilt("half of an answer", half, blind=True, tries=1),
            Spoilt("half of an answer and the end of the connection", half, hangup=True, blind=True),
            Spoilt("the first byte of an answer and the end of the connection", lambda a: a[:1], hangup=True),
        ],
    )
    with context.opened() as probe, watching(context) as watcher:
        for text in context.known[:MAX_CHANNELS]:
            for hangup in (False, True):
                spoiled_read(
                    context, probe, watcher, text, Spoilt("an answer without its end", lambda a: a[:-1], hangup)
                )
    return whole


@rule(Cost(opens=3, each=6, calls=196, connects=47, waits=13, settles=28))
def garbled_answer(context: RuleContext) -> str | None:
    """An answer with a garbled structure (its start, all of it, random bytes) leads to an error. A changed digit or
    register in a valid answer cannot be noticed without a checksum. Such a change is tested only if answers have a
    checksum; then it is also tested in an answer that reports the failure of a channel."""
    random = Random(1998)

    def noise(count: int) -> bytes:
        return bytes(random.randrange(0x80, 0x100) for _ in range(count))

    def half(answer: bytes) -> bytes:
        return noise(len(answer) // 2 or 1) + answer[len(answer) // 2 or 1 :]

    ways = [
        Spoilt("an answer with another first byte", lambda answer: bytes([answer[0] ^ 0xA5]) + answer[1:]),
        Spoilt("an answer with a garbled first half", half),
        Spoilt("random bytes of the length of an answer", lambda answer: noise(len(answer)), blind=True),
        Spoilt("300 random bytes", lambda answer: noise(300), blind=True),
    ]
    if context.subject.checksum:
        bits = [
            Spoilt(f"an answer with a changed bit in byte {place}", _flipped(place, bit))
            for place, bit in ((-1, 7), (-2, 0), (-4, 4), (-6, 2), (0, 6), (1, 1), (2, 3))
        ]
        ways += bits
        ways += [
            Spoilt(f"a changed answer that ends with {size} bytes of 0, as without a checksum", _unchecked(size))
            for size in CHECKSUM_SIZES
        ]
        _garbled_refusals(context, bits)
    return each_spoiled(context, ways, structured=True)


def _garbled_refusals(context: RuleContext, ways: list[Spoilt]) -> None:
    """Check that garbled answers that report the failure of one channel do not lead to a wrong value of another
    channel."""
    with context.opened() as probe:
        refused = [text for text in context.subject.refused if Direction.INPUT in probe.channel(text).direction]
        for bad, text in zip(refused, context.known[:1], strict=False):
            for way in ways:
                _garbled_refusal(context, probe, (bad, text), way)


def _garbled_refusal(context: RuleContext, probe: Probe, block: tuple[str, str], way: Spoilt) -> None:
    bad, text = block
    probe.timeout = context.patience
    known, out = context.insist(probe.read, text), np.full(2, UNREAD)
    probe.timeout = context.haste
    found, changed = context.spoiled(way.change, way.hangup, probe.read_many, block, out)
    if not changed or (isinstance(found, OSError) and not isinstance(found, ChannelsFailed)):
        return
    if not isinstance(found, ChannelsFailed):
        raise RuleBroken(f"{context.watch.doing} succeeded with {way.words}; the device refuses {bad}")
    raw = out.tolist()[1]
    if text not in found.causes and raw != UNREAD and not context.alike(text, known, raw):
        raise RuleBroken(f"{text} read {raw} from {way.words}, which says that {bad} failed; {text} is at {known}")


def _unchecked(size: int) -> Change:
    """Return a change of all bits of the byte before the checksum; the checksum is 0."""
    return lambda answer: answer[: -size - 1] + bytes([answer[-size - 1] ^ 0xFF]) + bytes(size)


def _flipped(place: int, bit: int) -> Change:
    def change(answer: bytes) -> bytes:
        at = place if place >= 0 else len(answer) + place
        if not 0 <= at < len(answer):
            return answer[:-1] + bytes([answer[-1] ^ 1])
        return answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]

    return change

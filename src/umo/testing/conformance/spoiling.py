"""Calls whose answers are changed. Such a call must fail or return a right result, and afterwards the driver must work
again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from time import sleep
from typing import Any, TypeVar

from umo.errors import text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.relay import Change
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import MADE_UP, NotTried, RuleBroken
from umo.testing.conformance.subject import Output

T = TypeVar("T")
TRIES = 3
"""Number of calls within which a driver must recover."""
MAX_CHANNELS = 2
"""Largest number of channels that are tried with each spoiled answer."""
NO_ANSWER = "the device answers neither reads nor writes over the line"
LISTENING = 0.05
"""Time in s within which a device that sends by itself has certainly sent something."""
COUNTED = bytes(range(64))
"""Sample answer on which a change is tried. The result shows whether the change leaves nothing, only the beginning, or
another answer."""
ENVELOPE_SIZE = 2
"""Smallest number of bytes by which an answer with a structure is longer than its value."""


@dataclass(frozen=True)
class Spoilt:
    """A way to spoil an answer."""

    words: str
    change: Change
    hangup: bool = False
    reset: bool = False
    """True if the end of the connection is a reset."""
    blind: bool = False
    """True if the changed answer contains nothing from which the driver could know a value. A call that nevertheless
    succeeds has invented its value."""
    tries: int = TRIES
    """Number of calls after which the driver must have recovered: the last of them must succeed."""


def first_only(change: Change) -> Change:
    """Return a change that applies only to the first answer."""
    seen: list[bytes] = []

    def once(answer: bytes) -> bytes:
        seen.append(answer)
        return change(answer) if len(seen) == 1 else answer

    return once


def each_spoiled(context: RuleContext, ways: list[Spoilt], structured: bool = False) -> str | None:
    """Make reads and a write with each of the spoiled answers. `structured`: True for answers that are used only if
    answers have a structure."""
    tried, plain = set(), set()
    with context.opened() as probe, watching(context) as watcher:
        texts = [context.view(each) for each in context.viewed[:MAX_CHANNELS]]
        texts += [text for text in context.readable if text not in texts and context.default(text) is None]
        texts = texts[:MAX_CHANNELS]
        if speaks := device_sends_by_itself(context):
            ways = [_of_a_stream(way) for way in ways]
        if structured:
            plain = {text for text in texts if not _has_structure(context, probe, text)}
        for way in ways:
            for text in texts:
                if text not in plain and spoiled_read(context, probe, watcher, text, way):
                    tried.add("reads")
                if speaks:
                    context.try_out(probe)  # of what it sends by itself a part may be found to be wrong only now
            if speaks and way.change(COUNTED):
                continue  # what is changed may be something else than the answer to a write
            if context.subject.outputs and "writes" not in plain:
                if structured and not _acknowledged(context, probe):
                    plain.add("writes")
                elif _spoiled_write(context, probe, way):
                    tried.add("writes")
    if not tried:
        raise NotTried("answers have no structure by which wrong bytes could be detected" if plain else NO_ANSWER)
    words = [f"without {' and '.join(sorted(plain))}, whose answers have no structure"] if plain else []
    kinds = {"reads"} if texts else set()
    silent = (kinds | ({"writes"} if context.subject.outputs else set())) - tried - plain
    if speaks and "writes" in silent:
        silent, words = silent - {"writes"}, [*words, "without writes, because the device sends by itself"]
    words += [f"{' and '.join(sorted(silent))} have no answer over the line"] if silent else []
    return "; ".join(words) or None


def _of_a_stream(way: Spoilt) -> Spoilt:
    """Return the same way for a device that sends by itself: an answer that is cut may begin with complete frames, and
    the following bytes belong to no frame."""
    left = way.change(COUNTED)
    return replace(way, blind=way.blind and not (left and COUNTED.startswith(left)), tries=TRIES)


def device_sends_by_itself(context: RuleContext) -> bool:
    """True if the device sends without a request. On a busy computer the data may arrive late."""
    for _ in range(TRIES):
        with context.line.counting() as traffic:
            sleep(LISTENING)
        if traffic.answer and not traffic.asked:
            return True
    return False


def _has_structure(context: RuleContext, probe: Probe, text: str) -> bool:
    """Return True if an answer to a read contains more than the value: a line of text, or some further bytes."""
    answer = _answer(context, probe, probe.read, text)
    if not context.subject.structured or not answer:
        return context.subject.structured
    if answer[-1:] in b"\r\n;>" and answer.isascii() and len(answer) > 1:
        return True
    return context.subject.checksum or len(answer) >= -(-probe.channel(text).bits // 8) + ENVELOPE_SIZE


def _acknowledged(context: RuleContext, probe: Probe) -> bool:
    """True if the answer to a write is longer than one or two bytes."""
    output = context.subject.outputs[0]
    probe.timeout = context.patience
    probe.write(output.channel, output.other())
    answer = _answer(context, probe, probe.write, output.channel, output.default)
    return context.subject.structured and (not answer or context.subject.checksum or len(answer) > ENVELOPE_SIZE)


def _answer(context: RuleContext, probe: Probe, call: Callable[..., object], *arguments: Any) -> bytes:
    """Return the answer to a call that succeeds; empty if there was none."""
    probe.timeout = context.patience
    return context.traffic(call, *arguments).answer


def watching(context: RuleContext) -> AbstractContextManager[Probe | None]:
    """Return a context with another client, which observes when a level arrives through a loop-back."""
    looped = any(context.view(each) != each.channel for each in context.viewed)
    return context.second(direct=True) if looped else nullcontext(None)


def spoiled_read(context: RuleContext, probe: Probe, watcher: Probe | None, text: str, way: Spoilt) -> bool:
    """Check that a read with a changed answer fails or is right. If an output drives the channel, the level is changed
    between a good reading and this one. Return whether there was an answer to change."""
    probe.timeout = context.patience
    output = next((each for each in context.viewed if context.view(each) == text), None)
    before, known = _moved(context, probe, watcher, output) if output is not None else (probe.read(text),) * 2
    probe.timeout = context.haste
    found, changed = context.spoiled(way.change, way.hangup, probe.read, text, reset=way.reset)
    probe.timeout = context.patience
    if changed and not isinstance(found, OSError):
        if way.blind and context.made_up(probe):
            raise RuleBroken(f"{text} read {found} from {way.words}: this is not a present value", MADE_UP)
        levels = (known, before) if context.told(probe) else (known,)
        right = output is not None and any(context.same(output, level, found) for level in levels)
        if not (right or context.alike(text, known, found) or context.fallen(text, found)) and text in context.known:
            if output is not None:
                context.confirm(probe, output, known)
            raise RuleBroken(f"{text} read {found} from {way.words}, but {text} is at {known}")
    recovers(context, probe, {text: known} if text in context.known else {text: None}, way.words, way.tries)
    if context.told(probe):
        context.try_out(probe)  # what came beside the reading may be found to be wrong by a later call only
    return changed


def _moved(context: RuleContext, probe: Probe, watcher: Probe | None, output: Output) -> tuple[int, int]:
    """Move an output. Return the level at which it was last read, and its new level."""
    before, now = output.other(1), output.other(2)
    if before == now:
        before, now = output.default, output.other()
    probe.write(output.channel, before)
    context.is_read(probe, output, before)
    probe.write(output.channel, now)
    if context.view(output) != output.channel:
        context.arrive(watcher, output, now)
    return before, now


def _spoiled_write(context: RuleContext, probe: Probe, way: Spoilt) -> bool:
    """Check that a write with a changed answer fails, because it is not known whether it was carried out. Return
    whether there was an answer to change."""
    output = context.subject.outputs[0]
    probe.timeout = context.patience
    probe.write(output.channel, output.default)
    probe.timeout = context.haste
    found, changed = context.spoiled(
        way.change, way.hangup, probe.write, output.channel, output.other(), reset=way.reset
    )
    probe.timeout = context.patience
    if changed and not isinstance(found, OSError):
        raise RuleBroken(f"{context.watch.doing} succeeded with {way.words}")
    rewrite(context, probe, output, output.other(), way.words, way.tries)
    return changed


# Afterwards ---------------------------------------------------------------------------------------


def values(context: RuleContext, probe: Probe) -> dict[str, int | None]:
    """Bring every output to a level other than its default, and wait for the inputs that read the outputs. Then return
    the readings of the channels, with None for channels that change by themselves."""
    probe.timeout = context.patience
    outputs = context.subject.outputs
    for number, output in enumerate(outputs):
        rewrite(context, probe, output, output.other(number), "what was tried before")
    context.await_levels(probe)
    return {text: probe.read(text) if text in context.known else None for text in context.readable}


def recovers(
    context: RuleContext, probe: Probe, expected: Mapping[str, int | None], after: str, tries: int = TRIES
) -> None:
    """Check that each channel returns its own value, at the latest at the last try, and no other value before."""
    probe.timeout = context.patience
    for text, raw in expected.items():
        found = _at_last(context, after, tries, probe.read, text)
        if raw is not None and context.told(probe):
            _, found = context.comes_to(partial(probe.read, text), partial(context.alike, text, raw))
        if raw is not None and not (context.alike(text, raw, found) or context.fallen(text, found)):
            raise RuleBroken(f"{text} read {found} after {after}, but {text} is at {raw}", f"reading of {text}")


def rewrite(
    context: RuleContext, probe: Probe, output: Output, raw: int, after: str, tries: int = TRIES, many: bool = False
) -> None:
    """Check that the output takes a level, written alone or as a block, at the latest at the last of the tries."""
    probe.timeout = context.patience
    _at_last(context, after, tries, probe.write_by, many, output.channel, raw)


def _at_last(context: RuleContext, after: str, tries: int, call: Callable[..., T], *arguments: Any) -> T:
    """Return the result of a call that must succeed at the latest at the last of the tries."""
    for _ in range(tries - 1):
        with suppress(OSError):
            return call(*arguments)
    try:
        return call(*arguments)
    except OSError as error:
        still = " still" if tries > 1 else ""
        raise RuleBroken(f"{context.watch.doing}{still} fails after {after}: {text_of(error)}") from error

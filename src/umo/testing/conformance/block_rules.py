"""Rules of block transfers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations, cycle, islice
from random import Random
from time import sleep
from typing import TypeVar

import numpy as np

from umo.drivers.contract import Direction
from umo.errors import ChannelsFailed
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import TEXTS, WRITTEN, WRITTEN_MANY, Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.subject import Output
from umo.text import some

T = TypeVar("T")
MAX_PAIRS = 30
"""Largest number of pairs of channels that are tried as blocks, each pair in both orders."""
LOOK_INTERVAL = 0.01
"""Time in s from the first to the second reading of a channel. The time doubles with each further reading, because a
driver that receives its values without a request may return an old value for some time."""
LOOKS = 5
"""Largest number of readings by which the kit finds out whether a channel is constant."""
FEWEST_BLOCKS = 4
"""Number of blocks that are tried in any case."""
MAX_TURNS = 16
"""Largest number of blocks that are read one after the other, each in several orders."""
SINGLE_EACH = 4
"""Number of blocks after which a channel is read alone."""
TURNS, FEWEST_TURNS = 9, 4
"""Number of times that a series of a few writes is repeated, and number of times that are tried in any case. The latter
also applies to readings."""
MAX_REFUSED = 2
"""Largest number of refused channels that are tried in each direction. The failure of one channel must not be reported
for another."""
PATTERNS = 8
"""Largest number of patterns of levels, in addition to those in which only one output is not at its default."""


def orders(texts: Sequence[T]) -> list[tuple[T, ...]]:
    """Return blocks of some channels: all of them in several orders, halves, all pairs if they are few, and each
    channel alone."""
    whole = tuple(texts)
    half = len(whole) // 2
    found = [whole, whole[::-1], whole[1:] + whole[:1], whole[:half], whole[half:], whole[::2], whole[1::2]]
    pairs = list(islice(combinations(whole, 2), MAX_PAIRS))
    found += [*pairs, *(pair[::-1] for pair in pairs)]
    return [each for each in dict.fromkeys((*found, *((text,) for text in whole))) if each]


def patterns(outputs: Sequence[Output]) -> Iterator[list[int]]:
    """Return levels of the outputs, in the order of the outputs: first patterns in which all levels differ, if
    possible, then patterns in which only one output is not at its default."""
    for shift in range(PATTERNS):
        yield [output.other(number + 5 * shift) for number, output in enumerate(outputs)]
        if shift < len(outputs):
            alone = outputs[shift]
            yield [each.other(shift) if each == alone else each.default for each in outputs]
    for alone in outputs[PATTERNS:]:
        yield [each.other() if each == alone else each.default for each in outputs]


@rule(Cost(each=14, calls=8, more=further(200)))
def block_read(context: RuleContext) -> str | None:
    """`read_many` returns the same values as `read`: for all channels in any order, for halves, for pairs and for
    single channels."""
    texts = context.readable
    if not texts:
        raise NotTried("the driver has no inputs")
    outputs = context.subject.outputs
    with context.opened() as probe:
        levels = cycle(patterns(outputs))
        for order in context.as_time_allows(orders(texts), FEWEST_BLOCKS, "blocks"):
            for output, raw in zip(outputs, next(levels), strict=True):
                probe.write(output.channel, raw)
            _compare(context, probe, order)
        probe.read_many(())
        if not context.told(probe):
            context.await_levels(probe)
            _read_in_turns(context, probe)
    moving = [each.channel for each in context.subject.inputs if not each.steady]
    return f"{some(moving)}: compared only while they do not change" if moving else None


def _read_in_turns(context: RuleContext, probe: Probe) -> None:
    """Read blocks in several orders and single channels in succession, while nothing changes. The result of a call must
    not depend on the previous call. Until `settle` has passed, a loop-back may show an earlier level."""
    for waited in (False, True):
        try:
            _compare_turns(context, probe)
            return
        except RuleBroken:
            if waited:
                raise
            sleep(context.subject.settle)


def _compare_turns(context: RuleContext, probe: Probe) -> None:
    expected = {text: probe.read(text) for text in context.known}
    for number, block in enumerate(context.as_time_allows(_turns(context.known), FEWEST_TURNS, "blocks in turns")):
        found = dict(zip(block, probe.read_many(block), strict=True))
        if number % SINGLE_EACH == 0:
            found[block[0]] = probe.read(block[0])
        for text, raw in found.items():
            if not context.alike(text, raw, expected[text]):
                why = f"{context.watch.doing} gave {raw} for {text}, but earlier calls gave {expected[text]}"
                raise RuleBroken(why, f"reading of {text}")


def _turns(texts: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return blocks. Each block is followed by blocks of the same channels in other orders."""
    blocks = [each for each in orders(texts)[:MAX_TURNS] if len(each) > 1]
    blocks = Random(1998).sample(blocks, len(blocks))
    return [order for each in blocks for order in (each, each[1:] + each[:1], each[::-1], each)]


def _compare(context: RuleContext, probe: Probe, texts: tuple[str, ...]) -> None:
    """Raise RuleBroken if a block reads another value than `read`. Channels that change meanwhile are not judged."""
    for look in range(LOOKS):
        before = [probe.read(text) for text in texts]
        block = probe.read_many(texts)
        after = [probe.read(text) for text in texts]
        steady = [i for i in range(len(texts)) if before[i] == after[i]]
        wrong = [i for i in steady if not context.alike(texts[i], block[i], after[i])]
        if not wrong:
            return
        if look == LOOKS - 1:
            i = wrong[0]
            of = f" in the block {', '.join(texts)}" if len(texts) > 1 else ""
            why = f"read_many gave {block[i]} for {texts[i]}{of}, but read gave {before[i]} before and after it"
            raise RuleBroken(why, f"reading of {texts[i]} in a block")
        sleep(LOOK_INTERVAL * 2**look)


@rule(Cost(each=6, calls=32, more=further(350)))
def block_write(context: RuleContext) -> str | None:
    """`write_many` brings each output directly to the level given for it, and changes no other output: for all outputs
    in any order, for halves, for pairs and for single outputs."""
    outputs = context.required_outputs
    with context.opened() as probe:
        tasks = [*((outputs, raws) for raws in patterns(outputs)), *_parts(outputs)]
        for number, (part, raws) in enumerate(context.as_time_allows(tasks, FEWEST_BLOCKS, "blocks")):
            step = 1 if number % 2 else -1
            before = {each: each.other(number) for each in outputs if each not in part}
            for each, raw in before.items():
                probe.write(each.channel, raw)
            with context.straight(before | dict(zip(part, raws, strict=True)), "a write_many"):
                probe.write_many([output.channel for output in part[::step]], raws[::step])
            _check(context, probe, part, raws, "write_many")
            _check(context, probe, tuple(before), list(before.values()), "a write_many of others")
        _write_nothing(context, probe)
        _write_in_turns(context, probe)
    return context.remark()


def _write_nothing(context: RuleContext, probe: Probe) -> None:
    """Write an empty block, after a whole block and single writes."""
    outputs = context.required_outputs
    probe.write_many([output.channel for output in outputs], [output.other() for output in outputs])
    for output in outputs:
        probe.write(output.channel, output.default)
    probe.write_many([], [])
    _check(context, probe, outputs, [output.default for output in outputs], "a write_many of nothing")


def _write_in_turns(context: RuleContext, probe: Probe) -> None:
    """Write blocks in several orders and single outputs in succession. Then each output must be at its own level."""
    outputs, random = context.required_outputs, Random(1998)
    for turn in context.as_time_allows(range(TURNS), FEWEST_TURNS, "turns of writes"):
        levels: dict[Output, int] = {}
        for step in range(1 + turn % 3):
            part = random.sample(outputs, random.randint(1, len(outputs)))
            levels |= {each: each.other(turn + step + place) for place, each in enumerate(part)}
            probe.write_many([each.channel for each in part], [levels[each] for each in part])
            levels[part[0]] = part[0].other(turn + step + 7)
            probe.write(part[0].channel, levels[part[0]])
            if context.readable:
                probe.read(context.readable[turn % len(context.readable)])
        _check(context, probe, tuple(levels), list(levels.values()), "writes in turns")


def _parts(outputs: tuple[Output, ...]) -> Iterator[tuple[tuple[Output, ...], list[int]]]:
    for number, part in enumerate(orders(outputs)):
        yield part, [output.other(number + place) for place, output in enumerate(part)]


def _check(context: RuleContext, probe: Probe, outputs: tuple[Output, ...], raws: list[int], after: str) -> None:
    for output, raw in zip(outputs, raws, strict=True):
        if after != "write_many":
            context.expect(probe, output, raw, after)
            continue
        try:
            context.expect(probe, output, raw, f"{after} of {raw}", WRITTEN_MANY)
        except RuleBroken as broken:
            raise RuleBroken(str(broken), *broken.causes, *_alone_too(context, probe, output, raw)) from broken


def _alone_too(context: RuleContext, probe: Probe, output: Output, raw: int) -> list[str]:
    """Return the cause of the fault if a single write of this level also leads to the wrong level; otherwise
    nothing."""
    there = context.last_level
    probe.write(output.channel, raw)
    return [WRITTEN] if not context.is_at(probe, output, raw) and context.last_level == there else []


@rule(Cost(each=2, calls=8))
def block_buffers(context: RuleContext) -> str | None:
    """The arrays of a block belong to the caller: the driver keeps none of them, and does not change `raws`."""
    if not context.readable:
        context.required_outputs  # noqa: B018  NotTried
    with context.opened() as probe:
        if context.visible:
            _raws(context, probe)
        if context.readable:
            _outs(probe, context.readable)
    return context.remark(
        *([] if context.readable else ["there are no inputs, so only the arrays of writes were tried"])
    )


def _raws(context: RuleContext, probe: Probe) -> None:
    """Write a part of one array repeatedly, each time with other levels, as the image does in every period."""
    outputs = context.required_outputs
    texts = [output.channel for output in outputs]
    whole = np.zeros(len(outputs) + 2, np.int64)
    part = whole[1:-1]
    for number in range(4):
        raws = [output.other(number) if number % 2 else output.default for output in outputs]
        part[:] = raws
        probe.write_many(texts, part)
        if part.tolist() != raws:
            raise RuleBroken(f"write_many changed its array from {raws} to {part.tolist()}")
        _check(context, probe, outputs, raws, "write_many")
        part[:] = [output.other(number + 1) for output in outputs]  # for the next period; not sent yet
        _check(context, probe, outputs, raws, "a write_many whose array was changed later")


def _outs(probe: Probe, texts: tuple[str, ...]) -> None:
    whole = np.full(len(texts) + 2, -77, np.int64)
    part = whole[1:-1]
    probe.read_many(texts, part)
    if whole[0] != -77 or whole[-1] != -77:
        raise RuleBroken("read_many wrote beyond its array")
    part[:] = -77
    probe.read_many(texts)
    probe.read(texts[0])
    if part.tolist() != [-77] * len(texts):
        raise RuleBroken("read_many wrote into the array of an earlier call")


@rule(Cost(each=8, calls=12, waits=16))
def block_failures(context: RuleContext) -> str | None:
    """If a channel of a block fails, each other channel is either transferred or also named in the error. The error
    names no channel that was transferred."""
    if not context.subject.refused:
        raise NotTried("no channel is known that the device refuses")
    missing, tried = [], False
    with context.opened() as probe:
        for direction, others, check in (
            (Direction.INPUT, context.readable, _read_with),
            (Direction.OUTPUT, context.visible, _write_with),
        ):
            refused = [text for text in context.subject.refused if direction in probe.channel(text).direction]
            what = "reads" if direction is Direction.INPUT else "writes"
            if not others:
                missing.append(f"{what}: there is no other channel whose level can be seen")
            elif not refused:
                missing.append(f"{what}: no channel of this direction is known that the device refuses")
            for bad in refused[:MAX_REFUSED] if others else ():
                alone = partial(probe.read, bad) if what == "reads" else partial(probe.write, bad, 0)
                if context.failure(alone) is None:
                    missing.append(f"{what}: a call for {bad} alone succeeds")
                    continue
                check(context, probe, bad)
                tried = True
    if not tried:
        raise NotTried("; ".join(missing))
    return context.remark(*(f"not tried with {each}" for each in missing))


def _read_with(context: RuleContext, probe: Probe, bad: str) -> None:
    context.await_levels(probe)
    expected = {text: probe.read(text) for text in context.readable}
    texts = list(context.readable)
    for place in (0, len(texts) // 2, len(texts)):
        block = [*texts[:place], bad, *texts[place:]]
        out = np.full(len(block), -1 << 40, np.int64)
        with context.in_haste(probe):
            named = _named(context.failure(probe.read_many, block, out), block, bad, "read_many")
        for text, raw in zip(block, out.tolist(), strict=True):
            if text not in named and text in context.known and not context.alike(text, raw, expected[text]):
                why = f"read_many failed for {', '.join(named)}; {text} is {raw} in place of {expected[text]}"
                raise RuleBroken(why, f"reading of {text}", f"reading of {text} in a block")


def _write_with(context: RuleContext, probe: Probe, bad: str) -> None:
    outputs = context.required_outputs
    for place in (0, len(outputs) // 2, len(outputs)):
        for output in outputs:
            probe.write(output.channel, output.default)
        raws = [output.other(place) for output in outputs]
        texts = [output.channel for output in outputs]
        block = [*texts[:place], bad, *texts[place:]]
        values = [*raws[:place], 0, *raws[place:]]
        with context.in_haste(probe):
            named = _named(context.failure(probe.write_many, block, values), block, bad, "write_many")
        for output, raw in zip(outputs, raws, strict=True):
            if output.channel not in named:
                context.expect(probe, output, raw, f"a write_many that failed for {', '.join(named)} only")


def _named(error: OSError | None, block: list[str], bad: str, what: str) -> list[str]:
    """Return the channels for which the block failed."""
    if error is None:
        raise RuleBroken(f"{what} succeeded with {bad}, which the device refuses")
    if not isinstance(error, ChannelsFailed):
        return block
    if unknown := sorted(set(error.causes) - set(block)):
        why = f"ChannelsFailed of {what} names {unknown[0]}, which is not a channel of the block"
        raise RuleBroken(why, TEXTS)
    if bad not in error.causes:
        raise RuleBroken(f"ChannelsFailed of {what} does not name {bad}")
    return list(error.causes)

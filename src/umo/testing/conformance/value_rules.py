"""Rules about transfers and their values: duration, ranges, both ends of a range, the level beyond each end, and
directions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from umo.drivers.contract import Direction
from umo.duration import duration
from umo.errors import DriverError, text_of
from umo.testing.conformance.certificate import TransferTime, time_text
from umo.testing.conformance.probe import Probe, WrongKind
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import RECORD, WRITTEN, Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.subject import Output
from umo.text import some

INT64 = 1 << 63
TIMED_CALLS = 300
"""Largest number of calls of each kind that are timed."""
FEWEST_LEVELS = 8
"""Smallest number of levels of each output that are tried."""


@rule(Cost(opens=3, each=5, calls=6))
def answers(context: RuleContext) -> None:
    """The device answers: channels can be initialised, inputs read, and defaults written to outputs. The first reading
    of an input after `open` is correct too."""
    # The other rules are not tried if it does not
    if why := context.dead():
        raise RuleBroken(why, "dead")
    if context.subject.levels is not None and context.subject.outputs:
        _check_record(context, context.subject.outputs[0])
    for block in (False, True) if context.steady else ():
        with context.opened() as probe:
            first, then = (_steady_values(context, probe, block) for _ in range(2))
            if not context.told(probe) and first != then:
                text, raw, now = next(
                    each for each in zip(context.steady, first, then, strict=True) if each[1] != each[2]
                )
                raise RuleBroken(f"the first reading of {text} after open was {raw}, the next reading {now}")


def _check_record(context: RuleContext, output: Output) -> None:
    """Check that the levels from the subject's `levels` begin with the last level of the previous call. Otherwise rules
    would see pulses."""
    with context.opened() as probe:
        before = context.recorded(output)[-1]
        for raw in (output.other(), output.other(1)):
            probe.write(output.channel, raw)
        first, *levels = context.recorded(output)
    if levels and not context.alike(output.channel, before, first):
        after = f"after {output.channel} was at {before}: the first must be the level at the last call of this function"
        raise RuleBroken(f"`levels` of the subject gave {some([str(raw) for raw in (first, *levels)])} {after}", RECORD)


def _steady_values(context: RuleContext, probe: Probe, block: bool) -> list[int]:
    texts = context.steady
    return probe.read_many(texts) if block else [probe.read(text) for text in texts]


@rule(Cost(calls=20))
def time_(context: RuleContext) -> str:
    """The median time per transfer is within the timeout; the certificate has the times."""
    with context.opened(direct=True) as probe:
        kinds = _kinds(context, probe)
        for kind, call in kinds.items():
            taken: list[float] = []
            most = TIMED_CALLS if context.cycles is None else max(20, min(context.cycles, TIMED_CALLS))
            while len(taken) < 5 or (len(taken) < most and context.budget.more):
                began = perf_counter()
                if (error := context.failure(probe.call, kind, call)) is not None:  # other rules judge that
                    raise NotTried(f"{kind} failed: {text_of(error)}")
                taken.append(perf_counter() - began)
            median, p99 = (float(np.percentile(taken, share)) for share in (50, 99))
            context.times[kind] = TransferTime(median, p99, len(taken))
    if not context.times:
        raise NotTried("the subject has no channels")
    for kind, each in context.times.items():
        if each.median > context.subject.timeout:
            timeout = duration(context.subject.timeout)
            raise RuleBroken(f"{kind} takes {time_text(each.median)}, its timeout is {timeout}")
    return ", ".join(f"{kind} {time_text(each.median)}" for kind, each in context.times.items())


def _kinds(context: RuleContext, probe: Probe) -> dict[str, Callable[[], Any]]:
    """Return each kind of transfer of the driver, without the actions of the kit around it."""
    driver = probe.driver
    kinds: dict[str, Callable[[], Any]] = {}
    if context.readable:
        readable = tuple(map(probe.channel, context.readable))
        out = np.zeros(len(readable), np.int64)
        kinds["read"] = lambda: driver.read(readable[0])
        kinds[f"read_many of {len(readable)}"] = lambda: driver.read_many(readable, out)
    if context.subject.outputs:
        outputs = tuple(probe.channel(each.channel) for each in context.subject.outputs)
        raws = np.array([each.default for each in context.subject.outputs], np.int64)
        kinds["write"] = lambda: driver.write(outputs[0], int(raws[0]))
        kinds[f"write_many of {len(outputs)}"] = lambda: driver.write_many(outputs, raws)
    return kinds


@rule(Cost(each=7, calls=10, more=further(600)))
def range_(context: RuleContext) -> str | None:
    """An output takes every raw level of its range exactly, and the same level is read back. The rule tests both ends,
    powers of two and their neighbours, and every value of each byte."""
    with context.opened() as probe:
        tasks = [(output, raw) for output in context.required_outputs for raw in output.samples[:FEWEST_LEVELS]]
        fewest = len(tasks)
        tasks += [(output, raw) for output in context.required_outputs for raw in output.samples[FEWEST_LEVELS:]]
        for output, raw in context.as_time_allows(tasks, fewest, "levels"):
            probe.write(output.channel, raw)
            context.expect(probe, output, raw, f"write({raw})", WRITTEN)
    return context.remark()


@rule(Cost(each=6, calls=18, more=further(18)))
def one_beyond(context: RuleContext) -> str | None:
    """A write of a raw level beyond the channel's bits is refused by an OSError, and changes nothing."""
    # Outputs are tried where a driver that clamps or wraps would not leave the range that may be driven
    probe = context.new()
    wide = [output for output in context.required_outputs if _beyond(probe, output)]
    if not wide:
        raise NotTried("no output may be driven over all of its bits: a driver that clamped would leave the range")
    with context.opened() as probe:
        for output in wide:
            for raw in _beyond(probe, output):
                _refused(context, probe, output, raw)
            for raw in _beyond_words(probe, output):
                if context.budget.more:
                    _refused(context, probe, output, raw)
    return context.remark()


def _beyond(probe: Probe, output: Output) -> tuple[int, ...]:
    channel = probe.channel(output.channel)
    if (output.least, output.greatest) != (channel.lowest, channel.highest):
        return ()
    return tuple(raw for raw in (channel.highest + 1, channel.lowest - 1) if -INT64 <= raw < INT64)


def _beyond_words(probe: Probe, output: Output) -> tuple[int, ...]:
    """Return levels that a conversion to fewer bits would bring into the range, or that only 64 bits can hold."""
    highest = probe.channel(output.channel).highest
    return tuple(raw for bits in (16, 32, 62) if (raw := (1 << bits) + output.other()) > highest + 1)


def _refused(context: RuleContext, probe: Probe, output: Output, raw: int) -> None:
    """Check that a write of this level is refused: alone, in a block of one, and after the others in a block."""
    before = [each for each in context.visible if each != output]
    calls: list[DriverCall] = [partial(probe.write, output.channel, raw)]
    for others in [[], before] if before else [[]]:
        texts = [each.channel for each in (*others, output)]
        calls += [partial(probe.write_many, texts, [*(each.default for each in others), raw])]
    for call in calls:
        probe.write(output.channel, output.default)
        error = context.failure(call)
        came_to = context.level(probe, output)
        if isinstance(error, WrongKind):
            raise RuleBroken(f"{context.watch.doing} raised {text_of(error)}, which is not an OSError")
        if error is None:
            raise RuleBroken(f"{context.subject.name} accepted {raw} for {output.channel}, which is at {came_to} now")
        if not context.is_at(probe, output, output.default):
            raise RuleBroken(f"{output.channel} went to {came_to} after a write of {raw} that was refused")


@rule(Cost(each=4, calls=2))
def directions(context: RuleContext) -> str | None:
    """A write to an input is refused, and changes nothing."""
    probe = context.new()
    inputs = [each for each in context.subject.inputs if probe.channel(each.channel).direction is Direction.INPUT]
    if not inputs:
        raise NotTried("there is no channel that is only an input")
    with context.opened() as probe:
        context.await_levels(probe)
        for each in inputs:
            before = [probe.read(each.channel) for _ in range(2)][-1]  # the first reading is judged by `answers`
            raw = before ^ 1 if each.channel in context.known else before  # another level, if its change can be seen
            for many in (False, True):
                what = f"{'write_many' if many else 'write'} to {each.channel}"
                if context.failure(probe.call, what, _write, probe, each.channel, raw, many) is None:
                    raise RuleBroken(f"the driver accepted a {what}, which is an input")
            after = probe.read(each.channel)
            if each.channel in context.known and not context.alike(each.channel, before, after):
                why = f"a refused write to {each.channel} changed it from {before} to {after}"
                raise RuleBroken(why, f"reading of {each.channel}")
    unsure = [each.channel for each in inputs if each.channel not in context.known]
    return (
        (
            f"it could not be seen whether a refused write changes {some(unsure)}, because the level is not known to "
            "be steady"
        )
        if unsure
        else None
    )


@rule(Cost(each=2, calls=2))
def reading(context: RuleContext) -> str | None:
    """Reading changes no output, not even for a short time."""
    if not context.readable:
        raise NotTried("the driver has no inputs")
    outputs = context.required_outputs
    with context.opened() as probe:
        for number, output in enumerate(outputs):
            probe.write(output.channel, output.other(number))
            context.expect(probe, output, output.other(number), f"write({output.other(number)})", WRITTEN)
        with context.straight({output: output.other(n) for n, output in enumerate(outputs)}, "reading all inputs"):
            for text in context.readable:
                probe.read(text)
            probe.read_many(context.readable)
        for number, output in enumerate(outputs):
            context.expect(probe, output, output.other(number), "reading all inputs")
    return context.remark()


def _write(probe: Probe, text: str, raw: int, many: bool) -> None:
    channel = probe.driver.channel(text)
    try:
        if many:
            probe.driver.write_many((channel,), np.array([raw], np.int64))
        else:
            probe.driver.write(channel, raw)
    except NotImplementedError as error:  # the contract's own, of a driver without outputs
        raise DriverError(str(error)) from error

"""Rules of values: ranges, their ends, one beyond, directions."""

from __future__ import annotations

from umo.drivers.contract import Direction
from umo.errors import DriverError
from umo.testing.conformance.hand import Hand
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.trial import Trial

INT64 = 1 << 63


@rule("range", "An output takes every raw level of its range, both ends included, exactly.")
def raw_range(trial: Trial) -> str | None:
    with trial.opened() as hand:
        for output in trial.seen:
            for raw in output.samples:
                hand.write(output.channel, raw)
                trial.expect(hand, output, raw, f"write({raw})")
    return trial.remark


@rule("one beyond", "A raw level beyond the channel's bits is refused by an OSError, and changes nothing.")
def one_beyond(trial: Trial) -> str | None:
    """Only where a driver that clamps or wraps would not leave the range that may be driven."""
    hand = trial.new()
    wide = [output for output in trial.seen if _beyond(hand, output)]
    if not wide:
        raise NotTried("no output may be driven over all of its bits: a driver that clamped would leave the range")
    with trial.opened() as hand:
        for output in wide:
            for raw in _beyond(hand, output):
                _refused(trial, hand, output, raw)
    return trial.remark


def _beyond(hand: Hand, output: Output) -> tuple[int, ...]:
    channel = hand.channel(output.channel)
    if (output.least, output.greatest) != (channel.lowest, channel.highest):
        return ()
    return tuple(raw for raw in (channel.highest + 1, channel.lowest - 1) if -INT64 <= raw < INT64)


def _refused(trial: Trial, hand: Hand, output: Output, raw: int) -> None:
    for many in (False, True):
        hand.write(output.channel, output.default)
        call = hand.write_many if many else hand.write
        arguments = ([output.channel], [raw]) if many else (output.channel, raw)
        error = trial.failure(call, *arguments)
        came_to = trial.level(hand, output)
        if error is None:
            raise RuleBroken(f"{trial.subject.name} took {raw} for {output.channel}, which is at {came_to} now")
        if not trial.is_at(hand, output, output.default):
            raise RuleBroken(f"{output.channel} went to {came_to} with a write of {raw}, which was refused")


@rule("directions", "A write to an input is refused, and changes nothing.")
def directions(trial: Trial) -> None:
    hand = trial.new()
    inputs = [each for each in trial.subject.inputs if hand.channel(each.channel).direction is Direction.INPUT]
    if not inputs:
        raise NotTried("there is no channel that is an input only")
    with trial.opened() as hand:
        for each in inputs:
            before = hand.read(each.channel)
            error = trial.failure(hand.call, f"write to {each.channel}", _write, hand, each.channel, before)
            if error is None:
                raise RuleBroken(f"a write to {each.channel}, an input, was taken")
            if each.channel in trial.steady and (after := hand.read(each.channel)) != before:
                raise RuleBroken(f"a refused write to {each.channel} changed it from {before} to {after}")


def _write(hand: Hand, text: str, raw: int) -> None:
    try:
        hand.driver.write(hand.driver.channel(text), raw)
    except NotImplementedError as error:  # the contract's own, of a driver without outputs
        raise DriverError(str(error)) from error

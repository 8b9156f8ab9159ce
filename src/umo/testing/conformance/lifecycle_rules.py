"""Rules about the segments: initialise, reset, finalise, open and close."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from umo.drivers.optional import look_for
from umo.errors import text_of
from umo.testing.conformance.probe import Probe, failed
from umo.testing.conformance.pulses import looks_for_pulses
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.spoiling import rewrite
from umo.testing.conformance.subject import Output
from umo.testing.conformance.taps import Tap
from umo.text import some

FEWEST_OUTPUTS = 2
"""Smallest number of outputs that are initialised, each from two levels, and that are watched while a driver is opened
again."""
TRIES = 3
"""Number of plain writes. One of them must show that a loop-back needs time."""
MAX_OTHERS = 8
"""Largest number of other outputs that are watched together with one output."""


@rule(Cost(opens=11, each=9, calls=6, connects=2, waits=1, more=further(24)))
def initialise(context: RuleContext) -> str | None:
    """Initialise brings an output to its default, even after an initialise that has failed. The other outputs do not
    change. Channels can be initialised in any order."""
    for output, _ in _left_levels(context):
        others = [each for each in context.visible if each != output]
        with context.leaving(context.new()) as probe:
            probe.open()
            probe.initialize(output.channel, output.default)
            context.expect(probe, output, output.default, f"initialize({output.default})")
            _check_the_rest(context, probe, output, others[:MAX_OTHERS])
    _in_any_order(context)
    if context.subject.line is not None:
        _again_after_a_failure(context)
    unseen = context.subject.levels is None and len(context.visible) > 1
    return context.remark(
        *(["it could not be seen whether the other outputs stay: there is no record of levels"] if unseen else [])
    )


def _in_any_order(context: RuleContext) -> None:
    """Check that channels mean the same, regardless of the order in which they are initialised."""
    found: list[dict[str, int]] = []
    for order in (context.channels, context.channels[::-1]):
        with context.leaving(context.new()) as probe:
            probe.open()
            for text in order:
                probe.initialize(text, context.default(text))
            for output in context.visible:
                context.expect(probe, output, output.default, f"initialize({output.default})")
            context.await_levels(probe)
            found.append({text: probe.read(text) for text in context.known})
    for text, raw in found[0].items():
        if not context.alike(text, raw, now := found[1][text]):
            why = f"{text} reads {now} if channels are initialised in the order {some(context.channels[::-1])}"
            raise RuleBroken(f"{why}, and {raw} in the opposite order")


def _again_after_a_failure(context: RuleContext) -> None:
    """Lose the answer to an initialise, and then make the call again."""
    output = context.required_outputs[0]
    with context.opened() as probe:
        probe.timeout = context.haste
        context.unanswered(probe.initialize, output.channel, output.default)
        rewrite(context, probe, output, output.other(), "an initialise without an answer")
        probe.initialize(output.channel, output.default)
        context.expect(probe, output, output.default, f"initialize({output.default}), which had failed before")


def _left_levels(context: RuleContext) -> Iterator[tuple[Output, int]]:
    """Yield each output with the level at which a process that died has left it. The other outputs are not at their
    defaults."""
    for output in context.as_time_allows(context.required_outputs, FEWEST_OUTPUTS, "outputs"):
        for left in dict.fromkeys((output.default, output.other())):
            _leave_at(context, output, left)
            yield output, left


def _leave_at(context: RuleContext, output: Output, raw: int) -> None:
    """Leave the output at this level, like a process that dies. The other outputs are not at their defaults."""
    context.dirty = True
    probe = context.new()
    try:
        probe.open()
        for each in context.subject.outputs:
            probe.initialize(each.channel, each.default)
            probe.write(each.channel, raw if each == output else each.other())
    finally:
        probe.close()


def _check_the_rest(context: RuleContext, probe: Probe, initialised: Output, others: Sequence[Output]) -> None:
    """Check that the other outputs are initialised to their own defaults, and that an initialise does not move them
    afterwards. (Outputs that this driver has not initialised are not judged: the device may release them by itself, or
    have them in a shared register that cannot be read.)"""
    for each in others:
        probe.initialize(each.channel, each.default)
        context.expect(probe, each, each.default, f"initialize({each.default})")
    if context.subject.levels is None:
        return
    for each in others:
        probe.write(each.channel, each.other())
        context.confirm(probe, each, each.other())
    probe.initialize(initialised.channel, initialised.default)
    for each in others:
        if not context.is_at(probe, each, each.other()):
            text = f"{each.channel} went from {each.other()} to {context.last_level} while {initialised.channel} was"
            raise RuleBroken(f"{text} initialised", f"level of {each.channel}")


@rule(Cost(each=14, calls=6))
def reset(context: RuleContext) -> str | None:
    """Reset brings an output from any level to the given default. It changes no input and no other output, not even for
    a short time."""
    with context.opened() as probe:
        _check_inputs(context, probe)
        for output in context.required_outputs:
            for raw in output.inner:
                probe.write(output.channel, raw)
                probe.reset(output.channel, output.default)
                context.expect(probe, output, output.default, f"reset({output.default}) from {raw}")
            for default in (output.other(), output.default):  # not that of initialise alone
                probe.reset(output.channel, default)
                context.expect(probe, output, default, f"reset({default})")
        _check_others(context, probe)
    unseen = context.subject.inputs and not context.steady
    return context.remark(
        *(["no input is known to be steady, so it could not be seen whether inputs stay"] if unseen else [])
    )


def _check_others(context: RuleContext, probe: Probe) -> None:
    """Check that outputs keep their levels while others are reset, one after the other."""
    for order in (context.required_outputs, context.required_outputs[::-1]):
        for output in order:
            probe.write(output.channel, output.other())
            context.confirm(probe, output, output.other())
        for number, gone in enumerate(order):
            goals = {each: each.other() for each in order[number + 1 :]} | {gone: gone.default}
            with context.straight(goals, f"a reset of {gone.channel}"):
                probe.reset(gone.channel, gone.default)
            for output in order[number + 1 :]:
                context.expect(probe, output, output.other(), f"reset of {gone.channel}")


def _check_inputs(context: RuleContext, probe: Probe) -> None:
    for output in context.visible:
        probe.write(output.channel, output.other())
    for text in context.steady:
        before = probe.read(text)
        probe.reset(text, None)
        if (after := probe.read(text)) != before:
            raise RuleBroken(f"{text} read {before} before its reset, and {after} after its reset")
    for text in (each.channel for each in context.subject.inputs if context.default(each.channel) is None):
        probe.reset(text, None)
        for output in context.visible:
            context.expect(probe, output, output.other(), f"reset of the input {text}")


@rule(Cost(opens=8, each=3, calls=6, more=further(50)))
def glitch(context: RuleContext) -> str | None:
    """Initialise and reset bring an output directly to its default, without another level in between."""
    watched: set[str] = set()
    for output, left in _left_levels(context):
        with context.leaving(context.new()) as probe:
            with context.observing(output, left, until=output.default) as levels:
                probe.open()
                probe.initialize(output.channel, output.default)
            watched |= _direct(context, probe, output, levels, left, "initialised")
            probe.write(output.channel, output.other())
            with context.observing(output, output.other(), until=output.default) as levels:
                probe.reset(output.channel, output.default)
            watched |= _direct(context, probe, output, levels, output.other(), "reset")
    unseen = _short_pulses(context)
    watched |= {each.channel for each in context.visible} - set(unseen)
    unwatched = [each.channel for each in context.subject.outputs if each.channel not in watched]
    if not watched:
        raise NotTried(
            f"the levels of {some(unwatched)} were not watched: this needs a record of levels, or a "
            f"loop-back and two clients"
        )
    words = [f"the levels of {some(unwatched)} were not watched"] if unwatched else []
    words += [f"short pulses of {some(unseen)} cannot be seen"] if unseen else []
    return "; ".join(words) or None


def _short_pulses(context: RuleContext) -> list[str]:
    """Return the outputs whose short pulses cannot be seen, neither in a record of levels nor in the requests."""
    if context.subject.levels is not None:
        return []
    if context.subject.line is None:
        return [each.channel for each in context.visible]
    tried = context.as_time_allows(context.visible, 0, "outputs watched for pulses")
    known = {output for output in tried if looks_for_pulses(context, output)}
    return [each.channel for each in context.visible if each not in known]


def _direct(
    context: RuleContext, probe: Probe, output: Output, levels: Sequence[int], left: int, doing: str
) -> set[str]:
    """Return the output's channel if it was watched. Raises RuleBroken for a level in between, other than the first
    level, `left` and the default."""
    for level in levels[1:-1]:
        if level != levels[0] and not any(context.same(output, raw, level) for raw in (left, output.default)):
            if _is_gradual(context, probe, output, levels, left):
                view = context.view(output)
                context.excuses.append(f"{view} reaches a level through the levels in between, also with a plain write")
                return set()
            text = f"{output.channel} was at {', '.join(map(str, levels))} while it was {doing} at {output.default}"
            raise RuleBroken(text, f"level of {output.channel}")
    return {output.channel} if levels else set()


def _is_gradual(context: RuleContext, probe: Probe, output: Output, levels: Sequence[int], left: int) -> bool:
    """Return True if the loop-back changes gradually from one level to another, as it then also does after a plain
    write. A driver that writes in two parts always shows the same level in between. A record shows the output
    itself."""
    if context.subject.levels is not None or list(levels) not in (sorted(levels), sorted(levels, reverse=True)):
        return False
    between = set(levels[1:-1])
    for _ in range(TRIES):
        probe.write(output.channel, left)
        with context.observing(output, left, until=output.default) as written:
            probe.write(output.channel, output.default)
        if written[1:-1] and len(between.union(written[1:-1])) > 1:
            return True
    return False


@rule(Cost(opens=2, each=13))
def finalise(context: RuleContext) -> str | None:
    """Channels can be finalised in any order. The other channels continue to work, keep their levels and return the
    same readings."""
    if len(context.channels) < 2:
        raise NotTried("the subject has only one channel")
    for order in (context.channels, context.channels[::-1]):
        with context.opened() as probe:
            for output in context.subject.outputs:
                probe.write(output.channel, output.other())
            for gone, text in pairwise(order):
                probe.reset(gone, context.default(gone))
                before = {each: probe.read(each) for each in context.steady[:MAX_OTHERS] if each in probe.opened}
                probe.finalize(gone)
                _check_left(context, probe, gone, before)
                try:
                    _use(context, probe, text)
                except OSError as error:
                    raise RuleBroken(f"{text} failed after {gone} was finalised: {text_of(error)}") from error
    return context.looked()


def _check_left(context: RuleContext, probe: Probe, gone: str, before: Mapping[str, int]) -> None:
    """Check that the outputs that were not finalised keep their levels, and that inputs return the same readings as
    before."""
    for text in before.keys() & set(probe.opened):
        if (now := probe.read(text)) != before[text]:
            raise RuleBroken(f"{text} read {before[text]}, and {now} after {gone} was finalised", f"reading of {text}")
    for output in context.visible:
        if output.channel in probe.opened:
            context.expect(probe, output, output.other(), f"finalize of {gone}")


def _use(context: RuleContext, probe: Probe, text: str) -> None:
    for output in context.subject.outputs:
        if output.channel == text:
            probe.write(text, output.other())
    if text in context.readable:
        probe.read(text)


@rule(Cost(opens=15, each=10, calls=4, connects=2, waits=1))
def reopen(context: RuleContext) -> str | None:
    """A closed driver can be opened again, and a driver that is not open can be closed. Outputs start at their defaults
    again, even if they were driven in the meantime. No descriptor is closed twice, because its number may belong to
    another descriptor at the second time."""
    probe = context.new()
    probe.close()
    with context.watch.placeholders() as held:
        for number in range(3):
            _opened_again(context, probe, number)
        if context.subject.line is not None:
            _lose_connections(context, probe, context.subject.line)
    if held.closed_by:
        why = "that had been closed before, and whose number belonged to another file by then"
        raise RuleBroken(f"{held.closed_by} closed a descriptor {why}", "descriptor closed twice")
    _open_in_turns(context)
    return context.looked()


def _opened_again(context: RuleContext, probe: Probe, number: int) -> None:
    with context.leaving(probe):
        try:
            _open_watched(context, probe, context.subject.outputs[:1] if number else ())
            context.bring_up(probe)
            for output in context.visible:
                context.expect(probe, output, output.default, f"initialize({output.default}) when opened again")
            for text in context.channels:
                _use(context, probe, text)
        except OSError as error:
            raise RuleBroken(f"opened again, {failed(error)}") from error
    probe.close()
    for output in context.subject.outputs[:1]:
        _leave_at(context, output, output.other())


def _lose_connections(context: RuleContext, probe: Probe, line: Tap) -> None:
    """Close one connection, lose the answer of another, and then look for the device. Other rules judge failures."""
    context.bring_up(probe)
    call = context.transfers(probe)[0]
    line.drop()
    context.failure(context.insist, call)
    with context.in_haste(probe):
        context.unanswered(call)
        context.failure(probe.call, "look", look_for, probe.driver)
    context.failure(context.insist, call)
    context.failure(context.leave, probe)
    context.failure(probe.close)


def _open_watched(context: RuleContext, probe: Probe, driven: Sequence[Output]) -> None:
    """Open and close the driver again, and check that no output moves. The device itself may release an output that was
    driven."""
    for output in context.visible[:FEWEST_OUTPUTS]:
        left = output.other() if output in driven else output.default
        with context.observing(output, left, until=left) as levels:
            probe.open()
            probe.close()
        for level in levels[1:]:
            if not any(context.same(output, raw, level) for raw in (left, output.default)):
                text = f"{output.channel} went from {left} to {level} while the driver was opened again"
                raise RuleBroken(text, f"level of {output.channel}")


def _open_in_turns(context: RuleContext) -> None:
    """Open, use and close several drivers of the same device, one after the other."""
    for _ in range(3):
        with context.opened() as probe:
            for text in context.channels:
                _use(context, probe, text)

"""Rules about the device: it vanishes and returns, it has two clients, and its errors name the objects of a machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import pairwise
from time import sleep
from typing import Any

from umo.cycle.connect import connect
from umo.duration import duration
from umo.errors import ChannelsFailed, DriverError, WiringError, text_of
from umo.objects import Compound, DigitalActuator, DigitalSensor
from umo.system.device_record import DeviceClaim
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import TEXTS, Cost, NotTried, RuleBroken, further, rule
from umo.testing.conformance.spoiling import rewrite
from umo.testing.conformance.subject import Output
from umo.testing.conformance.timing_rules import in_time

MAX_ALONE = 8
"""Largest number of channels that are read alone while the device is away."""
MAX_OLD = 2
"""Number of earlier readings that a rule does not accept as new ones."""
MANY_FAILURES = 100
"""Number of calls that fail while the device is away."""
STILL = 40
"""Number of readings of a constant level after which a driver might assume that it never changes."""
PAUSE = 0.06
"""Time in s in which nothing is read. Data that a device sends by itself in this time may remain in a buffer."""
OWN_PERIOD = 0.1
"""Period in s of a driver that umo calls only outside the cycle."""
MAX_LEVEL = 1 << 40
"""Largest raw level of an object, positive and negative."""
SOLE_WRITER = "(if the driver must be the only client: `sole_writer` of the subject, --sole-writer)"


@rule(Cost(each=4, calls=8, connects=7, waits=7))
def reset_after_failure(context: RuleContext) -> str | None:
    """After failed calls, reset still brings an output to its default, and a write, alone or as a block, brings it to
    its level."""
    outputs = context.required_outputs
    with context.opened() as probe:
        for output in outputs:
            probe.write(output.channel, output.other())
        context.fail_some(probe)
        probe.timeout = context.patience
        for output in outputs:
            probe.reset(output.channel, output.default)
            context.expect(probe, output, output.default, "reset after failed calls")
        if context.subject.line is not None:
            for output, many in _by_both_forms(outputs):
                _carried_out_unknown(context, probe, output, many)
    return context.remark()


def _by_both_forms(outputs: Sequence[Output]) -> list[tuple[Output, bool]]:
    """Return an output to be written alone (False), and an output to be written as a block (True). They differ if there
    are two outputs."""
    return [(outputs[0], False), (outputs[-1], True)] if outputs else []


def _carried_out_unknown(context: RuleContext, probe: Probe, output: Output, many: bool) -> None:
    """Lose the answer to a write that the device has carried out. The driver must then really send the default again,
    because the output is no longer there."""
    for reset in (True, False):
        probe.timeout = context.patience
        probe.write_by(many, output.channel, output.default)
        probe.timeout = context.haste
        context.unanswered(probe.write_by, many, output.channel, output.other())
        probe.timeout = context.patience
        for text in context.readable[:1]:
            context.failure(probe.read, text)  # connected again
        if reset:
            probe.reset(output.channel, output.default)
        else:
            rewrite(context, probe, output, output.default, "a write without an answer", many=many)
        call = "reset" if reset else "write_many" if many else "write"
        context.expect(probe, output, output.default, f"{call} after a write without an answer")


@rule(Cost(opens=4, each=12, calls=15, connects=8, waits=8, more=further(10)))
def vanish(context: RuleContext) -> str | None:
    """While the device is away, each call fails in time. It does not raise ChannelsFailed, because that error says that
    the device answers. When the device is back, the next call works, however many calls have failed. (If none has
    failed, the first call may find the end of the connection.) Its reading is right, and failed writes are not
    repeated. A level that was written before is written again if it is requested, alone and as a block, because the
    device may have lost it."""
    loss = context.loss
    with context.opened() as probe:
        alone: list[DriverCall] = [partial(probe.read, text) for text in context.readable[:MAX_ALONE]]
        for call in (*context.transfers(probe), *alone):
            call()  # what is kept of it must not be given later
        context.await_levels(probe)
        before = {text: probe.read(text) for text in context.known[:MAX_ALONE]}
        probe.timeout = context.haste
        with loss():
            for call in (*alone, *reversed(context.transfers(probe, default=False))):
                error = in_time(context, probe, call)
                if error is None:
                    raise RuleBroken(f"{context.watch.doing} succeeded while the device was away")
                if isinstance(error, ChannelsFailed):
                    raise RuleBroken(f"{context.watch.doing} raised ChannelsFailed, as if the device answered")
            other = _not_opened(context)
            for _ in context.as_time_allows(range(MANY_FAILURES), 0, "failures in a row"):
                context.failure(context.transfers(probe)[0])
        probe.timeout = context.patience
        _reads(context, probe, before)
        _writes_what_failed(context, probe)
        context.must_work(probe, "the device is back", default=False)
        _right(context, probe, "the device was away")
        _writes_again(context, probe)
        _opens_after_all(context, other)
        with loss():
            pass  # nobody has noticed
        for call in context.transfers(probe):
            if (error := context.failure(context.insist, call)) is not None:
                raise RuleBroken(
                    f"the device was away and is back, but {context.watch.doing} fails: {text_of(error)}"
                ) from error
    unseen = context.subject.outputs and (context.subject.levels is None or not context.readable)
    return context.looked(
        *(["it could not be seen whether a failed write is repeated: there is no record of levels"] if unseen else [])
    )


def _reads(context: RuleContext, probe: Probe, before: Mapping[str, int]) -> None:
    """Read the channels when the device is back. If only its line was cut, the first reading of each channel must be as
    right as the next one. The readings move no output, because a failed write must not be repeated later. What the
    device itself did to its outputs meanwhile is not judged."""
    recorded = context.visible if context.subject.levels is not None else ()
    levels = {output: context.level(probe, output) for output in recorded}
    try:
        first = {text: probe.read(text) for text in before or context.readable[:1]}
    except OSError as error:
        raise RuleBroken(f"after the device came back, {context.watch.doing} fails: {text_of(error)}") from error
    for output, raw in levels.items():
        now = context.level(probe, output)
        if context.same(output, output.other(), now) and not context.same(output, output.other(), raw):
            raise RuleBroken(f"{output.channel} went from {raw} to {now} because a failed write was repeated later")
    if context.subject.line is None:
        return  # it was the device that went, not its line: what it has lost may come back by itself
    for text, raw in before.items():
        then = probe.read(text)
        if context.alike(text, raw, then) and not context.alike(text, raw, first[text]) and not context.told(probe):
            why = f"the first reading of {text} after the device came back was {first[text]}, the next reading {then}"
            raise RuleBroken(why, f"reading of {text}")


def _writes_what_failed(context: RuleContext, probe: Probe) -> None:
    """Write the block again that failed while the device was away."""
    outputs = context.subject.outputs
    if not outputs:
        return
    probe.write_many([each.channel for each in outputs], [each.other() for each in outputs])
    for output in context.visible:
        context.expect(probe, output, output.other(), f"write_many of {output.other()}, which had failed before")


def _writes_again(context: RuleContext, probe: Probe) -> None:
    """Write a level that the driver had already written before the device was away. Another client has moved the output
    since then."""
    if context.subject.sole_writer or not context.visible:
        return
    first = context.visible[0]
    with context.second(direct=context.subject.direct is not None) as other:
        if other is None or context.failure(context.insist, context.ready, other, first.channel) is not None:
            return  # a driver may find out with its first call only that there is no room for it
        for output, many in _by_both_forms(context.visible):
            raw = output.other()
            context.ready(other, output.channel)
            rewrite(context, probe, output, raw, "the device was away", many=many)
            with context.loss():
                context.failure(context.transfers(probe)[0])
            for level in (raw, output.default):  # the other client may send changes only
                rewrite(context, other, output, level, "the device was away")
            rewrite(context, probe, output, raw, "the device was away", many=many)
            call = f"write_many of {raw}" if many else f"write({raw})"
            context.expect(probe, output, raw, f"{call}, written before the device was away, and moved since")


def _not_opened(context: RuleContext) -> Probe:
    """Check that another driver cannot be opened or cannot be used, and that it can be closed. Return this driver."""
    probe = context.new()
    probe.timeout = context.haste
    error = in_time(context, probe, probe.open)
    if error is None and context.failure(context.transfers(probe)[0]) is None:
        raise RuleBroken(f"{context.watch.doing} of a new driver succeeded while the device was away")
    probe.close()
    return probe


def _opens_after_all(context: RuleContext, probe: Probe) -> None:
    """Check that a driver which could not be opened can be opened when the device is back, unless the device accepts
    only one client."""
    probe.timeout = context.patience
    with context.second() as room:
        pass
    if room is None:
        return
    try:
        if (error := context.failure(probe.open)) is not None:
            raise RuleBroken(
                f"open failed while the device was away, and still fails after the device came back: {text_of(error)}"
            ) from error
    finally:
        context.failure(probe.close)


def _right(context: RuleContext, probe: Probe, after: str) -> None:
    """Check that the outputs go to the written levels, as far as they can be observed."""
    for number, output in enumerate(context.visible):
        probe.write(output.channel, output.other(number))
        context.expect(probe, output, output.other(number), f"write({output.other(number)}) since {after}")


@rule(Cost(opens=3, each=22, calls=14))
def two_clients(context: RuleContext) -> str | None:
    """A second driver of the device is refused by an OSError, or works. The first driver continues to work. A value
    that one driver writes stays when the other driver writes something else, alone or as a block, and the other driver
    reads that value. Reset and initialise then still reach the default."""
    with context.opened() as first:
        context.use(first)  # a device may be in use from the first transfer on
        second = context.new()
        try:
            refusal = context.failure(_join, context, second)
            if refusal is None:
                _right(context, second, "it is the second client")
                _right(context, first, "there is a second client")
                if not context.subject.sole_writer:
                    _side_by_side(context, first, second)
                    _read_back(context, first, second)
                    _to_defaults(context, first, second)
            context.must_work(first, "a second client is there")
        finally:
            error = context.failure(context.leave, second)
        if error is not None and refusal is None:
            raise RuleBroken(f"the second client could not leave: {text_of(error)}") from error
        context.must_work(first, "a second client came and left")
        _right(context, first, "a second client came and left")
    if refusal is not None:
        context.looked()
        return f"the second client is refused: {text_of(refusal)}"
    if context.subject.sole_writer:
        return context.looked("a second client must not write")
    alone = len(context.visible) == 1
    return context.looked(*(["there is only one output, so no other output was written"] if alone else []))


def _side_by_side(context: RuleContext, first: Probe, second: Probe) -> None:
    """Let one client write an output, and another client another one: neither may change what the other wrote."""
    for one, other in pairwise((*context.visible, *context.visible[:1])):
        if one == other:
            return
        for client in (second, first):
            client.write(other.channel, other.default)
            client.write(one.channel, one.default)
        second.write(other.channel, other.other(1))
        first.write(one.channel, one.other(1))
        try:
            context.expect(second, other, other.other(1), f"a write of another client to {one.channel}")
            context.expect(first, one, one.other(1), f"a write of another client to {other.channel}")
        except RuleBroken as broken:
            _brought_alone(context, (one, other))
            raise RuleBroken(f"{broken} {SOLE_WRITER}") from broken
    for one in context.visible:
        second.write(one.channel, one.other(1))
        others = [each for each in context.visible if each != one]
        first.write_many([each.channel for each in others], [each.other() for each in others])
        try:
            context.expect(second, one, one.other(1), "a write_many of another client to all others")
        except RuleBroken as broken:
            raise RuleBroken(f"{broken} {SOLE_WRITER}") from broken


def _brought_alone(context: RuleContext, outputs: Sequence[Output]) -> None:
    """Raise RuleBroken if a new driver alone also brings the outputs to wrong levels, because then the cause is not the
    second client."""
    with suppress(OSError), context.opened() as alone:
        for output in outputs:
            alone.write(output.channel, output.other(1))
            context.confirm(alone, output, output.other(1))


def _read_back(context: RuleContext, first: Probe, second: Probe) -> None:
    """Let the first client read back an output that the second client has written. This is judged only if the level is
    also observed by the counterpart's record or through a loop-back, because each driver may have a separate
    simulation."""
    for output in context.visible:
        text, raw = output.channel, output.other()
        if text not in context.readable or (context.subject.levels is None and context.view(output) == text):
            continue
        read = []
        for level in (raw, output.default):
            first.write(text, level)
            context.is_read(first, output, level)
            read.append(first.read(text))
        second.write(text, raw)
        came = context.is_at if context.subject.levels is not None else context.is_read
        if read[0] == read[1] or not came(first, output, raw):
            continue
        there, found = context.comes_to(lambda: first.read(text), lambda level: level != read[1])  # noqa: B023
        if not there:
            why = f"{text} reads {found}, which the driver has written, but another client has written {raw} since then"
            raise RuleBroken(f"{why} {SOLE_WRITER}")


def _to_defaults(context: RuleContext, first: Probe, second: Probe) -> None:
    """Check that reset and initialise reach the default, although it is the last level that the first client has
    written. The second client has moved the output since then."""
    for output in context.visible:
        for call in (first.reset, first.initialize):
            first.write(output.channel, output.default)
            for raw in (output.default, output.other()):  # the second may send changes only
                second.write(output.channel, raw)
            call(output.channel, output.default)
            context.expect(first, output, output.default, f"{context.watch.doing}, which another client had moved")


def _join(context: RuleContext, second: Probe) -> None:
    context.bring_up(second)
    context.use(second)


@rule(Cost(opens=2, each=10, calls=26, settles=8, more=further(160)))
def fresh(context: RuleContext) -> str | None:
    """A reading belongs to the call that returns it, not to an earlier call."""
    # Another driver moves an input; the first has read it before. Only where that level has come for sure
    levels = context.subject.levels
    looped = [each for each in context.viewed if context.view(each) != each.channel or levels is not None]
    if not looped:
        raise NotTried("no input is looped back from an output, and no counterpart records levels")
    with context.opened() as probe, context.second() as second:
        if context.told(probe):
            raise NotTried("the driver receives its values from elsewhere, and gives their ages: see the rule ages")
        for output in looped:
            _is_fresh(context, probe, second, output)
    return None


def _is_fresh(context: RuleContext, probe: Probe, second: Probe | None, output: Output) -> None:
    view = context.view(output)
    apart = probe.driver.simulates_time  # each has a plant of its own
    other = second if view != output.channel and not apart else None
    place = context.readable.index(view)
    readings: tuple[Callable[[], int], ...] = (
        lambda: probe.read(view),
        lambda: probe.read_many((view,))[0],
        lambda: probe.read_many(context.readable)[place],  # as a period reads it
    )
    for reading in readings:
        old = number = 0
        while old < MAX_OLD and number < MAX_OLD * (1 + old):  # one that happens to be at the new level is no proof
            old += _is_old(context, probe, other, output, reading, number)
            number += 1
        if old == MAX_OLD:
            text = f"{context.watch.doing} gave an earlier reading of {view} in {old} of {number} calls"
            raise RuleBroken(text, f"earlier reading of {view}")
    ends = output.least, output.greatest
    for levels, still, pause, when in (
        (ends, 1, 0.0, "after a step over the whole range"),
        (None, 1, PAUSE, f"{duration(PAUSE)} after the previous reading, although the new level had arrived"),
        (None, STILL, 0.0, f"once it had been the same {STILL} times"),
    ):
        if not context.budget.more:
            return
        turns = [(n, still + 3 * n * (still > 1)) for n in range(2 * MAX_OLD)]  # it may ask now and then
        found = (_is_old(context, probe, other, output, readings[-1], *turn, levels, pause) for turn in turns)
        if sum(found) >= MAX_OLD:
            text = f"{context.watch.doing} gave an earlier reading of {view}, {when}"
            raise RuleBroken(text, f"earlier reading of {view}")


def _is_old(
    context: RuleContext, probe: Probe, other: Probe | None, output: Output, reading: Callable[[], int], number: int,
    still: int = 1, levels: tuple[int, int] | None = None, pause: float = 0.0,
) -> bool:  # fmt: skip
    """Return True if an earlier level is read `still` times, after a pause, although another level has certainly
    arrived since. `levels`: the two levels in turn; by default the output's default and another level."""
    levels = levels or (output.default, output.other(number))
    before, raw = levels[::-1] if number % 2 else levels
    mover = probe if other is None else other
    context.ready(mover, output.channel)
    mover.write(output.channel, before)
    context.is_read(probe, output, before)
    for _ in range(still):
        reading()
    earlier = reading()
    sleep(pause)
    mover.write(output.channel, raw)
    context.arrive(other, output, raw)
    found = reading()
    if not context.alike(context.view(output), earlier, found) or context.same(output, raw, found):
        return False
    context.confirm(mover, output, raw)
    return True


@rule(Cost(opens=3, connects=2, waits=5, sleeps=1))
def errors_are_named(context: RuleContext) -> None:
    """A failure in a connected machine names the objects, their channels and the driver."""
    loss = context.subject.line.silent if context.subject.line is not None else context.loss
    machine, wiring = _machine_of(context)
    connection = connect(machine, wiring)
    connection.device_claim = DeviceClaim((), "conformance")
    connection.pause = lambda seconds: None
    texts = {path: entry["channel"] for path, entry in wiring["wire"].items()}
    failed = False
    with _wired(connection) as m:
        connection.driver("subject").timeout = context.haste
        with loss():
            for step in (m.sample, m.update):
                try:
                    step()
                except DriverError as error:
                    failed = True
                    _check_names(error, texts)
        connection.driver("subject").timeout = context.patience
    if not failed and context.new().driver.only_off_cycle:
        raise NotTried(
            "umo uses this driver only off the cycle, where a failed value becomes stale and no error is raised"
        )
    if not failed:
        raise NotTried("no transfer of a connected machine has failed without an answer")


@contextmanager
def _wired(connection: connect[Machine]) -> Iterator[Machine]:
    """Return a context with the connected machine. Raises RuleBroken if umo does not wire the channels."""
    with ExitStack() as stack:
        try:
            machine = stack.enter_context(connection)
        except WiringError as error:
            raise RuleBroken(f"umo does not wire the channels: {text_of(error)}") from error
        yield machine


def _check_names(error: DriverError, texts: dict[str, str]) -> None:
    if not error.failures:
        raise RuleBroken(f"the error names no object: {error}")
    for failure in error.failures:
        if texts.get(failure.path) != failure.channel:
            why = f"the error names {failure.path} (channel {failure.channel}), which was not transferred"
            raise RuleBroken(why, TEXTS)


class Machine(Compound):
    """The machine that the kit makes from a subject."""

    outputs: list[DigitalActuator]
    inputs: list[DigitalSensor]


def _machine_of(context: RuleContext) -> tuple[Machine, dict[str, Any]]:
    """Return a machine with an object for each channel, and its wiring. Outputs with only one level or with a very wide
    range are left out."""
    outputs = [
        each
        for each in context.subject.outputs
        if each.least < each.greatest and max(abs(each.least), abs(each.greatest)) <= MAX_LEVEL
    ]
    inputs = [text for text in context.readable if text not in {each.channel for each in outputs}]
    machine = Machine(
        outputs=[
            DigitalActuator("count", default=o.default, minimum=o.least, maximum=o.greatest, resolution=1)
            for o in outputs
        ],
        inputs=[_sensor(context, text) for text in inputs],
    )
    wire = {f"outputs.{i}": {"driver": "subject", "channel": each.channel} for i, each in enumerate(outputs)}
    wire |= {f"inputs.{i}": {"driver": "subject", "channel": text} for i, text in enumerate(inputs)}
    driver = context.new().driver
    table: dict[str, Any] = {"type": driver, "timeout": context.patience}
    if driver.only_off_cycle:
        table |= {"off_cycle": True, "period": OWN_PERIOD}
    return machine, {"drivers": {"subject": table}, "wire": wire}


def _sensor(context: RuleContext, text: str) -> DigitalSensor:
    channel = context.new().channel(text)
    low, high = max(channel.lowest, -MAX_LEVEL), min(channel.highest, MAX_LEVEL)
    return DigitalSensor("count", minimum=low, maximum=high, resolution=1)

"""Rules of the device: it vanishes and returns, has two clients; its errors name the objects of a machine."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

from umo.cycle import connect
from umo.errors import DriverError, text_of
from umo.objects import Compound, DigitalActuator, DigitalSensor
from umo.system.custody import Custody
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.recovery import rewrite
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.timing_rules import in_time
from umo.testing.conformance.trial import DriverCall, Trial

MAX_ALONE = 8
"""Channels that are read alone while the device is away."""
FRESH_LEVELS = 3
"""Levels of each output that are read afresh."""
MAX_LEVEL = 1 << 40
"""Raw level of an object at most, up and down."""
SOLE_WRITER = "(if it must be alone: `sole_writer` of the subject, --sole-writer)"


@rule("reset after failure", "Reset reaches the default also after calls that failed.", Cost(each=12, waits=6))
def reset_after_failure(trial: Trial) -> str | None:
    outputs = trial.required_outputs
    with trial.opened() as probe:
        for output in outputs:
            probe.write(output.channel, output.other())
        trial.fail_some(probe)
        probe.timeout = trial.patience
        for output in outputs:
            probe.reset(output.channel, output.default)
            trial.expect(probe, output, output.default, "reset after failed calls")
        if trial.subject.line is not None:
            for output in outputs[:2]:
                _carried_out_unknown(trial, probe, output)
    return trial.remark()


def _carried_out_unknown(trial: Trial, probe: Probe, output: Output) -> None:
    """A write that the device carried out, and whose answer got lost: the default that was written before it is no
    longer there."""
    for reset in (True, False):
        probe.timeout = trial.patience
        probe.write(output.channel, output.default)
        trial.hurry(probe)
        trial.unanswered(probe.write, output.channel, output.other())
        probe.timeout = trial.patience
        for text in trial.readable[:1]:
            trial.failure(probe.read, text)  # connected again
        if reset:
            probe.reset(output.channel, output.default)
        else:
            rewrite(trial, probe, output, output.default, "a write without an answer")
        trial.expect(probe, output, output.default, f"{'reset' if reset else 'write'} after a write without an answer")


@rule(
    "vanish",
    "While the device is away each call fails in time; when it is back the next call works, and what failed is not "
    "made up for.",
    Cost(opens=4, each=17, waits=8),
)
def vanish(trial: Trial) -> str | None:
    loss = trial.loss
    with trial.opened() as probe:
        alone: list[DriverCall] = [partial(probe.read, text) for text in trial.readable[:MAX_ALONE]]
        for call in (*trial.transfers(probe), *alone):
            call()  # what is kept of it must not be given later
        trial.hurry(probe)
        with loss():
            for call in (*alone, *reversed(trial.transfers(probe, default=False))):
                if in_time(trial, probe, call) is None:
                    raise RuleBroken(f"{trial.watch.doing} succeeded while the device was away")
            other = _not_opened(trial)
        probe.timeout = trial.patience
        _moves_nothing(trial, probe)
        trial.must_work(probe, "the device is back", default=False)
        _right(trial, probe, "the device was away")
        _opens_after_all(trial, other)
        with loss():
            pass  # nobody has noticed
        for call in trial.transfers(probe):
            if (error := trial.failure(trial.insist, call)) is not None:
                raise RuleBroken(f"the device was away and is back, but {trial.watch.doing} fails: {text_of(error)}")
    return trial.looked()


def _moves_nothing(trial: Trial, probe: Probe) -> None:
    """A reading, now that the device is back, moves no output: a write that failed is not made up for. What the device
    itself did to its outputs meanwhile is not judged."""
    if trial.subject.levels is None or not trial.readable:
        return
    before = {output: trial.level(probe, output) for output in trial.visible}
    probe.read(trial.readable[0])
    for output, raw in before.items():
        now = trial.level(probe, output)
        if trial.same(output, output.other(), now) and not trial.same(output, output.other(), raw):
            raise RuleBroken(f"{output.channel} went from {raw} to {now} by a write that had failed")


def _not_opened(trial: Trial) -> Probe:
    """Another driver cannot be opened, or not be used, and can be closed."""
    probe = trial.new()
    trial.hurry(probe)
    error = in_time(trial, probe, probe.open)
    if error is None and trial.failure(trial.transfers(probe)[0]) is None:
        raise RuleBroken(f"{trial.watch.doing} of a new driver succeeded while the device was away")
    probe.close()
    return probe


def _opens_after_all(trial: Trial, probe: Probe) -> None:
    """A driver that could not be opened, now that the device is back; refused where the device takes one client."""
    probe.timeout = trial.patience
    with trial.second() as room:
        pass
    if room is None:
        return
    try:
        if (error := trial.failure(probe.open)) is not None:
            raise RuleBroken(f"open failed while the device was away, and fails since it is back: {text_of(error)}")
    finally:
        trial.failure(probe.close)


def _right(trial: Trial, probe: Probe, after: str) -> None:
    """The outputs obey, as far as they can be seen."""
    for number, output in enumerate(trial.visible):
        probe.write(output.channel, output.other(number))
        trial.expect(probe, output, output.other(number), f"write({output.other(number)}) since {after}")


@rule(
    "two clients",
    "A second driver of the device is refused by an OSError, or works; the first goes on working. What one writes "
    "stays when the other writes something else, and is what the other reads.",
    Cost(opens=3, each=26),
)
def two_clients(trial: Trial) -> str | None:
    with trial.opened() as first:
        trial.use(first)  # a device may be in use from the first transfer on
        second = trial.new()
        try:
            refusal = trial.failure(_join, trial, second)
            if refusal is None:
                _right(trial, second, "it is the second client")
                _right(trial, first, "there is a second client")
                if not trial.subject.sole_writer:
                    _side_by_side(trial, first, second)
                    _read_back(trial, first, second)
            trial.must_work(first, "a second client is there")
        finally:
            error = trial.failure(trial.leave, second)
        if error is not None and refusal is None:
            raise RuleBroken(f"the second client could not leave: {text_of(error)}")
        trial.must_work(first, "a second client came and left")
        _right(trial, first, "a second client came and left")
    remark = trial.looked()
    if refusal is not None:
        return f"the second is refused: {text_of(refusal)}"
    return "; ".join(filter(None, (remark, "a second client must not write" if trial.subject.sole_writer else "")))


def _side_by_side(trial: Trial, first: Probe, second: Probe) -> None:
    """One client writes an output, the other one another: neither changes what the other wrote."""
    for one, other in pairwise((*trial.visible, *trial.visible[:1])):
        if one == other:
            return
        for client in (second, first):
            client.write(other.channel, other.default)
            client.write(one.channel, one.default)
        second.write(other.channel, other.other(1))
        first.write(one.channel, one.other(1))
        try:
            trial.expect(second, other, other.other(1), f"a write of another client to {one.channel}")
            trial.expect(first, one, one.other(1), f"a write of another client to {other.channel}")
        except RuleBroken as broken:
            raise RuleBroken(f"{broken} {SOLE_WRITER}") from broken


def _read_back(trial: Trial, first: Probe, second: Probe) -> None:
    """The first client reads an output itself, which the second has written. Only where it is seen elsewhere (by the
    counterpart's record, or through a loop-back) that the level has come: of a simulation each driver may have its own.
    """
    for output in trial.visible:
        text, raw = output.channel, output.other()
        if text not in trial.readable or (trial.subject.levels is None and trial.view(output) == text):
            continue
        read = []
        for level in (raw, output.default):
            first.write(text, level)
            trial.is_read(first, output, level)
            read.append(first.read(text))
        second.write(text, raw)
        came = trial.is_at if trial.subject.levels is not None else trial.is_read
        if read[0] == read[1] or not came(first, output, raw):
            continue
        there, found = trial.comes_to(lambda: first.read(text), lambda level: level != read[1])  # noqa: B023
        if not there:
            why = f"{text} reads {found}, as the driver has written, but another client has written {raw} since"
            raise RuleBroken(f"{why} {SOLE_WRITER}")


def _join(trial: Trial, second: Probe) -> None:
    trial.bring_up(second)
    trial.use(second)


@rule("fresh", "A reading is that of its own call, not of an earlier one.", Cost(opens=2, each=12))
def fresh(trial: Trial) -> str | None:
    """Another driver moves an input; the first has read it before. Only where that level has come for sure."""
    looped = [each for each in trial.viewed if trial.view(each) != each.channel or trial.subject.levels is not None]
    if not looped:
        raise NotTried("no input is looped back from an output, and no counterpart records levels")
    with trial.opened() as probe, trial.second() as second:
        for output in looped:
            _is_fresh(trial, probe, second, output)
    return None


def _is_fresh(trial: Trial, probe: Probe, second: Probe | None, output: Output) -> None:
    view, old = trial.view(output), 0
    other = second is not None and view != output.channel
    mover = second if second is not None and other else probe
    for number in range(FRESH_LEVELS):
        levels = (output.default, output.other(number))
        before, raw = levels if number % 2 else levels[::-1]
        mover.write(output.channel, before)
        trial.is_read(probe, output, before)
        earlier = probe.read(view)
        mover.write(output.channel, raw)
        trial.arrive(second if other else None, output, raw)
        found = probe.read_many((view,))[0] if number % 2 else probe.read(view)
        old += trial.alike(view, earlier, found) and not trial.same(output, raw, found)
    if old >= FRESH_LEVELS - 1:
        raise RuleBroken(f"{trial.watch.doing} gave an earlier reading, {old} times of {FRESH_LEVELS}")


@rule(
    "errors are named",
    "A failure in a connected machine names the objects, their channels and the driver.",
    Cost(opens=2, waits=2),
)
def errors_named(trial: Trial) -> None:
    loss = trial.subject.line.silent if trial.subject.line is not None else trial.loss
    machine, wiring = _machine_of(trial)
    connection = connect(machine, wiring)
    connection.custody = Custody((), "conformance")
    connection.pause = lambda seconds: None
    texts = {path: entry["channel"] for path, entry in wiring["wire"].items()}
    failed: DriverError | None = None
    with connection as m:
        connection.driver("subject").timeout = trial.haste
        with loss():
            for step in (m.sample, m.update):
                try:
                    step()
                except DriverError as error:
                    failed = error
                    _check_names(error, texts)
        connection.driver("subject").timeout = trial.patience
    if failed is None:
        raise NotTried("no transfer of a connected machine has failed without an answer")


def _check_names(error: DriverError, texts: dict[str, str]) -> None:
    if not error.failures:
        raise RuleBroken(f"the error names no object: {error}")
    for failure in error.failures:
        if texts.get(failure.path) != failure.channel:
            raise RuleBroken(f"the error names {failure.path} (channel {failure.channel}), which was not transferred")


class Machine(Compound):
    """Machine that the kit makes of a subject."""

    outputs: list[DigitalActuator]
    inputs: list[DigitalSensor]


def _machine_of(trial: Trial) -> tuple[Machine, dict[str, Any]]:
    """A machine with an object of each channel and its wiring, without outputs of one level or of very wide ranges."""
    outputs = [
        each
        for each in trial.subject.outputs
        if each.least < each.greatest and max(abs(each.least), abs(each.greatest)) <= MAX_LEVEL
    ]
    inputs = [text for text in trial.readable if text not in {each.channel for each in outputs}]
    machine = Machine(
        outputs=[
            DigitalActuator("count", default=o.default, minimum=o.least, maximum=o.greatest, resolution=1)
            for o in outputs
        ],
        inputs=[_sensor(trial, text) for text in inputs],
    )
    wire = {f"outputs.{i}": {"driver": "subject", "channel": each.channel} for i, each in enumerate(outputs)}
    wire |= {f"inputs.{i}": {"driver": "subject", "channel": text} for i, text in enumerate(inputs)}
    drivers = {"subject": {"type": trial.new().driver, "timeout": trial.patience}}
    return machine, {"drivers": drivers, "wire": wire}


def _sensor(trial: Trial, text: str) -> DigitalSensor:
    channel = trial.new().channel(text)
    low, high = max(channel.lowest, -MAX_LEVEL), min(channel.highest, MAX_LEVEL)
    return DigitalSensor("count", minimum=low, maximum=high, resolution=1)

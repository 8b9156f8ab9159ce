"""Rules of the segments: initialise, reset, finalise, open and close."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from umo.testing.conformance.probe import Probe, call_of
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.trial import Trial
from umo.text import reported


@rule("initialise", "An output comes up at its default, with no other level in between.")
def initialise(trial: Trial) -> str | None:
    for output in trial.seen:
        for left in dict.fromkeys((output.default, output.other())):
            _leave_at(trial, output, left)
            _initialise(trial, output, left)
    short = "short pulses cannot be seen" if trial.subject.levels is None else ""
    return "; ".join(filter(None, (trial.remark, short))) or None


def _leave_at(trial: Trial, output: Output, raw: int) -> None:
    """As a process that died leaves it; the other outputs at other levels."""
    trial.left_dirty()
    probe = trial.new()
    try:
        probe.open()
        for each in trial.subject.outputs:
            probe.initialize(each.channel, each.default)
            probe.write(each.channel, raw if each == output else each.other())
    finally:
        probe.close()


def _initialise(trial: Trial, output: Output, left: int) -> None:
    probe = trial.new()
    recorded = trial.subject.levels or (lambda text: ())
    others = [each for each in trial.visible if each != output]
    try:
        for each in others:
            recorded(each.channel)
        with trial.observing(output, until=output.default) as levels:
            probe.open()
            probe.initialize(output.channel, output.default)
        _check_levels(trial, output, levels, left, output)
        for each in others:
            _check_levels(trial, each, recorded(each.channel), each.other(), output)
        trial.expect(probe, output, output.default, f"initialize({output.default})")
    finally:
        with trial.own_error_first():
            trial.leave(probe)


def _check_levels(trial: Trial, output: Output, levels: Sequence[int], left: int, initialised: Output) -> None:
    """Beside what it was at before (the first of the levels), an output may have been at its default."""
    for level in levels[1:]:
        if level != levels[0] and not any(trial.same(output, raw, level) for raw in (left, output.default)):
            shown = ", ".join(map(str, levels))
            doing = "it" if output == initialised else initialised.channel
            raise RuleBroken(f"{output.channel} was at {shown} while {doing} was initialised at {initialised.default}")


@rule(
    "reset", "Reset brings an output to its default from any level; it changes nothing of an input or another output."
)
def reset(trial: Trial) -> str | None:
    with trial.opened() as probe:
        _check_inputs(trial, probe)
        for output in trial.seen:
            for raw in output.inner:
                probe.write(output.channel, raw)
                probe.reset(output.channel, output.default)
                trial.expect(probe, output, output.default, f"reset({output.default}) from {raw}")
        _check_others(trial, probe)
    return trial.remark


def _check_others(trial: Trial, probe: Probe) -> None:
    """Outputs keep their levels while one after the other is reset."""
    for output in trial.seen:
        probe.write(output.channel, output.other())
    for number, gone in enumerate(trial.seen):
        probe.reset(gone.channel, gone.default)
        for output in trial.seen[number + 1 :]:
            trial.expect(probe, output, output.other(), f"reset of {gone.channel}")


def _check_inputs(trial: Trial, probe: Probe) -> None:
    for text in trial.steady:
        before = probe.read(text)
        probe.reset(text, None)
        if (after := probe.read(text)) != before:
            raise RuleBroken(f"{text} read {before} before its reset and {after} after it")


@rule("reset after failure", "Reset reaches the default also after calls that failed.")
def reset_after_failure(trial: Trial) -> str | None:
    outputs = trial.seen
    with trial.opened() as probe:
        for output in outputs:
            probe.write(output.channel, output.other())
        trial.fail_some(probe)
        probe.driver.timeout = trial.patience
        for output in outputs:
            probe.reset(output.channel, output.default)
            trial.expect(probe, output, output.default, "reset after failed calls")
    return trial.remark


@rule("finalise", "Channels are finalised in any order; the others go on working, and keep their levels.")
def finalise(trial: Trial) -> str | None:
    if len(trial.channels) < 2:
        raise NotTried("the subject has one channel only")
    for order in (trial.channels, trial.channels[::-1]):
        with trial.opened() as probe:
            for output in trial.subject.outputs:
                probe.write(output.channel, output.other())
            for gone, text in pairwise(order):
                probe.reset(gone, trial.default(gone))
                probe.finalize(gone)
                _check_left(trial, probe, gone)
                try:
                    _use(trial, probe, text)
                except OSError as error:
                    raise RuleBroken(f"{text} failed after {gone} was finalised: {reported(error)}") from error
    return trial.looked()


def _check_left(trial: Trial, probe: Probe, gone: str) -> None:
    """The outputs that were not finalised are where they were."""
    for output in trial.visible:
        if output.channel in probe.opened:
            trial.expect(probe, output, output.other(), f"finalize of {gone}")


def _use(trial: Trial, probe: Probe, text: str) -> None:
    for output in trial.subject.outputs:
        if output.channel == text:
            probe.write(text, output.other())
    if text in trial.readable:
        probe.read(text)


@rule(
    "reopen",
    "A closed driver can be opened again, and one that is not open can be closed. Outputs come up at their defaults "
    "again, also if they were driven in the meantime.",
)
def reopen(trial: Trial) -> str | None:
    probe = trial.new()
    probe.close()
    for _ in range(3):
        try:
            probe.open()
            for text in trial.channels:
                probe.initialize(text, trial.default(text))
            for output in trial.visible:
                trial.expect(probe, output, output.default, f"initialize({output.default}) of a driver opened again")
            for text in trial.channels:
                _use(trial, probe, text)
        except OSError as error:
            raise RuleBroken(f"opened again, {call_of(error)} failed: {reported(error)}") from error
        finally:
            with trial.own_error_first():
                trial.leave(probe)
        probe.close()
        for output in trial.subject.outputs[:1]:
            _leave_at(trial, output, output.other())
    _open_in_turns(trial)
    return trial.looked()


def _open_in_turns(trial: Trial) -> None:
    """Another driver of the same device after each other."""
    for _ in range(3):
        with trial.opened() as probe:
            for text in trial.channels:
                _use(trial, probe, text)

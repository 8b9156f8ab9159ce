"""Rules of the segments: initialise, reset, finalise, open and close."""

from __future__ import annotations

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
    """As a process that died leaves it."""
    probe = trial.new()
    try:
        probe.open()
        probe.initialize(output.channel, output.default)
        probe.write(output.channel, raw)
    finally:
        probe.close()


def _initialise(trial: Trial, output: Output, left: int) -> None:
    probe = trial.new()
    try:
        with trial.observing(output, until=output.default) as levels:
            probe.open()
            probe.initialize(output.channel, output.default)
        for level in levels[1:]:
            if not any(trial.same(output, raw, level) for raw in (left, output.default)):
                shown = ", ".join(map(str, levels))
                raise RuleBroken(f"{output.channel} was at {shown} while it was initialised at {output.default}")
        trial.expect(probe, output, output.default, f"initialize({output.default})")
    finally:
        with trial.own_error_first():
            trial.leave(probe)


@rule("reset", "Reset brings an output to its default from any level; of an input it changes nothing.")
def reset(trial: Trial) -> str | None:
    with trial.opened() as probe:
        _check_inputs(trial, probe)
        for output in trial.seen:
            for raw in output.inner:
                probe.write(output.channel, raw)
                probe.reset(output.channel, output.default)
                trial.expect(probe, output, output.default, f"reset({output.default}) from {raw}")
    return trial.remark


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


@rule("finalise", "Channels are finalised in any order; the others go on working.")
def finalise(trial: Trial) -> None:
    if len(trial.channels) < 2:
        raise NotTried("the subject has one channel only")
    for order in (trial.channels, trial.channels[::-1]):
        with trial.opened() as probe:
            for gone, text in pairwise(order):
                probe.reset(gone, trial.default(gone))
                probe.finalize(gone)
                try:
                    _use(trial, probe, text)
                except OSError as error:
                    raise RuleBroken(f"{text} failed after {gone} was finalised: {reported(error)}") from error


def _use(trial: Trial, probe: Probe, text: str) -> None:
    default = trial.default(text)
    if default is not None:
        probe.write(text, default)
    if text in trial.readable:
        probe.read(text)


@rule("reopen", "A closed driver can be opened again, and one that is not open can be closed.")
def reopen(trial: Trial) -> None:
    probe = trial.new()
    probe.close()
    for _ in range(3):
        try:
            probe.open()
            for text in trial.channels:
                probe.initialize(text, trial.default(text))
            for text in trial.channels:
                _use(trial, probe, text)
        except OSError as error:
            raise RuleBroken(f"opened again, {call_of(error)} failed: {reported(error)}") from error
        finally:
            with trial.own_error_first():
                trial.leave(probe)
        probe.close()
    _open_in_turns(trial)


def _open_in_turns(trial: Trial) -> None:
    """Another driver of the same device after each other."""
    for _ in range(3):
        with trial.opened() as probe:
            for text in trial.channels:
                _use(trial, probe, text)

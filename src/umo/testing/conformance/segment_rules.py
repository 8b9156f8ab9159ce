"""Rules of the segments: initialise, reset, finalise, open and close."""

from __future__ import annotations

from itertools import pairwise

from umo.drivers.contract import Channel, Direction
from umo.errors import ChannelError
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.testing.conformance.trial import Trial
from umo.text import reported

UNKNOWN = "no such channel \N{REPLACEMENT CHARACTER}"


@rule("channels", "A channel's text means one channel of fixed direction and bits; another text raises ChannelError.")
def channels(trial: Trial) -> None:
    probe, other = trial.new(), trial.new()
    for text in trial.channels:
        channel = probe.channel(text)
        if not isinstance(channel, Channel):
            raise RuleBroken(f"channel({text!r}) returned {channel!r}, not a Channel")
        if channel != other.channel(text) or hash(channel) != hash(other.channel(text)):
            raise RuleBroken(f"channel({text!r}) returned two channels that are not equal")
    for each in trial.subject.outputs:
        channel = probe.channel(each.channel)
        if Direction.OUTPUT not in channel.direction:
            raise RuleBroken(f"{each.channel} is an input")
        if not channel.lowest <= each.least <= each.greatest <= channel.highest:
            raise RuleBroken(f"{each.channel} takes {channel.lowest} to {channel.highest}, not {each.greatest}")
    try:
        probe.driver.channel(UNKNOWN)
    except ChannelError:
        return
    except BaseException as error:
        raise RuleBroken(f"an unknown channel raised {reported(error)}, not ChannelError") from error


@rule("before open", "Before `open` a driver accesses no hardware; `devices` names it alike for two drivers.")
def before_open(trial: Trial) -> None:
    before = trial.subject.line.connections if trial.subject.line is not None else 0
    probe, other = trial.new(), trial.new()
    for text in trial.channels:
        probe.channel(text)
    devices = probe.call("devices", lambda: list(probe.driver.devices()))
    if devices != other.call("devices", lambda: list(other.driver.devices())):
        raise RuleBroken(f"devices() returned {devices} and then another answer")
    if not all(isinstance(each, str) for each in devices):
        raise RuleBroken(f"devices() returned {devices}, not texts")
    if trial.subject.line is not None and trial.subject.line.connections != before:
        raise RuleBroken("it connected to the device before open")


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
            for raw in output.samples:
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
            raise RuleBroken(f"opened again, {trial.watch.doing} failed: {reported(error)}") from error
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

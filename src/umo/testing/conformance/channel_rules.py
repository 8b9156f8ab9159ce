"""Rules of what a driver says before it is opened."""

from __future__ import annotations

from umo.drivers.contract import Channel, Direction
from umo.errors import ChannelError
from umo.testing.conformance.rules import RuleBroken, rule
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
    before = _connections(trial)
    probe, other = trial.new(), trial.new()
    for text in trial.channels:
        probe.channel(text)
    devices = probe.call("devices", lambda: list(probe.driver.devices()))
    if devices != other.call("devices", lambda: list(other.driver.devices())):
        raise RuleBroken(f"devices() returned {devices} and then another answer")
    if not all(isinstance(each, str) for each in devices):
        raise RuleBroken(f"devices() returned {devices}, not texts")
    if _connections(trial) != before:
        raise RuleBroken("it connected to the device before open")


def _connections(trial: Trial) -> int:
    line = trial.subject.line
    if line is None:
        return 0
    line.settle()
    return line.connections

"""Rules of what a driver says before it is opened."""

from __future__ import annotations

from typing import Any

from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import ChannelError, text_of
from umo.testing.conformance.rules import Cost, RuleBroken, rule
from umo.testing.conformance.trial import Trial

UNKNOWN = "no such channel \N{REPLACEMENT CHARACTER}"


@rule("channels", "A channel's text means one channel of fixed direction and bits; another text raises ChannelError.",
      Cost(opens=0, each=0))  # fmt: skip
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
    _check_unknown(trial, probe.driver)


def _check_unknown(trial: Trial, driver: Driver[Any]) -> None:
    """A driver may take any text. One that does not must not take a part of a text for the whole."""
    taken = [text for text in (UNKNOWN, *(text + UNKNOWN[-1] for text in trial.channels[:1])) if _takes(driver, text)]
    if taken and UNKNOWN not in taken:
        raise RuleBroken(f"the channel {taken[0]!r} was taken for {trial.channels[0]!r}")


def _takes(driver: Driver[Any], text: str) -> bool:
    try:
        driver.channel(text)
    except ChannelError:
        return False
    except BaseException as error:
        raise RuleBroken(f"an unknown channel raised {text_of(error)}, not ChannelError") from error
    return True


@rule("before open", "Before `open` a driver accesses no hardware; `devices` names it alike for two drivers.",
      Cost(opens=0, each=0))  # fmt: skip
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

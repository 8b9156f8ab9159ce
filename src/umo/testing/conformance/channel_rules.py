"""Rules about the answers of a driver before it is opened."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any

from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.optional import HasWatchdog
from umo.errors import ChannelError, text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import TEXTS, Cost, RuleBroken, rule

UNKNOWN = "no such channel \N{REPLACEMENT CHARACTER}"
LAST_NUMBER = re.compile(r"([0-9]+)(?!.*[0-9])")
"""Pattern of the last number in a string."""


@rule(Cost(opens=1))
def channels(context: RuleContext) -> None:
    """Each channel's text means one channel with fixed direction and bits. Any other text raises ChannelError. No two
    channels have the same place. If two texts mean the same channel, such as out:1 and out:01, they have the same
    place."""
    probe, other = context.new(), context.new()
    for text in context.channels:
        channel = probe.channel(text)
        if not isinstance(channel, Channel):
            raise RuleBroken(f"channel({text!r}) returned {channel!r}, not a Channel")
        if channel.text != text:
            why = f"channel({text!r}) has the text {channel.text!r}: errors of a block name it"
            raise RuleBroken(why, TEXTS)
        if channel != other.channel(text) or hash(channel) != hash(other.channel(text)):
            raise RuleBroken(f"channel({text!r}) returned two channels that are not equal")
    for each in context.subject.outputs:
        channel = probe.channel(each.channel)
        if Direction.OUTPUT not in channel.direction:
            raise RuleBroken(f"{each.channel} is an input")
        if not channel.lowest <= each.least <= each.greatest <= channel.highest:
            raise RuleBroken(f"{each.channel} takes {channel.lowest} to {channel.highest}, not {each.greatest}")
    _check_places(context, probe)
    if not _check_unknown(context, probe.driver):
        _check_spelling(context, probe)
    if context.failure(other.open) is None:
        _check_open(context, probe, other)
    context.failure(other.close)


def _check_places(context: RuleContext, probe: Probe) -> None:
    """Raise RuleBroken if two channels have the same place, because umo refuses two objects on one place."""
    for one, other in combinations(context.channels, 2):
        if both := {*probe.channel(one).places} & {*probe.channel(other).places}:
            raise RuleBroken(f"{one} and {other} have the same place {both.pop()!r}: umo would accept only one of them")


def _check_open(context: RuleContext, closed: Probe, opened: Probe) -> None:
    """Check that a channel is the same before and after `open`. umo requests channels before `open`."""
    for text in context.channels:
        before = closed.channel(text)
        now = opened.call(f"channel({text!r})", opened.driver.channel, text)
        if (now, now.bits, now.signed, now.direction) != (before, before.bits, before.signed, before.direction):
            context.failure(opened.close)
            raise RuleBroken(f"channel({text!r}) is {before} before open, and {now} after open")


def _check_spelling(context: RuleContext, probe: Probe) -> None:
    """Check that a number with a leading zero means the same channel. umo recognises this only by equal places."""
    for text in context.channels:
        longer = LAST_NUMBER.sub(r"0\1", text)
        if longer != text and longer not in context.channels and _takes(probe.driver, longer):
            other = probe.driver.channel(longer)
            if not {*other.places} & {*probe.channel(text).places}:
                why = f"{longer!r} is accepted too, and has another place than {text}: umo would accept both"
                raise RuleBroken(why)


def _check_unknown(context: RuleContext, driver: Driver[Any]) -> bool:
    """Return True if the driver accepts any text, which is permitted. Any other driver must not accept a text of which
    only a part names a channel."""
    longer = [each for text in context.channels[:1] for each in (text + UNKNOWN[-1], UNKNOWN[-1] + text)]
    taken = [text for text in (UNKNOWN, *longer) if _takes(driver, text)]
    if taken and UNKNOWN not in taken:
        raise RuleBroken(f"the channel {taken[0]!r} was taken for {context.channels[0]!r}")
    return bool(taken)


def _takes(driver: Driver[Any], text: str) -> bool:
    try:
        driver.channel(text)
    except ChannelError:
        return False
    except BaseException as error:
        raise RuleBroken(f"an unknown channel raised {text_of(error)}, not ChannelError") from error
    return True


@rule(Cost(opens=1))
def before_open(context: RuleContext) -> str | None:
    """Before `open` a driver accesses no hardware, not even for `check_watchdog`. `devices` returns the same names for
    two drivers, whenever it is called. `forms` is a list of strings."""
    before = _connections(context)
    probe, other = context.new(), context.new()
    for text in context.channels:
        probe.channel(text)
    devices = _devices(probe)
    if isinstance(probe.driver.forms, str):
        raise RuleBroken(f"forms is the string {probe.driver.forms!r}, not a list of strings")
    if isinstance(driver := probe.driver, HasWatchdog) and (seconds := context.subject.watchdog):
        context.failure(probe.call, "check_watchdog", driver.check_watchdog, seconds)
    for each, which in ((other, "another driver returned"), (probe, "the same driver later returned")):
        if (now := _devices(each)) != devices:
            raise RuleBroken(f"devices() returned {devices}, but {which} {now}")
    if not all(isinstance(each, str) for each in devices):
        raise RuleBroken(f"devices() returned {devices}, not strings")
    if _connections(context) != before:
        raise RuleBroken("the driver connected to the device before open")
    with context.leaving(other):
        if context.failure(other.open) is None and (now := _devices(other)) != devices:
            raise RuleBroken(f"devices() returned {devices} before open, and {now} after open")
    line = context.subject.line
    return None if line is not None and line.ordered else "it could not be seen whether the driver connects before open"


def _devices(probe: Probe) -> list[str]:
    given = probe.call("devices", probe.driver.devices)
    if isinstance(given, str):
        raise RuleBroken(
            f"devices() returned the string {given!r}, not a list of strings: each character would count as a device"
        )
    return list(given)


def _connections(context: RuleContext) -> int:
    line = context.subject.line
    if line is None:
        return 0
    line.settle()
    return line.connections

"""Pulses of an output that is initialised or reset, too short to be seen: they stand in the requests."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.requests import Writes
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import RuleBroken
from umo.testing.conformance.subject import Output

FEWEST_WRITES = 32
"""Writes whose requests are compared, at least: enough of them to change every bit of a number or checksum."""


def looks_for_pulses(context: RuleContext, output: Output) -> bool:
    """Whether the requests of initialise and reset are all the same as those of writes, so that their levels are known.
    RuleBroken if one of these is neither the default nor the level before.

    A driver that also sends anything else, such as a request to enable the output, is not judged: what the device makes
    of a level then is not known.
    """
    levels = _levels(output)
    if context.subject.line is None or len(levels) < 2:
        return False
    found: list[tuple[str, int, bytes]] = []
    with context.opened() as probe:
        samples = _written(context, probe, output, levels)
        for call in (probe.reset, probe.initialize):
            for before in (output.default, output.other()):
                probe.write(output.channel, before)
                sent = _sent(context, call, output.channel, output.default)
                found.append((context.watch.doing, before, sent))
        samples += _written(context, probe, output, levels)  # a number has had each of its bits before or after
    writes = Writes((raw, sent) for raw, sent in samples if sent)
    ways = [(doing, before, writes.levels(sent, (output.default, before))) for doing, before, sent in found]
    for doing, before, way in ways:
        if way is not None and (odd := [raw for raw in way if raw not in (output.default, before)]):
            text = f"{doing} at {output.default} sends the requests of writes of {', '.join(map(str, way))}"
            raise RuleBroken(f"{text}; {output.channel} was at {before}, and must not go to {odd[0]}")
    return all(way is not None for _, _, way in ways)


def _written(context: RuleContext, probe: Probe, output: Output, levels: list[int]) -> list[tuple[int, bytes]]:
    return [(raw, _sent(context, probe.write, output.channel, raw)) for raw in _order(levels)]


def _sent(context: RuleContext, call: Callable[..., object], *arguments: object) -> bytes:
    with context.line.counting() as traffic:
        call(*arguments)
    return b"".join(traffic.requests)


def _levels(output: Output) -> list[int]:
    zero = (0,) if output.least <= 0 <= output.greatest else ()
    return list(dict.fromkeys((output.default, output.other(), *zero, output.least, output.greatest, output.other(1))))


def _order(levels: list[int]) -> list[int]:
    """Each several times, in changing orders, none twice in turn."""
    random, found = Random(1998), list[int]()
    while len(found) < FEWEST_WRITES // 2:
        turn = random.sample(levels, len(levels))
        found += turn[::-1] if found[-1:] == turn[:1] else turn
    return found

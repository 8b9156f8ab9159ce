"""Finds pulses of an output during initialise and reset that are too short to be observed, but appear in the requests.
The requests are compared with those of writes: a request that equals a write of some level has the same effect on the
device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from random import Random

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import RuleBroken
from umo.testing.conformance.subject import Output

MAX_WRITES = 6
"""Largest number of writes that the requests of one call may consist of."""
FEWEST_WRITES = 32
"""Smallest number of writes whose requests are compared. It is large enough that every bit of a number or checksum
changes."""


def looks_for_pulses(context: RuleContext, output: Output) -> bool:
    """Return whether all requests of initialise and reset equal requests of writes, so that their levels are known.
    Raises RuleBroken if one of these levels is neither the default nor the level before.

    A driver that also sends other requests, such as one to enable the output, is not judged, because the effect of a
    level on the device is then unknown.
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


def known_writes(context: RuleContext, probe: Probe, output: Output) -> Writes | None:
    """Return the requests of writes of an output. Return None if these cannot be distinguished from each other, or from
    the requests of a reading."""
    levels = _levels(output)
    writes = Writes((raw, sent) for raw, sent in _written(context, probe, output, levels) if sent)
    with context.line.counting() as traffic:
        probe.read(context.readable[0])
        probe.read_many(context.readable)
    return writes if writes.tell and writes.found_in(traffic.requests) is None else None


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
    """Return each level several times, in changing orders, none twice in a row."""
    random, found = Random(1998), list[int]()
    while len(found) < FEWEST_WRITES // 2:
        turn = random.sample(levels, len(levels))
        found += turn[::-1] if found[-1:] == turn[:1] else turn
    return found


def constant(requests: Sequence[bytes]) -> dict[int, int]:
    """Return, by their indices, the bytes that are the same in all of these requests. Return no bytes if the lengths
    differ."""
    if len(set(map(len, requests))) != 1:
        return {}
    return {place: values[0] for place, values in enumerate(zip(*requests, strict=True)) if len(set(values)) == 1}


class Writes:
    """The requests of the writes of one output, by their levels.

    Bytes that differ between equal writes are numbers, checksums or times. Of these bytes only the bits that no write
    changes are compared, because they may stand for the kind of the request.
    """

    def __init__(self, samples: Iterable[tuple[int, bytes]]) -> None:
        sent: dict[int, list[bytes]] = defaultdict(list)
        for raw, request in samples:
            sent[raw].append(request)
        every = [request for requests in sent.values() for request in requests]
        self._forms = {
            raw: _Form(requests, [each for each in every if len(each) == len(requests[0])])
            for raw, requests in sent.items()
            if len(requests) > 1 and constant(requests)
        }
        for raw, form in tuple(self._forms.items()):
            if any(other.fits(request) for at, other in self._forms.items() if at != raw for request in sent[raw]):
                form.tells = False

    def levels(self, sent: bytes, allowed: Collection[int]) -> list[int] | None:
        """Return the levels, in order, of the writes that equal these requests. If there is more than one way to read
        the requests, the way with allowed levels is chosen. Return None if the requests do not equal writes."""
        ways = list(self._ways(sent, MAX_WRITES))
        return next((way for way in ways if set(way) <= set(allowed)), ways[0] if ways else None)

    @property
    def tell(self) -> bool:
        """True if a level can be recognised in any request."""
        return any(form.tells for form in self._forms.values())

    def found_in(self, requests: Iterable[bytes]) -> int | None:
        """Return the level of a write among these requests, or None if there is none."""
        sent = b"".join(requests)
        return next(
            (raw for raw, form in self._forms.items() for place in range(len(sent) - form.length + 1)
             if form.tells and form.fits(sent[place : place + form.length])), None)  # fmt: skip

    def _ways(self, sent: bytes, most: int) -> Iterator[list[int]]:
        if not sent:
            yield []
        elif most:
            for raw, form in self._forms.items():
                if form.tells and form.fits(sent[: form.length]):
                    yield from ([raw, *rest] for rest in self._ways(sent[form.length :], most - 1))


class _Form:
    """Form that all writes of one level have in common."""

    def __init__(self, requests: Sequence[bytes], alike: Sequence[bytes]) -> None:
        """`alike`: writes of every level, of the same length."""
        self.length = len(requests[0])
        self.tells = True
        """True if no write of another level looks the same."""
        same = constant(requests)
        self._bits = [(0xFF, same[place]) if place in same else _bits([request[place] for request in alike])
                      for place in range(self.length)]  # fmt: skip

    def fits(self, request: bytes) -> bool:
        return len(request) == self.length and all(
            byte & mask == value for byte, (mask, value) in zip(request, self._bits, strict=True)
        )


def _bits(values: Sequence[int]) -> tuple[int, int]:
    """Return the mask of the bits that are the same in all values, and these bits."""
    changed = 0
    for value in values:
        changed |= value ^ values[0]
    return ~changed & 0xFF, values[0] & ~changed

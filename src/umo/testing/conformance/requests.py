"""Requests of a driver, compared with those of its writes: what to the device is the same as a write of some level."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence

MAX_WRITES = 6
"""Writes that the requests of one call may consist of."""


def constant(requests: Sequence[bytes]) -> dict[int, int]:
    """The bytes that are the same in all of these, by their places; none if the lengths differ."""
    if len(set(map(len, requests))) != 1:
        return {}
    return {place: values[0] for place, values in enumerate(zip(*requests, strict=True)) if len(set(values)) == 1}


class Writes:
    """Requests of the writes of one output, by their levels.

    Bytes that differ between equal writes are numbers, checksums or times. Of these, the bits that no write changes are
    compared, as they may stand for the kind of the request.
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
        """The levels of the writes that these requests are, one after the other; those that are allowed if there is
        more than one way to read them. None if they are not the same as writes."""
        ways = list(self._ways(sent, MAX_WRITES))
        return next((way for way in ways if set(way) <= set(allowed)), ways[0] if ways else None)

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
        """No write of another level looks so."""
        same = constant(requests)
        self._bits = [(0xFF, same[place]) if place in same else _bits([request[place] for request in alike])
                      for place in range(self.length)]  # fmt: skip

    def fits(self, request: bytes) -> bool:
        return len(request) == self.length and all(
            byte & mask == value for byte, (mask, value) in zip(request, self._bits, strict=True)
        )


def _bits(values: Sequence[int]) -> tuple[int, int]:
    """The mask of the bits that are the same in all values, and these bits."""
    changed = 0
    for value in values:
        changed |= value ^ values[0]
    return ~changed & 0xFF, values[0] & ~changed

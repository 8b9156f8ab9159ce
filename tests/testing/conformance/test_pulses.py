"""Requests of a driver are told from those of its writes whatever else they carry."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from itertools import count

import pytest

from umo.testing.conformance.pulses import Writes, _order

LEVELS = [0, 1365, 5, 4095, 2047]
Make = Callable[[int, int, int], bytes]
"""Number of the request, command, level."""


def checked(data: bytes) -> bytes:
    return data + zlib.crc32(data).to_bytes(4, "big")


PROTOCOLS: dict[str, Make] = {
    "a number and a checksum": lambda n, command, raw: checked(struct.pack(">HBBH", n, command, 2, raw)),
    "number and command in one byte": lambda n, command, raw: struct.pack(">BH", n % 16 << 4 | command, raw),
    "command and number in one byte": lambda n, command, raw: checked(struct.pack(">BH", command << 4 | n % 16, raw)),
    "neither": lambda n, command, raw: struct.pack(">BBH", command, 2, raw),
    "lines of text": lambda n, command, raw: b"%d:OUT%d %d\n" % (n + 100, command, raw),
    "text without an end": lambda n, command, raw: b"C%dV%d" % (command, raw),
}  # fmt: skip
WRITE, ENABLE = 2, 3


class Sender:
    def __init__(self, make: Make, first: int) -> None:
        self._make, self._numbers = make, count(first)

    def writes(self) -> Iterator[tuple[int, bytes]]:
        for raw in _order(LEVELS):
            yield raw, self.send(WRITE, raw)

    def send(self, command: int, raw: int) -> bytes:
        return self._make(next(self._numbers), command, raw)


@pytest.mark.parametrize("first", [1, 14, 120, 250, 505])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_request_is_that_of_a_write_of_its_level_only(protocol: str, first: int) -> None:
    sender = Sender(PROTOCOLS[protocol], first)
    samples = list(sender.writes())
    once = sender.send(WRITE, 5)
    pulse = sender.send(WRITE, 4095) + sender.send(WRITE, 5)
    enabled = sender.send(ENABLE, 4095) + sender.send(WRITE, 5)
    unknown = sender.send(WRITE, 77) + sender.send(WRITE, 5)
    writes = Writes([*samples, *sender.writes()])
    assert writes.levels(once, (5,)) == [5]
    assert writes.levels(pulse, (5,)) == [4095, 5]
    assert writes.levels(b"", (5,)) == []
    assert writes.levels(enabled, (5,)) is None
    assert writes.levels(unknown, (5,)) is None


def test_requests_that_say_the_same_at_two_levels_tell_nothing() -> None:
    toggled = Writes([(raw, b"toggle") for raw in (0, 1) * 8])
    assert toggled.levels(b"toggle", (0,)) is None


def test_of_two_ways_to_read_requests_the_one_that_is_allowed_counts() -> None:
    prefixes = Writes([(raw, request) for raw, request in ((0, b"A"), (1, b"B"), (2, b"BA")) for _ in range(3)])
    assert prefixes.levels(b"BA", (0, 1)) == [1, 0]
    assert prefixes.levels(b"BA", (2,)) == [2]


def test_writes_whose_requests_depend_on_the_level_before_tell_nothing() -> None:
    before, samples = 0, []
    for raw in _order(LEVELS) * 2:
        samples.append((raw, (raw - before).to_bytes(2, "big", signed=True)))
        before = raw
    assert Writes(samples).levels((5).to_bytes(2, "big"), (0,)) is None

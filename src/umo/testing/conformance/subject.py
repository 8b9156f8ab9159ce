"""The subject of a test: a driver, the channels that may be used, and their connections."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import TYPE_CHECKING, Any

from umo.drivers.contract import Driver

if TYPE_CHECKING:
    from umo.testing.conformance.taps import Tap


FEW_LEVELS = 300
"""Largest number of levels in a range for which all levels are tried."""
BYTE_VALUES = 256
STRIDES = (1, 77, 151, 203, 99, 235, 173, 59)
"""Odd numbers, one for each byte of a level. `number * stride` runs through all values of a byte, in a different order
for each stride."""


@dataclass(frozen=True)
class Output:
    """A channel that the kit drives, only from `least` to `greatest` (raw integers, both included). After each rule the
    output is at its default."""

    channel: str
    default: int = 0
    least: int = 0
    greatest: int = 1

    def __post_init__(self) -> None:
        if not self.least <= self.default <= self.greatest:
            raise ValueError(f"{self.channel}: the default {self.default} is not in {self.least} to {self.greatest}")

    @property
    def inner(self) -> tuple[int, ...]:
        """The levels other than the default, without the two ends if there are further levels."""
        width = self.greatest - self.least
        between = {self.least + width // 3, self.least + width // 2, self.greatest - width // 5}
        free = sorted(between - {self.default, self.least, self.greatest})
        return tuple(free or {self.greatest, self.least} - {self.default}) or (self.default,)

    @cached_property
    def samples(self) -> tuple[int, ...]:
        """Levels to try: the default, both ends, 1 with both signs, powers of two and their neighbours, every value of
        every byte."""
        return _levels(self.least, self.greatest, self.default)

    @cached_property
    def _others(self) -> tuple[int, ...]:
        ends = {self.default, self.least, self.greatest}
        return tuple(dict.fromkeys((*self.inner, *(raw for raw in self.samples if raw not in ends))))

    def other(self, number: int = 0) -> int:
        """Return a level that is not the default. `number` chooses among the inner levels. Different numbers give
        different levels, if there are enough."""
        return self._others[number % len(self._others)]


@dataclass(frozen=True)
class Input:
    """A channel that the kit reads. `steady`: its reading stays the same while nothing drives it."""

    channel: str
    steady: bool = True


@dataclass(frozen=True)
class Subject:
    """A driver under test."""

    name: str
    make: Callable[[], Driver[Any]]
    """Function that returns a new driver with its options. The driver is not opened yet, and connects through `line`,
    if there is one."""
    outputs: tuple[Output, ...] = ()
    inputs: tuple[Input, ...] = ()
    loopbacks: tuple[tuple[str, str], ...] = ()
    """Pairs of channels: an output, and the input that reads its level."""
    timeout: float = 0.1
    """Timeout in s (`Driver.timeout`) of calls that must time out; the kit shortens it if the device answers much
    quicker. For all other calls it is at least 3 s."""
    settle: float = 1.0
    """Longest time in s that a level needs through a loop-back."""
    device: str = ""
    """Name of the device for the certificate. Default: the driver's `devices()`."""
    line: Tap | None = None
    """The TcpTap or PtyTap between driver and device that spoils answers."""
    direct: Callable[[], Driver[Any]] | None = None
    """Function that returns a new driver like `make`, but without the line. It is used to measure times, and for many
    cycles. Default: `make`."""
    gone: Callable[[], AbstractContextManager[object]] | None = None
    """Function that returns a context in which the device is away (`with gone():`). Default: the context of the
    line."""
    levels: Callable[[str], Sequence[int]] | None = None
    """Function that returns the levels that an output (given by its channel's text) had since the last call of this
    function, oldest first. The first level is that at the last call; the last is the present one. If the output has not
    moved, the list contains only its level; it is never empty. It is possible only for counterparts that record the
    levels."""
    refused: tuple[str, ...] = ()
    """Channels that the driver knows, and that the device refuses with an error."""
    checksum: bool = False
    """True if answers carry a checksum, so that any changed bit is noticed."""
    structured: bool = True
    """True if answers have a structure (a header, a terminator) by which garbage is noticed, False if any bytes are a
    valid answer. Answers that are hardly longer than the value itself count as answers without a structure."""
    sole_writer: bool = False
    """True if the driver states that no other client may write while it is open, because the driver keeps a copy of the
    data that its outputs share."""
    watchdog: float = 0.0
    """Time in s with which the watchdog of the device is armed (`HasWatchdog.watchdog`), or 0 if the watchdog is not
    armed."""
    period: float = 0.001
    """Period in s (`Driver.period`)."""
    agree: Callable[[str, int, str, int], bool] | None = None
    """Function that returns True if an output at this raw level and an input with this reading mean the same level of a
    loop-back. It is needed for loop-backs with another scale or with noise. Default: both raw values must be equal."""


def _levels(least: int, greatest: int, default: int) -> tuple[int, ...]:
    """Return levels of the range, none of them twice: the default, both ends, one level with both signs, and a shuffled
    mixture of others."""
    if greatest - least < FEW_LEVELS:
        mixed = list(range(least, greatest + 1))
    else:
        mixed = [*_powers(least, greatest), *_bytes(least, greatest)]
    Random(1998).shuffle(mixed)
    positive = min(greatest, -least) // 3
    mirrored = (positive, -positive) if positive > 0 else ()
    return tuple(dict.fromkeys((default, greatest, least, *mirrored, *mixed)))


def _powers(least: int, greatest: int) -> Iterator[int]:
    for bit in range(64):
        for sign in (1, -1):
            for beside in (-1, 0, 1):
                if least <= (raw := sign * (1 << bit) + beside) <= greatest:
                    yield raw


def _bytes(least: int, greatest: int) -> Iterator[int]:
    """Yield levels in which each byte has all its values in turn, as far as the range contains them."""
    bits = max(least.bit_length(), greatest.bit_length()) + (least < 0)
    size = -(-bits // 8)
    for number in range(BYTE_VALUES):
        word = bytes((number * STRIDES[i % len(STRIDES)] + 31 * i) % BYTE_VALUES for i in range(size))
        for kept in (bits, bits - 1):  # the lower bytes stay if the level does not fit
            raw = int.from_bytes(word, "little") & ((1 << kept) - 1)
            if least < 0 and raw >> (kept - 1):
                raw -= 1 << kept
            if least <= raw <= greatest:
                break
        else:
            raw = least + raw % (greatest - least + 1)
        yield raw

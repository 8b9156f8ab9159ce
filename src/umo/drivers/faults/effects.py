"""The kinds of injected faults, each with its effect on a transfer, in raw integers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite
from random import Random

from umo.drivers.contract import Channel

MARK = "(injected fault)"
LevelChange = Callable[[int, float, Random], int]
Shift = Callable[[int, float], int]
"""Function that adds an amount (in the object's units, or in raw steps) to a raw integer."""


@dataclass(eq=False, kw_only=True)
class Effect:
    """One fault on one channel, or on every call of a driver. It acts from `begin` until `end`, s of machine time.
    `change` returns the faulty raw integer for the right one, at a time in s after the fault began."""

    text: str
    channel: Channel | None = None
    """The channel that the fault concerns; None means the whole driver."""
    output: bool = False
    begin: float = 0.0
    end: float = inf
    takes: float = 0.0
    """Duration in s of every call that concerns the channel."""
    loss: str = ""
    """The reason why transfers of the channel fail; empty if they do not."""
    share: float = 1.0
    short: bool = False
    """True if a block transfer ends before the channel, so that this channel and the following ones are not read or
    written."""
    mistake: bool = False
    """True if the code of the driver raises an exception that is not an error of a device."""
    change: LevelChange = lambda raw, since, random: raw
    random: Random = field(default_factory=Random)

    def start(self, seed: int, again: int = 0) -> None:
        """Begin a run. The random numbers are the same for the same seed, regardless of other faults; `again`
        distinguishes faults with the same text on one channel."""
        words = f"{seed} {self.text} {self.channel.text if self.channel else ''} {self.output}"
        self.random.seed(f"{words} {again}" if again else words)

    def set_in(self, level: int | None) -> None:
        """Begin the fault. `level` is the raw integer that the output has; None for an input, and for an output that
        was never written."""

    def lost(self) -> str:
        """Return the reason why this transfer of the channel fails; empty if it does not fail."""
        return self.loss if self.loss and self.random.random() < self.share else ""

    def changed(self, raw: int, since: float) -> int:
        """Return the faulty raw integer for the right one, `since` s after the fault began."""
        return self.change(raw, since, self.random)


@dataclass(eq=False, kw_only=True)
class Stuck(Effect):
    """A fault in which a sensor reads, or an actuator stays at, the level at the beginning of the fault or a given
    level."""

    given: int | None = None

    def set_in(self, level: int | None) -> None:
        self._level = level if self.given is None else self.given

    def changed(self, raw: int, since: float) -> int:
        if self._level is None:
            self._level = raw
        return self._level


@dataclass(eq=False, kw_only=True)
class BitFlip(Effect):
    """A fault that inverts one bit, the same bit in every transfer. If the number of the bit is not given, the seed
    determines the bit."""

    bit: int | None = None

    def start(self, seed: int, again: int = 0) -> None:
        super().start(seed, again)
        assert self.channel is not None
        self._mask = 1 << (self.random.randrange(self.channel.bits) if self.bit is None else self.bit)

    def changed(self, raw: int, since: float) -> int:
        assert self.channel is not None
        width = 1 << self.channel.bits
        flipped = (raw % width) ^ self._mask
        return flipped - width if self.channel.signed and flipped > self.channel.highest else flipped


def limited(raw: float, channel: Channel) -> int:
    """Return the nearest level that the channel can have."""
    return int(min(max(round(raw) if isfinite(raw) else raw, channel.lowest), channel.highest))

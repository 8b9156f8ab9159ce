"""The kinds of injected faults: what each does to a transfer, in raw integers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite
from random import Random

from umo.drivers.contract import INT64, Channel

MARK = "(injected fault)"
Shift = Callable[[int, float], int]
"""The raw integer that is so much (in the object's units, or in raw steps) above another."""


@dataclass(eq=False, kw_only=True)
class Effect:
    """One fault on one channel, or on every call of a driver. It acts from `begin` until `end`, s of machine time."""

    text: str
    channel: Channel | None = None
    """None: the whole driver."""
    output: bool = False
    begin: float = 0.0
    end: float = inf
    random: Random = field(default_factory=Random)

    @property
    def short(self) -> bool:
        """Whether a block transfer ends before this channel."""
        return False

    def start(self, seed: int, again: int = 0) -> None:
        """A run begins. The numbers are the same for the same seed, whatever other faults there are; `again` tells
        faults of the same words on one channel apart."""
        words = f"{seed} {self.text} {self.channel.text if self.channel else ''} {self.output}"
        self.random.seed(f"{words} {again}" if again else words)

    def set_in(self, level: int | None) -> None:
        """The fault begins. `level` is the raw integer that the output has; None: an input, or never written."""

    @property
    def takes(self) -> float:
        """How long a call that concerns the channel takes, s."""
        return 0.0

    def call(self) -> None:
        """Before a call that concerns the channel: raise what the whole call ends in."""

    def lost(self) -> str:
        """Why this transfer of the channel fails; empty if it does not."""
        return ""

    def changed(self, raw: int, since: float) -> int:
        """The raw integer that another one becomes, `since` s after the fault began."""
        return raw


@dataclass(eq=False, kw_only=True)
class Stuck(Effect):
    """A sensor reads, an actuator has, the level that it had when the fault began, or a given one."""

    given: int | None = None

    def set_in(self, level: int | None) -> None:
        self._level = level if self.given is None else self.given

    def changed(self, raw: int, since: float) -> int:
        if self._level is None:
            self._level = raw
        return self._level


@dataclass(eq=False, kw_only=True)
class Noise(Effect):
    """Normally distributed, with this standard deviation."""

    deviation: float
    shift: Shift

    def changed(self, raw: int, since: float) -> int:
        return self.shift(raw, self.random.gauss(0.0, self.deviation))


@dataclass(eq=False, kw_only=True)
class Chatter(Effect):
    """The noise of a binary channel: a share of the transfers has the other level."""

    share: float

    def changed(self, raw: int, since: float) -> int:
        return raw ^ (self.random.random() < self.share)


@dataclass(eq=False, kw_only=True)
class Drift(Effect):
    """By so much in a second."""

    rate: float
    shift: Shift

    def changed(self, raw: int, since: float) -> int:
        return self.shift(raw, self.rate * since)


@dataclass(eq=False, kw_only=True)
class BitFlip(Effect):
    """One bit has the other level, the same one in every transfer. Without a number the seed decides which."""

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


@dataclass(eq=False, kw_only=True)
class OutOfRange(Effect):
    """A level beyond the range of the object."""

    level: int

    def changed(self, raw: int, since: float) -> int:
        return self.level


@dataclass(eq=False, kw_only=True)
class Delay(Effect):
    """Every call takes so long."""

    duration: float = inf

    @property
    def takes(self) -> float:
        return self.duration


@dataclass(eq=False, kw_only=True)
class DropOut(Effect):
    """A share of the transfers fails."""

    share: float

    def lost(self) -> str:
        return f"no answer {MARK}" if self.random.random() < self.share else ""


@dataclass(eq=False, kw_only=True)
class Disconnect(Effect):
    """Every transfer fails."""

    def lost(self) -> str:
        return f"disconnected {MARK}"


@dataclass(eq=False, kw_only=True)
class DriverMistake(Effect):
    """The code of the driver raises what is not an error of a device."""

    def call(self) -> None:
        raise RuntimeError(f"a mistake in the driver {MARK}")


@dataclass(eq=False, kw_only=True)
class WrongLength(Effect):
    """A block transfer ends before the channel: this one and those behind it are not read, or not written."""

    @property
    def short(self) -> bool:
        return True


def limited(raw: float, channel: Channel) -> int:
    """The nearest level that the channel can have."""
    lowest, highest = max(channel.lowest, INT64.min), min(channel.highest, INT64.max)
    return int(min(max(round(raw) if isfinite(raw) else raw, lowest), highest))

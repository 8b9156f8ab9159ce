"""The driver boundary: the paper's five code segments (section 4.5, Listing 4), in integers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from enum import Flag
from operator import index

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]


class Direction(Flag):
    """What a channel can do, seen from the computer."""

    INPUT = 1
    OUTPUT = 2
    BOTH = 3


@dataclass(frozen=True)
class Channel:
    """One channel of an interface circuit: its text, direction, width in bits and sign.

    A driver may derive its own frozen channel to keep an address beside them.
    """

    text: str
    direction: Direction
    bits: int
    signed: bool = False

    @property
    def places(self) -> tuple[Hashable, ...]:
        """What of the circuit the channel takes up; no two objects may share a place."""
        return (self.text,)

    @property
    def lowest(self) -> int:
        return -(1 << (self.bits - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        return (1 << (self.bits - 1 if self.signed else self.bits)) - 1


class Driver(ABC):
    """One interface circuit: a DAC card, a GPIO chip, a Modbus unit. Knows nothing of objects.

    The constructor takes the circuit's options (the keys of its `[drivers.NAME]` table) and touches no
    hardware. Required: `channel`, and `read` or `write` as its channels' directions need. A call that
    fails raises any OSError (`umo.DriverError` is one); it ends within `timeout` and does not retry.
    """

    timeout: float = 1.0
    """The longest that one call may take, in s; set from the wiring before `open` (default 10 periods)."""
    period: float = 0.0
    """The machine's sampling period in s, 0 without a timer; set from the wiring before `open`."""
    realtime: bool = False
    """Whether its timer channel, if it has one, keeps the pace of the wall clock."""

    # The paper's five segments -------------------------------------------------------------------

    @abstractmethod
    def channel(self, text: str) -> Channel:
        """The channel that the text names; ChannelError with the valid forms otherwise. Before `open` too."""

    def initialize(self, channel: Channel, default: int | None) -> None:
        """Prepare the channel. An output comes up at its default, with no other level in between;
        a sensor's default is None."""
        if default is not None:
            self.write(channel, default)

    def finalize(self, channel: Channel) -> None:  # noqa: B027  (nothing to do for most circuits)
        """Give the channel up; an output was reset before."""

    def reset(self, channel: Channel, default: int | None) -> None:
        """Actuators: write the default. Sensors (None): clear the circuit's faults, never a count."""
        if default is not None:
            self.write(channel, default)

    def read(self, channel: Channel) -> int:
        raise NotImplementedError(f"{type(self).__name__} has no inputs")

    def write(self, channel: Channel, raw: int) -> None:
        raise NotImplementedError(f"{type(self).__name__} has no outputs")

    # Derived: override what the circuit does better ------------------------------------------------

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        """Read all the channels into `out`, in place: the sensors of one period. One transfer on a bus."""
        for i, channel in enumerate(channels):
            out[i] = index(self.read(channel))  # numpy alone would truncate a float

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        """Write all the channels: the actuators of one period. `raws` is the caller's; copy, never keep."""
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            self.write(channel, raw)

    def open(self) -> None:  # noqa: B027
        """Reach for the circuit; before any other call but `channel`."""

    def close(self) -> None:  # noqa: B027
        """Let the circuit go; after the last call, also when `open` failed."""

    def watchdog(self, seconds: float) -> None:
        """Arm the circuit's own watchdog: without a request for so long it drops its outputs to safe levels."""
        raise NotImplementedError(f"{type(self).__name__} has no watchdog of its own")

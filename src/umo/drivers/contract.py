"""The driver boundary: the paper's five code segments (section 4.5, Listing 4), in integers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Flag
from operator import index
from typing import Any, Generic

import numpy as np
import numpy.typing as npt
from typing_extensions import TypeVar

from umo.errors import ChannelsFailed

IntArray = npt.NDArray[np.int64]


class Direction(Flag):
    """What a channel can do, seen from the computer."""

    INPUT = 1
    OUTPUT = 2
    BOTH = 3


@dataclass(frozen=True)
class Channel:
    """One channel of an interface circuit: its text, direction, width in bits and sign.

    A driver may derive its own frozen channel to keep an address beside them: its own fields then say where it is.
    """

    text: str
    direction: Direction
    bits: int
    signed: bool = False

    @property
    def places(self) -> tuple[Hashable, ...]:
        """What of the circuit the channel takes up; no two objects may share a place. Of a derived channel all of its
        own fields and its direction, so that two texts of one output are found; without any its text."""
        own = tuple(getattr(self, field.name) for field in fields(self)[len(fields(Channel)) :])
        return ((self.direction, own),) if own else (self.text,)

    @property
    def lowest(self) -> int:
        return -(1 << (self.bits - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        return (1 << (self.bits - 1 if self.signed else self.bits)) - 1


C = TypeVar("C", bound=Channel, default=Channel)


class Driver(ABC, Generic[C]):
    """One interface circuit: a DAC card, a GPIO chip, a Modbus unit. Knows nothing of objects.

    The constructor takes the circuit's options (the keys of its `[drivers.NAME]` table) and touches no
    hardware. Required: `channel`, and `read` or `write` as its channels' directions need. A call that
    fails raises any OSError (`umo.DriverError` is one), one that timed out a TimeoutError (`umo.DeviceTimeout`);
    it ends within `timeout` and does not retry. `Driver[MyChannel]` where channels are of an own class.
    """

    timeout: float = 1.0
    """The longest that one call may take, in s; set from the wiring before `open` (default 10 periods)."""
    period: float = 0.0
    """The machine's sampling period in s, 0 without a timer; set from the wiring before `open`."""
    realtime: bool = False
    """Whether its timer channel, if it has one, keeps the pace of the wall clock."""

    # The paper's five segments -------------------------------------------------------------------

    @abstractmethod
    def channel(self, text: str) -> C:
        """The channel that the text names; ChannelError with the valid forms otherwise. Before `open` too."""

    def initialize(self, channel: C, default: int | None) -> None:
        """Prepare the channel. An output comes up at its default, with no other level in between;
        a sensor's default is None."""
        if default is not None:
            self.write(channel, default)

    def finalize(self, channel: C) -> None:
        """Give the channel up; an output was reset before."""

    def reset(self, channel: C, default: int | None) -> None:
        """Actuators: write the default. Sensors (None): clear the circuit's faults, never a count."""
        if default is not None:
            self.write(channel, default)

    def read(self, channel: C) -> int:
        raise NotImplementedError(f"{type(self).__name__} has no inputs")

    def write(self, channel: C, raw: int) -> None:
        raise NotImplementedError(f"{type(self).__name__} has no outputs")

    # Derived: override what the circuit does better ------------------------------------------------

    def devices(self) -> Iterable[str]:
        """The hardware that it takes, such as "modbus tcp 192.168.0.7:502", in a form in which two spellings of one
        device are equal. One process holds a device at a time. None: a simulation in this process. Before `open`."""
        return ()

    def read_many(self, channels: Sequence[C], out: IntArray) -> None:
        """Read all the channels into `out`, in place: the sensors of one period. One transfer on a bus. ChannelsFailed
        where only some of them failed."""
        failed: dict[str, Exception] = {}
        for i, channel in enumerate(channels):
            try:
                out[i] = index(self.read(channel))  # numpy alone would truncate a float
            except TimeoutError:  # the device does not answer: the others would only wait as long
                raise
            except OSError as error:
                failed[channel.text] = error
        if failed:
            raise ChannelsFailed(failed)

    def write_many(self, channels: Sequence[C], raws: IntArray) -> None:
        """Write all the channels: the actuators of one period; ChannelsFailed where only some of them failed. `raws`
        is the caller's; copy, never keep."""
        failed: dict[str, Exception] = {}
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            try:
                self.write(channel, raw)
            except TimeoutError:
                raise
            except OSError as error:
                failed[channel.text] = error
        if failed:
            raise ChannelsFailed(failed)

    def open(self) -> None:
        """Reach for the circuit; before any other call but `channel` and `devices`."""

    def close(self) -> None:
        """Let the circuit go; after the last call, also when `open` failed."""

    def watchdog(self, seconds: float) -> None:
        """Arm the circuit's own watchdog: without a request for so long it drops its outputs to safe levels."""
        raise NotImplementedError(f"{type(self).__name__} has no watchdog of its own")

    def report(self) -> Mapping[str, Any]:
        """What the circuit, or a plant, has to say at the end of a run, before `close`: plain data by name."""
        return {}

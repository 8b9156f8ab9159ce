"""The driver boundary: the paper's five code segments (section 4.5, Listing 4), in integers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, fields
from enum import Flag
from functools import cache
from operator import index
from time import monotonic
from typing import Any, ClassVar, Generic, Self

import numpy as np
import numpy.typing as npt
from typing_extensions import TypeVar

from umo.drivers.optional import check_named
from umo.drivers.unreached import is_unreached
from umo.errors import ChannelsFailed, DriverError, text_of
from umo.text import cut_repr, in_brackets, is_own, shown_place, some
from umo.user_code import check_overrides, definition, incomplete

IntArray = npt.NDArray[np.int64]
INT64 = np.iinfo(np.int64)
"""The least and the greatest raw integer of a transfer."""
_LEAST, _GREATEST = int(INT64.min), int(INT64.max)
UNREAD = -0x7EAD_7EAD_7EAD_7EAD
"""The raw integer of an element of a buffer that the driver has not filled yet. Such an element counts as not read. A
channel of 64 bits loses a reading that has exactly this value, one of 2**64."""

MAX_DEFAULT_TIMEOUT = 1.0
"""The upper limit of a default timeout in s. A longer timeout must be given in the wiring. The timeouts of a period add
up, and a stop and the guardian wait for all of them."""

QUICK_SHARE = 0.01
"""A share of the timeout. If the single transfers of a block end within this time, their timeout is not shortened."""

LEAST_SHARE = 0.01
"""The least share of the timeout for a single transfer. A circuit that answers immediately, such as a simulated
circuit, then does not fail because the computer was busy. A slower circuit times out."""


class Direction(Flag):
    """Direction of a channel, seen from the computer."""

    INPUT = 1
    OUTPUT = 2
    BOTH = 3


_INPUT = Direction.INPUT


@dataclass(frozen=True)
class Channel:
    """One channel of an interface circuit: its text, direction, width in bits and sign.

    A driver may derive a frozen class with more fields, such as an address. These fields then identify the place in the
    circuit.
    """

    text: str
    direction: Direction
    bits: int
    signed: bool = False

    @property  # a field would make every channel larger, and slower a period of many
    def event(self) -> bool:
        """True if a write is an event, such as a pulse or a command, and not a level. An event that is sent twice can
        happen twice. Default: False."""
        return False

    @property
    def places(self) -> tuple[Hashable, ...]:
        """The places of the circuit that the channel uses. Two objects must not share a place. Default: the direction
        and the fields of the derived class, so that two texts for one output are detected; without such fields, the
        text. Drivers of one class share the places of a device. So for a device with several units the channel needs a
        field for the unit."""
        kind: Any = type(self)
        own = tuple(getattr(self, name) for name in _own_fields(kind))
        return ((self.direction, own),) if own else (self.text,)

    @property
    def rewrites(self) -> tuple[Hashable, ...]:
        """Further places that a write also sends, with the contents that this driver knows, such as the other bits of a
        register. No other driver may have an output there. Default: none."""
        return ()

    def __hash__(self) -> int:  # plans are looked up by their channels in every period, and a string keeps its hash
        return hash(self.text)

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if "__hash__" not in vars(cls):  # dataclass would make another one
            cls.__hash__ = Channel.__hash__  # type: ignore[method-assign]

    def check(self, raw: int) -> None:
        """Check a write. Raises DriverError if the channel is an input, or if the raw integer does not fit its bits."""
        if self.direction is _INPUT:
            raise DriverError(f"{self.text} is an input")
        self.fit(raw)

    def fit(self, raw: int) -> None:
        """Check a raw integer. Raises DriverError if it does not fit the bits of the channel."""
        lowest, highest = _limits(self.bits, self.signed)
        if not lowest <= raw <= highest:
            raise DriverError(f"{raw} does not fit {self.text}: it takes {lowest} to {highest}")

    @property  # a cached one would give each channel a dict of its own, and every driver slower attributes
    def limits(self) -> tuple[int, int]:
        """The least and the greatest raw integer that the channel's bits and an int64 can hold."""
        return _limits(self.bits, self.signed)

    @property
    def lowest(self) -> int:
        return self.limits[0]

    @property
    def highest(self) -> int:
        return self.limits[1]


@cache
def _limits(bits: int, signed: bool) -> tuple[int, int]:
    """Return the least and the greatest integer with this number of bits, within the limits of an int64."""
    if signed:
        return max(-(1 << (bits - 1)), _LEAST), min((1 << (bits - 1)) - 1, _GREATEST)
    return 0, min((1 << bits) - 1, _GREATEST)


@cache
def _own_fields(cls: Any) -> list[str]:
    """Return the names of the fields that a derived class adds."""
    return [field.name for field in fields(cls)[len(fields(Channel)) :]]


C = TypeVar("C", bound=Channel, default=Channel)


class Driver(ABC, Generic[C]):
    """One interface circuit: a DAC card, a GPIO chip, a Modbus unit. A driver transfers raw values only.

    The constructor takes the options of the circuit (the keys of its `[drivers.NAME]` table) and must not access
    hardware. Required: `channel`, `read` if there are inputs, `write` if there are outputs. Every call returns
    within `timeout` and does not retry. Errors: any OSError (such as DriverError) if a call fails, a
    TimeoutError (such as DeviceTimeout) if it timed out. A raw value beyond the channel's bits and a write to an input
    are such failures, and change nothing. Use `Driver[MyChannel]` for a derived channel class.
    """

    only_off_cycle: ClassVar[bool] = False
    """True if the driver's calls usually take longer than a period, so that the driver is refused on the cycle."""
    timeout: float = MAX_DEFAULT_TIMEOUT
    """The timeout of one call in s. It is set from the wiring before `open`. Default: 10 periods, at most 1 s. The
    timeout is longer while objects are initialised and reset."""
    period: float = 0.0
    """The sampling period of the machine in s; 0 without a timer. It is set from the wiring before `open`."""
    forms: Sequence[str] = ()
    """The forms of the driver's channels, such as "line:N". `umo device drivers` shows them if the driver cannot be
    made without options."""
    realtime: bool = False
    """True if the driver has a timer channel that runs in real time. Default: False."""
    simulates_time: bool = False
    """True if time passes in the driver only when its timer channel is read, as in a plant. Then this channel must be
    the machine's timer."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Check the class. Raises DeclarationError if one of these functions is an `async def`, or if a function of
        `optional.py` is defined without its class."""
        super().__init_subclass__(**keywords)
        check_overrides(cls)
        check_named(cls)

    def __new__(cls, *options: object, **named: object) -> Self:
        """Make a driver. Raises DeclarationError for a class that lacks a function of its bases."""
        if lacking := cls.__abstractmethods__:
            raise incomplete(cls, lacking)
        return super().__new__(cls)

    # The paper's five segments -------------------------------------------------------------------

    @abstractmethod
    def channel(self, text: str) -> C:
        """Return the channel with this text. Raises ChannelError, with the valid forms, for an unknown text. May be
        called before `open`."""

    def initialize(self, channel: C, default: int | None) -> None:
        """Prepare the channel. An output must go directly to its default, without another level in between.
        `default` is a raw value; None for a sensor."""
        if default is not None:
            self.write(channel, default)

    def finalize(self, channel: C) -> None:
        """Release the channel. An output has already been reset."""

    def reset(self, channel: C, default: int | None) -> None:
        """Actuators: write the default, a raw value. Sensors (None): clear faults of the circuit, not a counter."""
        if default is not None:
            self.write(channel, default)

    def read(self, channel: C) -> int:
        raise NotImplementedError(f"{type(self).__name__} has no inputs")

    def write(self, channel: C, raw: int) -> None:
        raise NotImplementedError(f"{type(self).__name__} has no outputs")

    # Derived: override what the circuit does better ------------------------------------------------

    def devices(self) -> Iterable[str]:
        """Return the hardware that the driver uses, such as "modbus tcp 192.168.0.7:502". The text must be the same for
        every spelling of one device, because one process holds a device at a time. Empty for a simulation. Called
        before `open`."""
        return ()

    def read_many(self, channels: Sequence[C], out: IntArray) -> None:
        """Read all channels into `out`, in place: the sensors of one period, if possible in one bus transfer.
        `channels` is a tuple without repetitions. For the whole machine it is the same object in every period, so a
        driver may keep a plan for it. Raises ChannelsFailed if only some channels failed. An element of `out` that is
        not filled counts as failed. By default each channel is read separately, within the remaining part of the
        timeout."""

        def read(i: int, channel: C) -> None:
            raw = self.read(channel)
            try:
                out[i] = index(raw)  # numpy alone would truncate a float
            except TypeError:
                raise not_whole(self, channel, raw) from None

        _one_by_one(self, channels, read)

    def write_many(self, channels: Sequence[C], raws: IntArray) -> None:
        """Write all channels: the actuators of one period. Raises ChannelsFailed if only some channels failed. `raws`
        belongs to the caller: copy the array, do not keep it. By default each channel is written separately, as in
        `read_many`."""
        levels = raws.tolist()
        if len(levels) != len(channels):
            raise ValueError(f"{len(levels)} raw values for {len(channels)} channels")
        _one_by_one(self, channels, lambda i, channel: self.write(channel, levels[i]))

    def open(self) -> None:
        """Open the circuit. Only `channel` and `devices` are called before `open`."""

    def close(self) -> None:
        """Close the circuit. This is the last call; it is also made if `open` failed."""


def not_whole(driver: Driver[Any], channel: Channel, reading: object) -> DriverError:
    """Return the error to raise for a reading that is not a whole number, with the place of the driver's `read`."""
    place = definition(type(driver).read)
    where = "" if place is None or is_own(place.file) else in_brackets(shown_place(place._replace(function="read")))
    given = f"{cut_repr(reading)} ({type(reading).__name__})"
    return DriverError(f"the reading of channel {channel.text} is {given}: a whole number is needed{where}")


def _one_by_one(driver: Driver[C], channels: Sequence[C], transfer: Callable[[int, C], None]) -> None:
    """Transfer a block channel by channel within the block's timeout. Each transfer gets the remaining time, but at
    least `LEAST_SHARE` of the timeout. Raises ChannelsFailed with the channels that failed without a timeout, or a
    plain DriverError if no channel has reached the device (`is_unreached`)."""
    unreached = 0
    failed: dict[str, str] = {}  # texts: a frame that keeps its own errors is never freed
    timeout, began = driver.timeout, monotonic()
    quick = began + QUICK_SHARE * timeout
    try:
        for i, channel in enumerate(channels):
            if (now := monotonic()) > quick:
                driver.timeout = max(began + timeout - now, LEAST_SHARE * timeout)
            try:
                transfer(i, channel)
            except TimeoutError:  # the device does not answer: the others would only wait as long
                raise
            except OSError as error:
                failed[channel.text] = text_of(error)
                unreached += is_unreached(error)
    finally:
        driver.timeout = timeout
    if not failed:
        return
    if unreached == len(channels):
        raise DriverError(some(list(dict.fromkeys(failed.values()))))
    raise ChannelsFailed(failed)

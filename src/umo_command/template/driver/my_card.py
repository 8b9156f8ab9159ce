"""The driver `my_card`, made by `umo new driver`.

Change CHANNELS, the options, and the class Device, which simulates the device.

    [drivers.my_card]
    type = ".my_card:MyCard"    # without the dot if this is not in a station's folder
    address = 1
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import ClassVar

from umo.drivers import (
    Channel,
    ChannelError,
    DeviceTimeout,
    Direction,
    Driver,
    DriverError,
    WiringError,
)

CHANNELS = {
    "dac:0": Channel("dac:0", Direction.OUTPUT, bits=12),
    "relay:0": Channel("relay:0", Direction.OUTPUT, bits=1),
    "adc:0": Channel("adc:0", Direction.INPUT, bits=12),
    "switch:0": Channel("switch:0", Direction.INPUT, bits=1),
}


class MyCard(Driver):
    """What the device is, in one line.

    Options:
        address: address of the device on its bus, 0 to 127.
    """

    def __init__(self, *, address: int = 1) -> None:
        if not 0 <= address <= 127:
            raise WiringError(f"address must be from 0 to 127, not {address}")
        self.address = address  # the device is not accessed before `open`
        self._device: Device | None = None
        self._is_open = False

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def devices(self) -> Sequence[str]:
        """Return one text per device, the same for all spellings: only one run at a time uses a device."""
        return [f"my_card {self.address}"]

    def open(self) -> None:
        self._is_open = True
        with self._connection():  # an error if the device is missing
            pass

    def close(self) -> None:
        self._is_open = False
        self._drop()

    def read(self, channel: Channel) -> int:
        if Direction.INPUT not in channel.direction:
            raise DriverError(f"{channel.text} is an output")
        with self._connection() as device:
            return device.get(channel.text)

    def write(self, channel: Channel, raw: int) -> None:
        channel.check(raw)
        with self._connection() as device:
            device.set(channel.text, raw)

    # If the device transfers many channels in one message, override read_many and
    # write_many, too. If a request can be sent without waiting for its answer, override
    # look. Without look, umo tries a device that does not answer again and again.

    @contextmanager
    def _connection(self) -> Iterator[Device]:
        """Return a context with the device for one call, which has one deadline.

        After a failure the connection is closed, and the next call makes a new one:
        a late answer must not be taken for the answer to a later request.
        """
        if not self._is_open:
            raise DriverError("it is not open")
        deadline = monotonic() + self.timeout
        try:
            if self._device is None:
                self._device = Device(self.address, deadline)
            self._device.deadline = deadline
            yield self._device
        except OSError:
            self._drop()
            raise

    def _drop(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            device.close()


class Device:
    """A connection to the device. This one is in memory.

    adc:0 reads the level of dac:0, and switch:0 that of relay:0. Replace this class by
    calls of your device's library, or by a socket (docs/howto-write-a-driver.md). Each
    call must end before `deadline`, a time of `time.monotonic()`. A late answer raises
    DeviceTimeout. Every other failure, also an unexpected answer, raises an OSError,
    such as DriverError.
    """

    levels: ClassVar[dict[str, int]] = dict.fromkeys(CHANNELS, 0)
    """Levels of the device itself, which remain when the connection is closed."""
    silent: ClassVar[bool] = False
    """True if the device does not answer, for the tests."""
    wires: ClassVar[dict[str, str]] = {"dac:0": "adc:0", "relay:0": "switch:0"}

    def __init__(self, address: int, deadline: float) -> None:
        self.deadline = deadline
        self._exchange()

    def get(self, name: str) -> int:
        self._exchange()
        return self.levels[name]

    def set(self, name: str, raw: int) -> None:
        self._exchange()
        self.levels[name] = self.levels[self.wires[name]] = raw

    def close(self) -> None:
        """Close the connection. This is also called after a failure."""

    def _exchange(self) -> None:
        if self.silent or monotonic() > self.deadline:
            raise DeviceTimeout("the device does not answer")

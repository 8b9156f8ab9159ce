"""Counters of Linux: encoder inputs and event counters of a chip, through the counter subsystem's files in sysfs."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from umo.drivers._device_file import explained, listed, numbered, one_named, put, text_in
from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.option_checks import truth, within
from umo.drivers.unreached import reaching
from umo.errors import ChannelError, DriverError, WiringError
from umo.text import did_you_mean

DEVICES = Path("/sys/bus/counter/devices")
FORMS = ("count:N", "preset:N", "ceiling:N", "floor:N", "enable:N", "direction:N (N the number of the count, from 0)")
_TEXT = re.compile(r"(count|preset|ceiling|floor|enable|direction):(0|[1-9][0-9]{0,3})")
_DIRECTIONS = {"forward": 0, "backward": 1}
_MAX_BITS = 63
"""Largest number of bits of an unsigned value: raw values are int64."""
_MAX_FILE_SIZE = 64
"""Largest number of bytes in a file."""


@dataclass(frozen=True)
class CounterChannel(Channel):
    """One file of one count."""

    count: int = 0
    attribute: str = ""

    @property
    def event(self) -> bool:
        """True, because writing a count again would lose the events counted in between."""
        return self.attribute == "count"


class Counter(Driver[CounterChannel]):
    """One counter device, with one or more counts.

    Channels, where N is the number of the count: `count:N`, its value, which can be written; `preset:N`, `ceiling:N`,
    `floor:N`; `enable:N`, 1 while it counts; `direction:N`, an input, 0 forward and 1 backward. The kernel driver of a
    device determines which of these channels the device has.

    Options:
        device: "counter0", its name (the file `name`), or a path.
        bits: width of the counter, 1 to 63, or 64 if signed.
        signed: count and preset are two's complement of this width: a 16-bit counter at 65535 is -1.
        function: how signals are counted, such as "quadrature x4"; default: not changed.

    Initialising a count enables it, unless the wiring has its `enable` channel. Resetting a sensor does not change a
    count. A count continues when the driver is closed. Each channel is one system call. Source:
    Documentation/ABI/testing/sysfs-bus-counter of the Linux kernel.
    """

    def __init__(
        self, *, device: str = "counter0", bits: int = 32, signed: bool = False, function: str | None = None
    ) -> None:
        if not isinstance(device, str) or not device:
            raise WiringError(f"device must be the name or path of a counter, not {device!r}")
        truth("signed", signed)
        within("bits", bits, 1, _MAX_BITS + signed)
        self.device, self._bits, self._signed, self._function = device, bits, signed, function
        self._wired_enables: set[int] = set()
        self._used: dict[CounterChannel, int | None] = {}
        """The initialised channels, with the default of each output."""
        self._files: dict[CounterChannel, int] = {}
        self._folder: Path | None = None
        self._is_open = False

    def channel(self, text: str) -> CounterChannel:
        match = _TEXT.fullmatch(text)
        if match is None:
            raise ChannelError(text, FORMS)
        attribute, count = match[1], int(match[2])
        if attribute == "enable":
            self._wired_enables.add(count)
        one_bit = attribute in ("enable", "direction")
        direction = Direction.INPUT if attribute == "direction" else Direction.BOTH
        signed = self._signed and attribute in ("count", "preset")
        bits = 1 if one_bit else self._bits if signed else min(self._bits, _MAX_BITS)
        return CounterChannel(text, direction, bits, signed, count, attribute)

    def devices(self) -> Sequence[str]:
        """Return the device by its number, regardless of how the option names it. If the device does not exist, return
        it as the option names it."""
        with suppress(OSError):
            return [f"counter {_found(self.device).name}"]
        return [f"counter {self.device}"]

    def open(self) -> None:
        self._is_open = True
        self._begin()

    def close(self) -> None:
        self._is_open = False
        self._used.clear()
        self._disconnect()

    def initialize(self, channel: CounterChannel, default: int | None) -> None:
        """Set the function of the count, write an output's default, and enable a count without a wired `enable`."""
        self._begin()
        self._initialize(channel, default)

    def finalize(self, channel: CounterChannel) -> None:
        self._used.pop(channel, None)
        if (file := self._files.pop(channel, None)) is not None:
            os.close(file)

    def read(self, channel: CounterChannel) -> int:
        self._begin()
        text = self._transfer(channel)
        if channel.attribute == "direction":
            if text not in _DIRECTIONS:
                raise DriverError(f"{self.device}: the direction of count {channel.count} is {text!r}")
            return _DIRECTIONS[text]
        return self._decoded(channel, text)

    def write(self, channel: CounterChannel, raw: int) -> None:
        channel.check(raw)
        self._begin()
        self._transfer(channel, str(raw & (1 << channel.bits) - 1))

    # The device ----------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Find the device again if it had gone, and initialise it again. Raises DriverError if it is not open."""
        if not self._is_open:
            raise DriverError("it is not open")
        if self._folder is None:
            with reaching():
                self._folder = _found(self.device)
            try:
                for channel, default in list(self._used.items()):
                    self._initialize(channel, default)
            except BaseException:
                self._disconnect()  # the next call tries it again
                raise

    def _disconnect(self) -> None:
        for file in self._files.values():
            os.close(file)
        self._files.clear()
        self._folder = None

    def _initialize(self, channel: CounterChannel, default: int | None) -> None:
        self._set_function(channel.count)
        self._transfer(channel)  # an error if the device does not have it
        if default is not None:
            self.write(channel, default)
        if channel.attribute == "count" and channel.count not in self._wired_enables:
            enable = self._count_folder(channel.count) / "enable"
            if text_in(enable) == "0":
                put(enable, "1")
        self._used[channel] = default

    def _set_function(self, count: int) -> None:
        if self._function is None:
            return
        folder = self._count_folder(count)
        available = text_in(folder / "function_available").splitlines()
        if self._function not in available:
            known = f"; it has: {', '.join(available)}" if available else ""
            raise DriverError(
                f"{folder} has no function {self._function!r}{did_you_mean(self._function, available)}{known}"
            )
        if text_in(folder / "function") != self._function:
            put(folder / "function", self._function)

    def _transfer(self, channel: CounterChannel, text: str | None = None) -> str:
        """Write the channel's file, or read it."""
        file = self._files.get(channel)
        if file is None:
            file = self._files[channel] = self._opened(channel)
        try:
            if text is None:
                return os.pread(file, _MAX_FILE_SIZE, 0).decode("ascii", "replace").strip()
            os.pwrite(file, text.encode(), 0)
        except OSError as error:
            raise self._failed(channel, text, error) from error
        return ""

    def _failed(self, channel: CounterChannel, text: str | None, error: OSError) -> DriverError:
        if error.errno == errno.ENODEV:
            self._disconnect()  # the next call looks for it again
            return DriverError(f"{self.device}: the counter has gone")
        if error.errno == errno.EBADF:  # written, but open for reading only
            path = self._count_folder(channel.count) / channel.attribute
            return DriverError(explained(str(path), PermissionError(errno.EACCES, "")))
        if text is not None and error.errno in (errno.EINVAL, errno.ERANGE):
            return DriverError(f"{self.device}: {channel.text}: the device does not take {text}")
        return DriverError(f"{self.device}: {channel.text}: {error.strerror}")

    def _opened(self, channel: CounterChannel) -> int:
        path = self._count_folder(channel.count) / channel.attribute
        if not path.exists():
            others = [form.partition(":")[0] for form in FORMS if (path.parent / form.partition(":")[0]).exists()]
            raise DriverError(f"{path.parent} has no {channel.attribute}; it has: {', '.join(others)}")
        for mode in (os.O_RDWR, os.O_RDONLY):  # one that can only be read is an input
            try:
                return os.open(path, mode)
            except OSError as error:
                if mode == os.O_RDONLY or error.errno != errno.EACCES:
                    raise DriverError(explained(str(path), error)) from error
        raise AssertionError

    def _count_folder(self, count: int) -> Path:
        assert self._folder is not None
        folder = self._folder / f"count{count}"
        if not folder.is_dir():
            known = sorted(path.name for path in self._folder.glob("count[0-9]*"))
            raise DriverError(f"{self._folder.name} has no count {count}; it has: {', '.join(known)}")
        return folder

    def _decoded(self, channel: CounterChannel, text: str) -> int:
        if not text.isdecimal():
            raise DriverError(f"{self.device}: {channel.text} holds {text!r}, not a number")
        value = int(text)
        if channel.signed and value > channel.highest:
            width = channel.bits if value < 1 << channel.bits else 64  # some drivers extend the sign to 64 bits
            value -= 1 << width
        if not channel.lowest <= value <= channel.highest:
            raise DriverError(f"{self.device}: {channel.text} is {text}, more than {channel.bits} bits (option bits)")
        return value


def _found(device: str) -> Path:
    """Return the folder of the counter with this number, name or path."""
    there = {folder.name: [text_in(folder / "name")] for folder in numbered(DEVICES, "counter")}
    if "/" not in device:
        return DEVICES / one_named("counter", device, there)
    folder = Path(os.path.realpath(device))
    if not (folder / "num_counts").is_file():
        raise DriverError(f"{device} is not a counter; {listed('counter', there)}")
    return DEVICES / folder.name if folder.name in there else folder

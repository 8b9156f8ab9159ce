"""Linux Industrial I/O: the kernel's ADCs, DACs, accelerometers, temperature, pressure and light sensors."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from time import monotonic

from umo.drivers._block_driver import BlockDriver, in_turn
from umo.drivers._device_file import explained, text_in
from umo.drivers.contract import Channel, Direction, IntArray
from umo.drivers.iio import sysfs
from umo.drivers.iio.scan import Scan, element, trigger_named
from umo.drivers.optional import KnowsScale, PhysicalScale
from umo.duration import duration
from umo.errors import ChannelError, DeviceTimeout, DriverError, WiringError

FORMS = (
    "in_TYPE[N]",
    "in_TYPE[N]-TYPE[M]",
    "in_TYPE[N]_x",
    "out_TYPE[N] (names of the kernel, without _raw)",
    "in_TYPE[N]_input[:SCALE] (a processed value; default of SCALE: 1)",
)
_NAME = re.compile(r"(in|out)_[a-z][a-z0-9_]*(-[a-z][a-z0-9_]*)?")
_PROCESSED = "_input"
"""End of the names of values that the kernel has processed already."""
_SCALE = re.compile(r"[0-9]{1,13}(?:\.[0-9]{1,13})?(?:e-?[0-9]{1,2})?")
_GONE = (errno.ENODEV, errno.ENOENT, errno.EBADF)
_MAX_FILE_SIZE = 64
"""Largest number of bytes in a file of a raw value."""


@dataclass(frozen=True)
class IioChannel(Channel):
    """A channel of the device. Its place is the name in the kernel, in both directions. `scale`: for a processed value,
    the value of one raw integer; None if the kernel gives raw integers."""

    name: str = ""
    scale: Decimal | None = None

    @property
    def places(self) -> tuple[str]:
        return (self.name,)

    def raw(self, text: str) -> int:
        """Return the raw integer in a file of the kernel. Raises DriverError if the file contains none."""
        if self.scale is None:
            return _integer(text)
        try:
            raw = round(Decimal(text.strip()) / self.scale)  # half to even
        except (ArithmeticError, ValueError):
            raise DriverError(f"its value is {text.strip()!r}, not a number") from None
        self.fit(raw)
        return raw


class Iio(BlockDriver[IioChannel], KnowsScale):
    """One device of Linux Industrial I/O.

    Channels have the kernel's names without `_raw`: `in_voltage0`, `in_voltage1-voltage2`, `in_accel_x` (inputs),
    `out_voltage0` (both directions). Values are the integers of the kernel's `_raw` files. The kernel's unit is (raw +
    offset) * scale: if the object has units of the same dimension, the wired resolution and zero_offset must agree with
    this (`physical_scale`), provided that the device is present when the wiring is checked. If the kernel's driver for
    a chip gives processed values only, `in_temp_input` is the value in the kernel's unit, and `in_pressure_input:0.001`
    the value divided by this scale, to the nearest integer.

    Options:
        device: name ("ads1015"), label, or number ("iio:device0").
        trigger: name of a trigger, such as an hrtimer. All input channels of a period then come from one record that
            was taken at one instant. Default: each channel is read separately.
        sampling_frequency: the frequency in Hz of the trigger, or of the device if the trigger has none; only with a
            trigger. Default: the frequency is not changed.
        conditioned: channels with a divider, an amplifier or a transducer between the object and the converter: the
            kernel's scale is not that of the object, so the two are not compared.

    With a trigger a period takes the newest record. A record older than `timeout` is not taken: if the trigger does not
    fire within this time, the call raises DeviceTimeout. Without a trigger, a read takes as long as the kernel's driver
    needs for a conversion; that cannot be interrupted, and the timeout is observed between two channels.

    Source: the kernel's Documentation/ABI/testing/sysfs-bus-iio.
    """

    forms = FORMS

    def __init__(
        self,
        *,
        device: str,
        trigger: str | None = None,
        sampling_frequency: float | None = None,
        conditioned: Sequence[str] = (),
    ) -> None:
        if not isinstance(device, str) or not device:
            raise WiringError(f'device must be a name, a label or a number such as "iio:device0", not {device!r}')
        if sampling_frequency is not None:
            if not isinstance(sampling_frequency, int | float) or not 0 < sampling_frequency < 1e9:
                raise WiringError(f"sampling_frequency must be in Hz and above 0, not {sampling_frequency!r}")
            if trigger is None:
                raise WiringError("sampling_frequency is the rate of scans, which need the option trigger")
        for name in conditioned:
            if not _NAME.fullmatch(name):
                raise WiringError(f"conditioned lists channels such as 'in_voltage0', not {name!r}")
        self.device, self.trigger, self._frequency = device, trigger, sampling_frequency
        self._conditioned = frozenset(conditioned)
        self._opened = False
        self._folder: Path | None = None
        self._files: dict[tuple[str, int], int] = {}
        """Open files of raw values, for reading and for writing."""
        self._scan: Scan | None = None
        self._inputs: set[str] = set()
        """The input channels in use, which are those of a scan."""

    # Before open ---------------------------------------------------------------------------------------

    def channel(self, text: str) -> IioChannel:
        """Return the channel with this text. If the device is present, the channel must be one of its channels."""
        name, colon, given = text.partition(":")
        match = _NAME.fullmatch(name)
        folder = self._there()
        known = FORMS if folder is None else sysfs.channels(folder)
        processed = name.startswith("in_") and name.endswith(_PROCESSED)
        scale = Decimal(given or "1") if processed and _SCALE.fullmatch(given or "1") else None
        wrong = bool(colon) != bool(given) or not scale if processed else bool(colon)
        if match is None or wrong or (folder is not None and name not in known):
            raise ChannelError(text, known)
        direction = Direction.INPUT if match[1] == "in" else Direction.BOTH
        bits, signed = 32, True  # the raw value of a file is an int of C
        if folder is not None and self.trigger is not None and direction is Direction.INPUT:
            try:
                kind = element(folder, name)[2]
            except DriverError as error:
                raise WiringError(str(error)) from None
            bits, signed = kind.bits, kind.signed
        return IioChannel(text, direction, bits, signed, name, scale)

    def devices(self) -> Iterable[str]:
        """Return the device by its number, or by the given name if the device is not present."""
        folder = self._there()
        return [f"iio {self.device if folder is None else folder.name}"]

    def physical_scale(self, channel: IioChannel) -> PhysicalScale | None:
        folder = self._there()
        if folder is None or channel.name in self._conditioned:
            return None
        if channel.scale is not None:
            return sysfs.processed_scale(channel.name, float(channel.scale))
        return sysfs.scale_of(folder, channel.name)

    def _there(self) -> Path | None:
        with suppress(DriverError):
            return sysfs.find(self.device)
        return None

    # The device ----------------------------------------------------------------------------------------

    def open(self) -> None:
        """Find the device and its trigger. A scan starts with the first read."""
        self._opened = True
        self._begin()
        if self.trigger is not None:
            trigger_named(self.trigger)

    def close(self) -> None:
        self._opened = False
        self._drop()

    def initialize(self, channel: IioChannel, default: int | None) -> None:
        if default is None:
            self._inputs.add(channel.name)
        super().initialize(channel, default)

    def read_many(self, channels: Sequence[IioChannel], out: IntArray) -> None:
        deadline = self._begin()
        names = {channel.name for channel in channels if channel.direction is Direction.INPUT}
        scanned = self._scanned(names, deadline) if names and self.trigger else {}

        def read(i: int) -> None:
            name = channels[i].name
            out[i] = scanned[name] if name in scanned else channels[i].raw(self._transfer(name))

        self._in_turn(channels, read, deadline)

    def _write(self, channels: Sequence[IioChannel], raws: list[int]) -> None:
        for channel, raw in zip(channels, raws, strict=True):  # before the first is sent
            channel.check(raw)
        deadline = self._begin()
        self._in_turn(channels, lambda i: self._transfer(channels[i].name, str(raws[i])), deadline)

    # How -----------------------------------------------------------------------------------------------

    def _begin(self) -> float:
        """Begin a call, and return its deadline. If the device was lost, it is searched for again."""
        if not self._opened:
            raise DriverError("it is not open")
        if self._folder is None:
            self._folder = sysfs.find(self.device)
        return monotonic() + self.timeout

    def _drop(self) -> None:
        for fd in self._files.values():
            os.close(fd)
        self._files.clear()
        if self._scan is not None:
            self._scan.close()
        self._scan = self._folder = None

    def _in_turn(self, channels: Sequence[IioChannel], transfer: Callable[[int], object], deadline: float) -> None:
        """Transfer the channels by their numbers, until the deadline."""

        def carry_out(i: int) -> None:
            if i and monotonic() > deadline:
                raise DeviceTimeout(f"{i} of {len(channels)} channels took longer than {duration(self.timeout)}")
            transfer(i)

        in_turn(range(len(channels)), carry_out, lambda i: [channels[i].text])

    def _scanned(self, names: set[str], deadline: float) -> dict[str, int]:
        """Return the newest scan. It contains every input that was initialised or is requested now."""
        assert self._folder is not None and self.trigger is not None
        self._inputs |= names
        try:
            if self._scan is None or not names <= self._scan.channels:
                scan, self._scan = self._scan, None
                if scan is not None:
                    scan.close()
                self._scan = Scan(self._folder, self.trigger, self._frequency, self._inputs)
            return self._scan.newest(self.timeout, deadline)
        except OSError as error:
            self._drop()
            if isinstance(error, DriverError):
                raise
            raise DriverError(f"the scan of {self.device} failed: {error.strerror or error}") from error

    def _transfer(self, name: str, value: str | None = None) -> str:
        """Write a raw value, or read one."""
        file = name if name.startswith("in_") and name.endswith(_PROCESSED) else f"{name}_raw"
        if self._folder is None:  # lost with the channel before
            raise DriverError(f"the device {self.device} is gone")
        way = os.O_RDONLY if value is None else os.O_WRONLY
        try:
            fd = self._files.get((name, way))
            if fd is None:
                fd = self._files[name, way] = os.open(self._folder / file, way | os.O_CLOEXEC)
            if value is None:
                return os.pread(fd, _MAX_FILE_SIZE, 0).decode("ascii", "replace")
            os.pwrite(fd, value.encode(), 0)
            return ""
        except OSError as error:
            raise self._failed(value, str(self._folder / file), error) from error

    def _failed(self, value: str | None, file: str, error: OSError) -> DriverError:
        if error.errno == errno.ETIMEDOUT:
            return DeviceTimeout("the device did not answer its driver in the kernel")
        if error.errno == errno.EBUSY and self._folder is not None:
            enable = self._folder / "buffer" / "enable"
            on = f"; its buffer is on ({enable})" if text_in(enable) == "1" else ""
            return DriverError(f"{explained(sysfs.place(self._folder), error)}{on}")
        if error.errno == errno.ENOENT and self._folder is not None and self._folder.exists():
            return DriverError(f"{self.device} has no such channel: {', '.join(sysfs.channels(self._folder))}")
        if error.errno in _GONE:
            self._drop()
            return DriverError(f"the device {self.device} is gone")
        if error.errno in (errno.EINVAL, errno.ERANGE) and value is not None:
            return DriverError(f"the kernel refuses the raw value {value}")
        return DriverError(explained(file, error))


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise DriverError(f"its raw value is {text.strip()!r}, not an integer") from None

"""Scans of Linux Industrial I/O: with each trigger the kernel puts one record into a buffer. The record has the values
of all enabled channels at this instant. Source: the kernel's Documentation/iio/iio_devbuf.rst and
ABI/testing/sysfs-bus-iio.
"""

from __future__ import annotations

import os
import re
import select
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Literal, NamedTuple

from umo.drivers._device_file import numbered, one_named, opening, put, text_in
from umo.drivers.iio import sysfs
from umo.duration import duration
from umo.errors import DeviceTimeout, DriverError

BUFFER_LENGTH = 256
"""The number of records in the kernel's buffer, which must have room for the records of one period."""

_TYPE = re.compile(r"(be|le):([su])(\d+)/(\d+)(?:X(\d+))?>>(\d+)")


class ScanType(NamedTuple):
    """The form of a scan element in a record: `le:s12/16>>4` means 12 signed bits above 4 unused bits, in 16 bits."""

    order: Literal["little", "big"]
    signed: bool
    bits: int
    storage: int
    shift: int

    @classmethod
    def parse(cls, text: str) -> ScanType:
        """Parse the form. Raises DriverError if it is not one value of whole bytes."""
        match = _TYPE.fullmatch(text)
        if match is None or int(match[5] or 1) != 1:
            raise DriverError(f"umo reads scan elements of one integer, not of the type {text!r}")
        bits, storage, shift = int(match[3]), int(match[4]), int(match[6])
        if storage not in (8, 16, 24, 32, 64) or not 0 < bits <= storage - shift:
            raise DriverError(f"umo reads scan elements of one integer of 8 to 64 bits, not of the type {text!r}")
        return cls("big" if match[1] == "be" else "little", match[2] == "s", bits, storage, shift)

    def decode(self, data: bytes) -> int:
        raw = int.from_bytes(data, self.order) >> self.shift & (1 << self.bits) - 1
        sign = 1 << self.bits - 1 if self.signed else 0
        return (raw ^ sign) - sign


@dataclass(frozen=True)
class ScanLayout:
    """The record of some enabled channels: each element is at a multiple of its size; the elements are in the order of
    their indices."""

    places: dict[str, tuple[int, ScanType]]
    size: int

    @classmethod
    def of(cls, elements: Iterable[tuple[str, int, ScanType]]) -> ScanLayout:
        """Return the layout of elements, each as (channel, index, type)."""
        places, end, widest = {}, 0, 1
        for name, _, kind in sorted(elements, key=lambda element: element[1]):
            size = kind.storage // 8
            start = -(-end // size) * size
            places[name] = (start, kind)
            end, widest = start + size, max(widest, size)
        return cls(places, -(-end // widest) * widest)

    def decode(self, record: bytes) -> dict[str, int]:
        return {name: kind.decode(record[at : at + kind.storage // 8]) for name, (at, kind) in self.places.items()}


def element(folder: Path, channel: str) -> tuple[str, int, ScanType]:
    """Return a channel's place in a scan. Raises DriverError if the channel has none."""
    elements = folder / "scan_elements"
    kind = text_in(elements / f"{channel}_type")
    if not kind:
        there = sorted(file.name.removesuffix("_type") for file in elements.glob("in_*_type"))
        listed = f"those that have: {', '.join(there)}" if there else f"{folder.name} has no buffer"
        raise DriverError(f"{channel} cannot be scanned by a trigger; {listed}")
    return channel, int(text_in(elements / f"{channel}_index")), ScanType.parse(kind)


class Scan:
    """A running buffer of a device. The newest record is the scan: all its values were taken at one instant."""

    def __init__(self, folder: Path, trigger: str, frequency: float | None, channels: Iterable[str]) -> None:
        self.channels = frozenset(channels)
        self._folder = folder
        self._file = sysfs.place(folder)
        self._layout = ScanLayout.of(element(folder, channel) for channel in sorted(self.channels))
        self._values: dict[str, int] = {}
        self._taken_at = self._drained_at = monotonic()
        with opening(self._file):
            self._fd = os.open(self._file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            self._start(trigger, frequency)
        except BaseException:
            self.close()
            raise
        self._waiting = select.poll()
        self._waiting.register(self._fd, select.POLLIN)
        self._drained_at = monotonic()

    def _start(self, trigger: str, frequency: float | None) -> None:
        folder = self._folder
        put(folder / "buffer" / "enable", "0")  # left on by a process that was killed: the file is ours, nobody reads
        for file in sorted((folder / "scan_elements").glob("*_en")):
            if text_in(file) != "0":
                put(file, "0")
        for channel in sorted(self.channels):
            put(folder / "scan_elements" / f"{channel}_en", "1")
        if frequency is not None:
            files = [each / "sampling_frequency" for each in (trigger_named(trigger), folder)]
            put(next((file for file in files if file.exists()), files[0]), f"{frequency:.6f}".rstrip("0").rstrip("."))
        put(folder / "trigger" / "current_trigger", trigger)
        put(folder / "buffer" / "length", str(BUFFER_LENGTH))
        put(folder / "buffer" / "enable", "1")

    def close(self) -> None:
        for name, value in (("buffer/enable", "0"), ("trigger/current_trigger", "\n")):
            with suppress(OSError):
                put(self._folder / name, value)
        os.close(self._fd)

    def newest(self, oldest: float, deadline: float) -> dict[str, int]:
        """Return the values of the newest scan, no older than `oldest` s. Raises DeviceTimeout if there is none by the
        deadline."""
        full = self._drain()
        while full or not self._values or monotonic() - self._taken_at > oldest:
            left = deadline - monotonic()
            if left <= 0 or not self._waiting.poll(left * 1000):
                raise DeviceTimeout(f"the trigger has not fired within {duration(oldest)}")
            full = self._drain()
        return self._values

    def _drain(self) -> bool:
        """Take the last record of the buffer. Return True if the buffer was full: then this record is not the newest,
        because the kernel drops new records while the buffer is full."""
        size = self._layout.size
        before, self._drained_at = self._drained_at, monotonic()
        try:
            data = os.read(self._fd, size * BUFFER_LENGTH)
        except BlockingIOError:
            return False
        if not data or len(data) % size:
            raise DriverError(f"the buffer gave a record of {len(data) % size} bytes in place of {size}")
        self._values = self._layout.decode(data[-size:])
        self._taken_at = before  # at the earliest: it was not there at the drain before
        return len(data) == size * BUFFER_LENGTH


def trigger_named(name: str) -> Path:
    """Return the folder of the trigger. Raises DriverError, which names the existing triggers, if there is no such
    trigger."""
    folders = {text_in(folder / "name"): folder for folder in numbered(sysfs.SYSFS, "trigger")}
    try:
        return folders[one_named("trigger", name, dict.fromkeys(folders, ()))]
    except DriverError as error:
        how = f"to make a timer: mkdir /sys/kernel/config/iio/triggers/hrtimer/{name}"
        raise DriverError(f"{error}; {how}") from None

"""The lines of one GPIO chip, through libgpiod. This module is imported only if the Python binding of libgpiod is
installed.

The lines whose levels are transferred share requests, which are made once, when the chip is opened. Initialising a line
reconfigures it within its request, so other lines keep their levels. Each line whose edges are counted has a separate
request.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Sequence
from math import ceil
from time import monotonic, sleep

import gpiod
from gpiod.line import Value

from umo.drivers._device_file import opening
from umo.drivers.gpio.channel import GpioChannel
from umo.drivers.gpio.chip import named, path_of
from umo.drivers.gpio.request import Bank, EdgeCount, line_settings
from umo.errors import DriverError
from umo.text import did_you_mean

CONSUMER = "umo"
"""Name that other programs (gpioinfo) show for a line in use."""
MAX_REQUEST_LINES = 64
"""Largest number of lines of one request (GPIO_V2_LINES_MAX)."""
_RETRY_INTERVAL = 0.002
"""Time in s between two requests for a line that another process of umo holds."""
_ACTIVE = Value.ACTIVE  # a member of an enumeration takes longer to look up than to compare
_LEVELS = {0: Value.INACTIVE, 1: Value.ACTIVE}


class LineTransfer:
    """The transfer of some channels: the requests of their lines, and the place of each channel's levels."""

    def __init__(self, lines: Lines, channels: Sequence[GpioChannel]) -> None:
        self.channels = channels
        self._input = next((each.text for each in channels if lines.used[each] is None), "")
        places: dict[Bank, list[int]] = {}
        for offset in [offset for each in channels if not each.edges for offset in lines.offsets(each)]:
            places.setdefault(lines.banks[offset], []).append(offset)
        self._parts = list(places.items())
        index = {offset: i for i, offset in enumerate([offset for _, part in self._parts for offset in part])}
        self._counters = [lines.counters.get(each) for each in channels]
        self._bits = [() if each.edges else tuple(index[offset] for offset in lines.offsets(each)) for each in channels]
        self._plain = self._bits == [(i,) for i in range(len(channels))]
        """True if each channel is one line, and the channels are in the order of the requests."""

    def read(self) -> list[int]:
        levels = [1 if value is _ACTIVE else 0 for bank, part in self._parts for value in bank.request.get_values(part)]
        if self._plain:
            return levels
        return [
            sum([levels[bit] << i for i, bit in enumerate(bits)]) if counter is None else counter.read()
            for counter, bits in zip(self._counters, self._bits, strict=True)
        ]

    def write(self, raws: Sequence[int]) -> None:
        """Write all lines. All values are checked before the first line changes."""
        if self._input:
            raise DriverError(f"{self._input} is an input: it was initialised without a default")
        levels = iter(self._levels(raws))
        for bank, part in self._parts:
            bank.set(dict(zip(part, levels)))  # noqa: B905  (the part's, of all levels)

    def _levels(self, raws: Sequence[int]) -> list[Value]:
        """Return the levels of all lines, in the order of the requests."""
        if self._plain:
            try:
                return list(map(_LEVELS.__getitem__, raws))
            except KeyError:
                pass
        levels: dict[int, Value] = {}
        for channel, bits, raw in zip(self.channels, self._bits, raws, strict=True):
            channel.fit(raw)
            levels.update((bit, _LEVELS[raw >> i & 1]) for i, bit in enumerate(bits))
        return [levels[i] for i in range(len(levels))]


class Lines:
    """The lines of a chip that a driver holds."""

    def __init__(self, chip: str) -> None:
        self.name = self._wanted = chip
        self.used: dict[GpioChannel, int | None] = {}
        """The initialised channels, with the default of each output."""
        self.counters: dict[GpioChannel, EdgeCount] = {}
        self.banks: dict[int, Bank] = {}
        """The request of each line that is held for its level."""
        self._chip: gpiod.Chip | None = None
        self._numbers: dict[str, list[int]] = {}
        """The lines with each name."""

    @property
    def connected(self) -> bool:
        return self._chip is not None

    def connect(self, channels: Iterable[GpioChannel], deadline: float) -> None:
        """Open the chip, take the lines of these channels as they are, and initialise again any channels that were in
        use before."""
        self.name = path_of(self._wanted)  # it may have come back under another number
        with opening(self.name):
            self._chip = gpiod.Chip(self.name)
        self._numbers = named(self._chip)
        self._hold(channels)
        for channel, default in self.used.items():
            self.initialize(channel, default, deadline)

    def disconnect(self) -> None:
        for bank in dict.fromkeys(self.banks.values()):
            bank.request.release()
        self.banks.clear()
        for counter in self.counters.values():
            counter.release()
        if self._chip is not None:
            self._chip.close()
            self._chip = None

    def initialize(self, channel: GpioChannel, default: int | None, deadline: float) -> None:
        if default is not None and (channel.edges or not 0 <= default <= channel.highest):
            raise DriverError(f"{channel.text} cannot have the default {default}")
        offsets = self.offsets(channel)
        for other in self.used:
            if other != channel and (shared := set(offsets).intersection(self.offsets(other))):
                raise DriverError(f"{channel.text} and {other.text} are both {self._called(min(shared))}")
        if channel.edges:
            self._count(channel, offsets[0], deadline)
        else:
            levels = [None if default is None else _LEVELS[default >> i & 1] for i in range(len(offsets))]
            settings = {o: line_settings(channel.settings, level) for o, level in zip(offsets, levels, strict=True)}
            self._configure(settings, deadline)
        self.used[channel] = default

    def finalize(self, channel: GpioChannel) -> None:
        self.used.pop(channel, None)
        if (counter := self.counters.pop(channel, None)) is not None:
            counter.release()

    def plan(self, channels: Sequence[GpioChannel]) -> LineTransfer:
        for channel in channels:
            if channel not in self.used:
                raise DriverError(f"{channel.text} is not initialised")
        return LineTransfer(self, channels)

    def offsets(self, channel: GpioChannel) -> list[int]:
        """Return the numbers of the channel's lines."""
        found = [self._offset(line) for line in channel.lines]
        if len(set(found)) != len(found):
            raise DriverError(f"{channel.text} names a line twice")
        return found

    def _offset(self, line: int | str) -> int:
        assert self._chip is not None
        if isinstance(line, int):
            if line >= (count := self._chip.get_info().num_lines):
                raise DriverError(f"{self.name} has no line {line}: it has lines 0 to {count - 1}")
            return line
        offsets = self._numbers.get(line, [])
        if len(offsets) > 1:
            raise DriverError(
                f"{self.name}: lines {' and '.join(map(str, offsets))} are both named {line!r}: use a number"
            )
        if not offsets:
            others = did_you_mean(line, self._numbers) if self._numbers else "; its lines have no names"
            raise DriverError(f"{self.name} has no line named {line!r}{others}")
        return offsets[0]

    def _hold(self, channels: Iterable[GpioChannel]) -> None:
        """Hold the lines as they are, in as few requests as possible. A line that is now in use by another process is
        requested later, when it is initialised. So it does not keep the guardian from resetting the other lines."""
        assert self._chip is not None
        wanted: dict[int, None] = {}
        counted = set()
        for channel in channels:
            try:
                offsets = self.offsets(channel)
            except DriverError:
                continue
            if channel.edges:
                counted.update(offsets)
            else:
                wanted.update(dict.fromkeys(offsets))
        free = [each for each in wanted if each not in counted and not self._chip.get_line_info(each).used]
        size = ceil(len(free) / max(1, ceil(len(free) / MAX_REQUEST_LINES)))  # requests of equal size
        for start in range(0, len(free), max(1, size)):
            part = free[start : start + size]
            try:
                request = self._chip.request_lines({tuple(part): None}, CONSUMER)
            except OSError:
                continue
            self.banks.update(dict.fromkeys(part, Bank(request, {})))

    def _configure(self, settings: dict[int, gpiod.LineSettings], deadline: float) -> None:
        """Apply the settings. Lines that are not held yet are requested with their settings."""
        by_bank: dict[Bank, dict[int, gpiod.LineSettings]] = {}
        new = {}
        for offset, each in settings.items():
            if offset in self.banks:
                by_bank.setdefault(self.banks[offset], {})[offset] = each
            else:
                new[offset] = each
        for bank, part in by_bank.items():
            try:
                bank.configure(part)
            except OSError as error:
                raise self._refused(part, error) from error
        if new:
            self.banks.update(dict.fromkeys(new, Bank(self._request(new, deadline), new)))

    def _count(self, channel: GpioChannel, offset: int, deadline: float) -> None:
        if offset in self.banks:
            raise DriverError(f"{self._called(offset)} is held for its level: its edges cannot be counted")
        if (counter := self.counters.get(channel)) is None or counter.request is not None:
            self.finalize(channel)
            counter = EdgeCount()
        counter.attach(self._request({offset: line_settings(channel.settings, None, channel.edges)}, deadline))
        self.counters[channel] = counter

    def _request(self, settings: dict[int, gpiod.LineSettings], deadline: float) -> gpiod.LineRequest:
        """Request the lines. The kernel releases the lines of a killed process a moment after its end, so wait until
        the deadline for lines that another process of umo holds."""
        assert self._chip is not None
        while True:
            try:
                return self._chip.request_lines({(each,): s for each, s in settings.items()}, CONSUMER)
            except OSError as error:
                if error.errno != errno.EBUSY:
                    raise self._refused(settings, error) from error
                used = [info for offset in settings if (info := self._chip.get_line_info(offset)).used]
                others = [info for info in used if info.consumer != CONSUMER]
                if others or monotonic() > deadline:
                    busy = (others or used)[:1]
                    who = f'{self._called(busy[0].offset)} is in use by "{busy[0].consumer}"' if busy else "in use"
                    raise DriverError(f"{self.name}: {who}") from error
            sleep(_RETRY_INTERVAL)

    def _refused(self, settings: Iterable[int], error: OSError) -> DriverError:
        """Return why the chip does not accept a line with its settings. Raise ENODEV if the chip has been removed."""
        lines = ", ".join(map(self._called, settings))
        if error.errno in (errno.ENXIO, errno.ENODEV):
            return DriverError(f"{self.name}: {lines} has no interrupt: its edges cannot be counted")
        if error.errno == errno.E2BIG:
            return DriverError(f"{self.name}: {lines}: the kernel takes at most 10 different settings in one request")
        return DriverError(f"{self.name}: {lines}: the chip does not take these settings ({error.strerror})")

    def _called(self, offset: int) -> str:
        assert self._chip is not None
        name = self._chip.get_line_info(offset).name
        return f"line {offset} ({name})" if name else f"line {offset}"

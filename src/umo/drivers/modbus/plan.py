"""The fewest requests that serve a period's channels, and the writes that may be left out. This module uses neither a
device nor a clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from umo.drivers.contract import Direction, IntArray
from umo.drivers.modbus.channel import ModbusChannel, Table
from umo.errors import ChannelsFailed, DriverError

_MAX_REMEMBERED = 256
"""Writes whose confirmation is remembered."""


@dataclass(frozen=True)
class Item:
    """A channel, its index among the values of the call, and the index of its first cell in the request."""

    place: int
    offset: int
    channel: ModbusChannel

    @property
    def within(self) -> slice:
        return slice(self.offset, self.offset + self.channel.cells)


class Single(NamedTuple):
    """A channel that is one whole cell, with the data needed in every period. `sign` is its sign bit, or 0."""

    place: int
    offset: int
    sign: int
    lowest: int
    highest: int


@dataclass(frozen=True)
class Request:
    """One request: `count` cells of a table from `address`, and the channels among them."""

    table: Table
    address: int
    count: int
    items: tuple[Item, ...]
    singles: tuple[Single, ...] = field(default=(), compare=False)
    """The channels that are one whole cell."""
    places: slice | list[int] = field(default_factory=list, compare=False)
    """The indices of these channels among the values."""
    others: tuple[Item, ...] = field(default=(), compare=False)
    """The channels that have several cells, are a field of a cell, or have another order of bytes."""
    masks: tuple[int, ...] = field(default=(), compare=False)
    """The bits of each cell that belong to the channels."""
    partial: tuple[int, ...] = field(default=(), compare=False)
    """Offsets of the registers of which only some bits belong to the channels."""

    @property
    def what(self) -> str:
        if self.count == 1:
            return f"{self.table.cells} {self.address}"
        return f"{self.table.cells}s {self.address} to {self.address + self.count - 1}"

    def decode(self, cells: Sequence[int], out: IntArray) -> None:
        """Store the values of an answer's cells in `out`. Raises ChannelsFailed, which names the channels whose cells
        do not hold a raw integer."""
        # two's complement; sign 0 leaves the value alone
        out[self.places] = [(cells[offset] ^ sign) - sign for _, offset, sign, _, _ in self.singles]
        if self.others:
            self._decode_others(cells, out)

    def _decode_others(self, cells: Sequence[int], out: IntArray) -> None:
        failed: dict[str, str] = {}
        for item in self.others:
            try:
                out[item.place] = item.channel.raw(cells[item.within])
            except DriverError as error:
                failed[item.channel.text] = str(error)
        if failed:
            raise ChannelsFailed(failed)

    def encode(self, raws: Sequence[int]) -> list[int]:
        """Return the cells that carry these values, with 0 in all other bits. A value that does not fit is an error; it
        is never cut off."""
        cells = [0] * self.count
        for place, offset, _, lowest, highest in self.singles:
            raw = raws[place]
            if not lowest <= raw <= highest:
                next(item for item in self.items if item.place == place).channel.fit(raw)  # says why
            cells[offset] = raw & 0xFFFF
        for item in self.others:
            for offset, word in enumerate(item.channel.words(raws[item.place]), item.offset):
                cells[offset] |= word
        return cells

    def completed(self, cells: Sequence[int], contents: Mapping[int, int]) -> list[int]:
        """Return the cells. The other bits of partial cells are taken from the contents of registers by their
        addresses."""
        whole = list(cells)
        for offset in self.partial:
            whole[offset] |= contents[self.address + offset] & ~self.masks[offset]
        return whole

    def span(self, offsets: Sequence[int]) -> Request:
        """Return the request that reads the cells from the first to the last of these offsets, including both."""
        return Request(self.table, self.address + offsets[0], offsets[-1] - offsets[0] + 1, ())

    def check_taken(self, cells: Sequence[int], read_back: Sequence[int]) -> None:
        """Check the values that were read back. Raises ChannelsFailed, which names the channels whose cells differ from
        the written ones."""
        failed: dict[str, str] = {}
        for item in self.items:
            masks = item.channel.masks
            found, wanted = ([word & mask for word, mask in zip(words[item.within], masks, strict=True)]
                             for words in (read_back, cells))  # fmt: skip
            if found != wanted:
                failed[item.channel.text] = f"the unit reads back {found} in place of {wanted}"
        if failed:
            raise ChannelsFailed(failed)


Requests = tuple[Request, ...]
_Placed = tuple[int, ModbusChannel]
_Key = tuple[str, int, int, tuple[int, ...]]


def plan_reads(channels: Sequence[ModbusChannel], *, bridge_gaps: bool = False, most_registers: int = 125) -> Requests:
    """Return the reads that serve all the channels: consecutive cells of one table, and across small gaps if
    `bridge_gaps` is True."""

    def joins(end: int, channel: ModbusChannel) -> bool:
        return channel.address <= end + (channel.table.bridge if bridge_gaps else 0)

    def most(table: Table) -> int:
        return table.most_read if table.full == 1 else most_registers

    return _plan(channels, joins, most)


def plan_writes(channels: Sequence[ModbusChannel], *, most_registers: int = 123, masking: bool = False) -> Requests:
    """Return the writes that serve all the channels: consecutive cells without gaps, because no value was commanded for
    cells in between.

    The fields of a register are written together. `masking`: a register of which only some bits are written has a
    separate request. Channels that share a bit are written one by one in the order given, so that the last value
    remains.
    """
    written: dict[tuple[Table, int], int] = {}
    for channel in channels:
        if Direction.OUTPUT not in channel.direction:
            raise DriverError(f"{channel.text} is an input")
        for address, mask in enumerate(channel.masks, channel.address):
            if written.get((channel.table, address), 0) & mask:
                return tuple(_request([placed]) for placed in enumerate(channels))
            written[channel.table, address] = written.get((channel.table, address), 0) | mask

    def joins(end: int, channel: ModbusChannel) -> bool:
        if channel.address != end:
            return channel.address < end  # of one register
        neighbours = (written[channel.table, end - 1], written[channel.table, end])
        return not masking or neighbours == (channel.table.full, channel.table.full)

    def most(table: Table) -> int:
        return table.most_written if table.full == 1 else most_registers

    return _plan(channels, joins, most)


def _plan(
    channels: Sequence[ModbusChannel], joins: Callable[[int, ModbusChannel], bool], most: Callable[[Table], int]
) -> Requests:
    runs: list[list[_Placed]] = []
    table: Table | None = None
    start = end = 0
    for index, channel in _by_place(enumerate(channels)):
        reach = max(end, channel.end)
        if channel.table is table and joins(end, channel) and reach - start <= most(table):
            runs[-1].append((index, channel))
            end = reach
        else:
            runs.append([(index, channel)])
            table, start, end = channel.table, channel.address, channel.end
    runs.sort(key=lambda run: min(index for index, _ in run))  # in the order of the declaration
    return tuple(_request(run) for run in runs)


def _request(run: Sequence[_Placed]) -> Request:
    table, start = run[0][1].table, run[0][1].address
    end = max(channel.end for _, channel in run)
    items = tuple(Item(index, channel.address - start, channel) for index, channel in run)
    plain = [item for item in items if item.channel.plain]
    singles = tuple(
        Single(item.place, item.offset, 1 << 15 if channel.signed else 0, channel.lowest, channel.highest)
        for item, channel in ((each, each.channel) for each in plain)
    )
    others = tuple(item for item in items if not item.channel.plain)
    masks = [0] * (end - start)
    for item in items:
        for offset, mask in enumerate(item.channel.masks, item.offset):
            masks[offset] |= mask
    partial = tuple(offset for offset, mask in enumerate(masks) if mask != table.full)
    return Request(table, start, end - start, items, singles, _places(plain), others, tuple(masks), partial)


def _places(items: Sequence[Item]) -> slice | list[int]:
    """Return the indices of the items; a slice if they are consecutive, because numpy is then quicker."""
    places = [item.place for item in items]
    if places and places == list(range(places[0], places[0] + len(places))):
        return slice(places[0], places[0] + len(places))
    return places


def _by_place(placed: Iterable[_Placed]) -> list[_Placed]:
    return sorted(placed, key=lambda each: (each[1].table.name, each[1].address, each[0]))


class WriteCache:
    """The cells that the device has confirmed, by request. `keep`: the time in s after which a write is repeated."""

    def __init__(self, keep: float) -> None:
        self._keep = keep
        self._confirmed: dict[_Key, tuple[list[int], float]] = {}

    def covers(self, request: Request, cells: list[int], now: float) -> bool:
        """Return True if exactly these values were confirmed less than `keep` s ago, and nothing was written to the
        cells since."""
        cells_then, then = self._confirmed.get(_key(request), ((), 0.0))
        return cells_then == cells and now - then < self._keep

    def begins(self, request: Request) -> None:
        """Record that the request is about to be written; until it is confirmed, its cells are unknown."""
        end = request.address + request.count
        for key in [key for key in self._confirmed if key[0] == request.table.name]:
            if key[1] < end and request.address < key[1] + key[2]:
                del self._confirmed[key]

    def confirmed(self, request: Request, cells: list[int], now: float) -> None:
        """Record that the request was confirmed. `now`: the time at which it began."""
        if len(self._confirmed) >= _MAX_REMEMBERED:
            self._confirmed.clear()
        self._confirmed[_key(request)] = cells, now

    def forget(self) -> None:
        """Forget the contents."""
        self._confirmed.clear()


class RegisterContents:
    """The contents, by address, of the registers that were written in part, as the unit has confirmed them."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}

    def missing(self, request: Request) -> list[int]:
        """Return the offsets of the registers that the request writes in part and whose contents are not known."""
        return [offset for offset in request.partial if request.address + offset not in self.words]

    def begins(self, request: Request) -> None:
        """Record that the request is about to be written; until it is confirmed, its registers are unknown."""
        if self.words:
            for address in range(request.address, request.address + request.count):
                self.words.pop(address, None)

    def confirmed(self, request: Request, cells: Sequence[int]) -> None:
        for offset in request.partial:
            self.words[request.address + offset] = cells[offset]

    def forget(self) -> None:
        """Forget the contents."""
        self.words.clear()


def _key(request: Request) -> _Key:
    return request.table.name, request.address, request.count, request.masks

"""Modbus channels, and the fewest requests that serve a period's channels: pure functions, no device.

Addresses are the protocol's own, from 0: what a manual calls holding register 40001 is mostly `holding:0`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from umo.drivers.contract import Channel, Direction, IntArray
from umo.errors import ChannelError, DriverError

HIGHEST_ADDRESS = 65535


@dataclass(frozen=True, eq=False)  # one object per table, compared and hashed by identity
class Table:
    """One of the four tables, with the most cells one request may carry (Modbus specification V1.1b3).

    `bridge` is the widest gap of unused cells that costs less to read than another request does.
    """

    name: str
    cells: str
    most_read: int
    most_written: int
    bridge: int


COIL = Table("coil", "coil", 2000, 1968, 64)
DISCRETE = Table("discrete", "discrete input", 2000, 0, 64)
HOLDING = Table("holding", "holding register", 125, 123, 16)
INPUT = Table("input", "input register", 125, 0, 16)

TABLES = {table.name: table for table in (COIL, DISCRETE, HOLDING, INPUT)}
TYPES = {"uint16": (16, False), "int16": (16, True), "uint32": (32, False), "int32": (32, True)}
FORMS = (
    "coil:N",
    "discrete:N",
    "holding:N[:TYPE]",
    "input:N[:TYPE] (N 0 to 65535, TYPE uint16, int16, uint32 or int32; 32 bits take N and N + 1)",
)

_BIT = re.compile(r"(coil|discrete):(0|[1-9][0-9]{0,4})")
_WORD = re.compile(r"(holding|input):(0|[1-9][0-9]{0,4})(?::(uint16|int16|uint32|int32))?")


@dataclass(frozen=True)
class ModbusChannel(Channel):
    """A channel and its place: `cells` cells of its table from `address`.

    `low` and `high` are the offsets of its 16-bit words; `high` is -1 where there is one word, or a bit.
    """

    table: Table = COIL
    address: int = 0
    cells: int = 1
    low: int = 0
    high: int = -1
    unit: int = 1

    # Plans are looked up by their channels in every period, and a string keeps its hash.
    def __hash__(self) -> int:
        return hash(self.text)

    @property
    def end(self) -> int:
        return self.address + self.cells

    @property
    def places(self) -> tuple[Hashable, ...]:
        """Its cells: `holding:0` and `holding:0:int32` overlap, whatever their texts."""
        return tuple((self.unit, self.table.cells, address) for address in range(self.address, self.end))


def parse(text: str, *, little: bool = False, unit: int = 1) -> ModbusChannel:
    """The channel that the text names; `little`: the low word of 32 bits comes first."""
    match = _BIT.fullmatch(text) or _WORD.fullmatch(text)
    if match is None:
        raise ChannelError(text, FORMS)
    table, address = TABLES[match[1]], int(match[2])
    bits, signed = (1, False) if match.re is _BIT else TYPES[match[3] or "uint16"]
    cells = 2 if bits == 32 else 1
    if address + cells - 1 > HIGHEST_ADDRESS:
        raise ChannelError(text, FORMS)
    direction = Direction.BOTH if table.most_written else Direction.INPUT
    low, high = (0, -1) if cells == 1 else (0, 1) if little else (1, 0)
    return ModbusChannel(text, direction, bits, signed, table, address, cells, low, high, unit)


class Item(NamedTuple):
    """The place of a channel among the values of the call, and where it lies in the request's cells."""

    place: int
    low: int
    high: int
    sign: int
    least: int
    most: int


@dataclass(frozen=True)
class Request:
    """One request: `count` cells of a table from `address`, and the channels among them."""

    table: Table
    address: int
    count: int
    items: tuple[Item, ...]

    @property
    def what(self) -> str:
        if self.count == 1:
            return f"{self.table.cells} {self.address}"
        return f"{self.table.cells}s {self.address} to {self.address + self.count - 1}"

    def decode(self, cells: Sequence[int], out: IntArray) -> None:
        """Put the values of an answer's cells into their places of `out`."""
        for place, low, high, sign, _, _ in self.items:
            value = cells[low] if high < 0 else cells[high] << 16 | cells[low]
            out[place] = (value ^ sign) - sign  # two's complement; sign 0 leaves the value alone

    def encode(self, raws: Sequence[int]) -> list[int]:
        """The cells that carry these values; a value that does not fit is an error, never cut off."""
        cells = [0] * self.count
        for place, low, high, _, least, most in self.items:
            raw = raws[place]
            if not least <= raw <= most:
                raise DriverError(f"{raw} does not fit {self.what}: it takes {least} to {most}")
            cells[low] = raw & 0xFFFF
            if high >= 0:
                cells[high] = raw >> 16 & 0xFFFF
        return cells


Requests = tuple[Request, ...]
_Placed = tuple[int, ModbusChannel]


def plan_reads(channels: Sequence[ModbusChannel], *, bridge_gaps: bool = False) -> Requests:
    """The reads that serve all the channels: runs of one table, over small gaps too if `bridge_gaps`."""

    def joins(end: int, channel: ModbusChannel) -> bool:
        return channel.address <= end + (channel.table.bridge if bridge_gaps else 0)

    return _plan(channels, joins, lambda table: table.most_read)


def plan_writes(channels: Sequence[ModbusChannel]) -> Requests:
    """The writes that serve all the channels: runs without gaps, as nobody commanded the cells between.

    Channels that share a cell are written one by one in the order given, so that the last one stands.
    """
    for channel in channels:
        if not channel.table.most_written:
            raise DriverError(f"{channel.text} is an input")
    if _overlap(channels):
        return tuple(_request([placed]) for placed in enumerate(channels))
    return _plan(channels, lambda end, channel: channel.address == end, lambda table: table.most_written)


def _plan(
    channels: Sequence[ModbusChannel],
    joins: Callable[[int, ModbusChannel], bool],
    most: Callable[[Table], int],
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
    start = run[0][1].address
    end = max(channel.end for _, channel in run)
    return Request(run[0][1].table, start, end - start, tuple(_item(i, c, start) for i, c in run))


def _item(index: int, channel: ModbusChannel, start: int) -> Item:
    offset = channel.address - start
    high = offset + channel.high if channel.high >= 0 else -1
    sign = 1 << (channel.bits - 1) if channel.signed else 0
    return Item(index, offset + channel.low, high, sign, channel.lowest, channel.highest)


def _by_place(placed: Iterable[_Placed]) -> list[_Placed]:
    return sorted(placed, key=lambda each: (each[1].table.name, each[1].address, each[0]))


def _overlap(channels: Sequence[ModbusChannel]) -> bool:
    ordered = [channel for _, channel in _by_place(enumerate(channels))]
    return any(one.table is other.table and other.address < one.end for one, other in pairwise(ordered))

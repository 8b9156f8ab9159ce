"""Modbus channels: pure functions, which use no device. Addresses are those of the protocol, from 0: holding register
40001 of a manual is usually `holding:0`.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from umo.drivers.contract import INT64, Channel, Direction
from umo.errors import ChannelError, DriverError

HIGHEST_ADDRESS = 65535


@dataclass(frozen=True, eq=False)  # one object per table, compared and hashed by identity
class Table:
    """One of the four tables, with the largest number of cells in one request (Modbus specification V1.1b3).

    `bridge` is the widest gap of unused cells that takes less time to read than another request. `full`: the content of
    a cell with all of its bits set.
    """

    name: str
    cells: str
    most_read: int
    most_written: int
    bridge: int
    full: int = 0xFFFF


COIL = Table("coil", "coil", 2000, 1968, 64, 1)
DISCRETE = Table("discrete", "discrete input", 2000, 0, 64, 1)
HOLDING = Table("holding", "holding register", 125, 123, 16)
INPUT = Table("input", "input register", 125, 0, 16)
TABLES = {table.name: table for table in (COIL, DISCRETE, HOLDING, INPUT)}


class Type(NamedTuple):
    """Type of the content of registers. `bits`: the width of the raw integer; for a float, the width of the integers
    that it can hold exactly."""

    cells: int
    bits: int
    signed: bool


BIT = Type(1, 1, False)
TYPES = {
    **{f"uint{bits}": Type(bits // 16, bits, False) for bits in (16, 32, 64)},
    **{f"int{bits}": Type(bits // 16, bits, True) for bits in (16, 32, 64)},
    "float32": Type(2, 24, True),
    "float64": Type(4, 52, True),
}
ORDERS = {"ABCD": (False, False), "CDAB": (True, False), "BADC": (False, True), "DCBA": (True, True)}
"""Orders of a value's bytes on the line, A the highest: whether the low word comes first, and whether the low byte of
each word comes first. For 64 bits, all four words have the order of the two words of 32 bits."""
SINGLE_ORDERS = {"AB": (False, False), "BA": (False, True)}
"""The byte orders of a single register."""
FORMS = (
    "coil:N (N 0 to 65535)",
    "discrete:N (N 0 to 65535)",
    "holding:N[:TYPE][:ORDER]",
    "input:N[:TYPE][:ORDER] (N 0 to 65535; TYPE uint16, int16, uint32, int32, uint64 or int64, float32:SCALE or "
    "float64:SCALE with a scale of 1e-12 to 1e12; 32 bits take N and N + 1, 64 bits N to N + 3; ORDER ABCD, CDAB, BADC "
    "or DCBA, of 16 bits AB or BA)",
    "holding:N[:TYPE][:ORDER].BIT",
    "holding:N[:TYPE][:ORDER].HIGH:LOW (bits of an integer, the same for input; 0 is the lowest)",
)

_NUMBER = r"(0|[1-9][0-9]{0,4})"
_SCALE = r"[0-9]{1,13}(?:\.[0-9]{1,13})?(?:e-?[0-9]{1,2})?"
_SCALES = 1e-12, 1e12
"""Bounds of a float channel's scale: each of its raw integers is a normal float, with all its digits."""
_BIT = r"(0|[1-9][0-9]?)"
_TEXT = re.compile(
    rf"(?P<bit>coil|discrete):(?P<place>{_NUMBER})|(?P<word>holding|input):(?P<address>{_NUMBER})"
    rf"(?::(?P<integer>u?int(?:16|32|64))|:(?P<float>float(?:32|64)):(?P<scale>{_SCALE}))?"
    rf"(?::(?P<order>{'|'.join([*ORDERS, *SINGLE_ORDERS])}))?(?:\.(?P<high>{_BIT})(?::(?P<low>{_BIT}))?)?"
)


@dataclass(frozen=True)
class ModbusChannel(Channel):
    """A channel and its place: `cells` cells of its table from `address`.

    The raw integer of a float is the nearest one to its value divided by `scale`. `scale` is 0 for other types. The
    number of bits of a float channel is that of the integers that the float can hold exactly: 24 or 52. `little`: the
    low word has the lower address; `swapped`: the low byte of each register comes first. `low`: the lowest bit of a
    field in its registers; None if the channel has all bits of its registers.
    """

    table: Table = COIL
    address: int = 0
    cells: int = 1
    little: bool = False
    scale: float = 0.0
    unit: int = 1
    swapped: bool = False
    low: int | None = None
    masked: bool = False
    """True if a field is written by function 22, which does not change the other bits of the register."""
    uncut: ModbusChannel | None = field(default=None, compare=False, repr=False)
    """The channel with all registers of the value of a field."""

    @property
    def end(self) -> int:
        return self.address + self.cells

    @property
    def plain(self) -> bool:
        """True if the raw integer of the channel is the content of one cell, except for the sign."""
        return self.cells == 1 and self.low is None and not self.swapped

    @property
    def places(self) -> tuple[Hashable, ...]:
        """The bits of the channel: `holding:0`, `holding:0:int32` and `holding:0.7` overlap, regardless of their texts,
        and `holding:0.6` and `holding:0.7` do not."""
        return self._bits_of(self.masks)

    @property
    def rewrites(self) -> tuple[Hashable, ...]:
        """The other bits of a field's registers."""
        return () if self.masked else self._bits_of([self.table.full ^ mask for mask in self.masks])

    def _bits_of(self, masks: Sequence[int]) -> tuple[Hashable, ...]:
        return tuple(
            (self.unit, self.table.cells, self.address + i, bit)
            for i, mask in enumerate(masks)
            for bit in range(mask.bit_length())
            if mask >> bit & 1
        )

    @property
    def masks(self) -> list[int]:
        """The bits that belong to the channel in each of its cells."""
        if self.table.full == 1:
            return [1]
        return self._laid((1 << 16 * self.cells) - 1 if self.low is None else (1 << self.bits) - 1 << self.low)

    def raw(self, words: Sequence[int]) -> int:
        """Return the raw integer that the registers hold. Raises DriverError if it does not fit 64 bits with a sign."""
        if self.scale:
            return self._rounded(self.number(words), words)
        raw = int(self.number(words))
        self.fit(raw)
        return raw

    def number(self, words: Sequence[int]) -> float:
        """Return the number that the registers hold, without division by a scale."""
        whole = 0
        for word in reversed(words) if self.little else words:
            whole = whole << 16 | (_exchanged(word) if self.swapped else word)
        if self.scale:
            number: float = struct.unpack(self._packing, whole.to_bytes(2 * self.cells, "big"))[0]
            return number
        if self.low is not None:
            whole = whole >> self.low & (1 << self.bits) - 1
        return whole - (1 << self.bits) if self.signed and whole >> (self.bits - 1) else whole

    def words(self, raw: int) -> list[int]:
        """Return the contents of the registers for a raw integer, with 0 in the bits that do not belong to the channel.
        Raises DriverError for a raw integer beyond the channel's range."""
        self.fit(raw)
        if self.scale:
            return self._laid(int.from_bytes(struct.pack(self._packing, raw * self.scale), "big"))
        return self._laid(raw if self.low is None else (raw & (1 << self.bits) - 1) << self.low)

    def in_each_order(self, words: Sequence[int]) -> str:
        """Return the numbers that these registers hold in each order of their bytes: "ABCD 238.7 (wired), CDAB ..."."""
        shown = []
        for name, (little, swapped) in (ORDERS if self.cells > 1 else SINGLE_ORDERS).items():
            number = replace(self, little=little, swapped=swapped).number(words)
            wired = " (wired)" if (little, swapped) == (self.little, self.swapped) else ""
            shown.append(f"{name} {number:.7g}{wired}" if self.scale else f"{name} {number}{wired}")
        return ", ".join(shown)

    def _laid(self, whole: int) -> list[int]:
        """Return the contents of the registers, in the order of their addresses, for all bits of the value."""
        words = [whole >> shift & 0xFFFF for shift in range(0, 16 * self.cells, 16)]
        if self.swapped:
            words = [_exchanged(word) for word in words]
        return words if self.little else words[::-1]

    @property
    def _packing(self) -> str:
        """The format of a float for `struct`: IEEE 754 with 32 or 64 bits."""
        return ">f" if self.cells == 2 else ">d"

    def _rounded(self, value: float, words: Sequence[int]) -> int:
        quotient = value / self.scale
        if not math.isfinite(quotient) or not INT64.min <= (raw := round(quotient)) <= INT64.max:
            what = f"{self.text} reads {value:g}, for which there is no raw integer"
            raise DriverError(f"{what}; by the order of bytes: {self.in_each_order(words)}")
        return raw


def _exchanged(word: int) -> int:
    """Return the content of a register with its two bytes exchanged."""
    return word >> 8 | (word & 0xFF) << 8


def parse(text: str, *, little: bool = False, swapped: bool = False, unit: int = 1) -> ModbusChannel:
    """Return the channel that the text names. `little`: the low word of a wider value comes first. `swapped`: the low
    byte of each register comes first. Both settings apply if the text gives no order."""
    match = _TEXT.fullmatch(text)
    if match is None:
        raise ChannelError(text, FORMS)
    if match["bit"]:
        table = TABLES[match["bit"]]
        place = int(match["place"])
        if place > HIGHEST_ADDRESS:
            raise ChannelError(text, FORMS)
        return ModbusChannel(text, _direction(table), 1, False, table, place, unit=unit)
    table, address = TABLES[match["word"]], int(match["address"])
    kind = TYPES[match["integer"] or match["float"] or "uint16"]
    scale = float(match["scale"] or 0.0)
    orders = ORDERS if kind.cells > 1 else SINGLE_ORDERS
    little, swapped = orders.get(match["order"], (little and kind.cells > 1, swapped))
    if (
        address + kind.cells - 1 > HIGHEST_ADDRESS
        or (match["scale"] and not _SCALES[0] <= scale <= _SCALES[1])
        or (match["order"] or next(iter(orders))) not in orders
    ):
        raise ChannelError(text, FORMS)
    channel = ModbusChannel(
        text, _direction(table), kind.bits, kind.signed, table, address, kind.cells, little, scale, unit, swapped
    )
    if match["high"] is None:
        return channel
    high = int(match["high"])
    return _field(channel, high, int(match["low"] or high))


def _direction(table: Table) -> Direction:
    return Direction.BOTH if table.most_written else Direction.INPUT


def _field(channel: ModbusChannel, high: int, low: int) -> ModbusChannel:
    """Return the field of these bits of an integer channel. The field uses only the registers that contain these
    bits."""
    bits = high - low + 1
    if channel.scale or high >= channel.bits or bits < (2 if channel.signed else 1):
        raise ChannelError(channel.text, FORMS)
    first, last = low // 16, high // 16
    cells = last - first + 1
    address = channel.address + (first if channel.little else channel.cells - 1 - last)
    uncut = replace(channel, bits=bits, low=low)
    return replace(
        uncut, address=address, cells=cells, little=channel.little and cells > 1, low=low - 16 * first, uncut=uncut
    )

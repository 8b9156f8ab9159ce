"""Modbus channels: pure functions, no device.

Addresses are the protocol's own, from 0: what a manual calls holding register 40001 is mostly `holding:0`.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from umo.drivers.contract import INT64, Channel, Direction
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


class Type(NamedTuple):
    """Type of what registers hold. `bits`: width of the raw integer; of a float, of the integers it holds exactly."""

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
FORMS = (
    "coil:N (N 0 to 65535)",
    "discrete:N (N 0 to 65535)",
    "holding:N[:TYPE]",
    "input:N[:TYPE] (N 0 to 65535; TYPE uint16, int16, uint32, int32, uint64 or int64, float32:SCALE or float64:SCALE "
    "with a scale of 1e-12 to 1e12; 32 bits take N and N + 1, 64 bits N to N + 3)",
)

_NUMBER = r"(0|[1-9][0-9]{0,4})"
_SCALE = r"[0-9]{1,13}(?:\.[0-9]{1,13})?(?:e-?[0-9]{1,2})?"
_SCALES = 1e-12, 1e12
"""Bounds of a float channel's scale: each of its raw integers is a normal float, with all its digits."""
_TEXT = re.compile(
    rf"(coil|discrete):{_NUMBER}|(holding|input):{_NUMBER}(?::(u?int(?:16|32|64))|:(float(?:32|64)):({_SCALE}))?"
)


@dataclass(frozen=True)
class ModbusChannel(Channel):
    """A channel and its place: `cells` cells of its table from `address`.

    The raw integer of a float is the nearest to its value divided by `scale`, which is 0 where there is no float. The
    channel's bits are those that a float carries exactly: 24 or 52. `little`: the low word has the lower address.
    """

    table: Table = COIL
    address: int = 0
    cells: int = 1
    little: bool = False
    scale: float = 0.0
    unit: int = 1

    @property
    def end(self) -> int:
        return self.address + self.cells

    @property
    def places(self) -> tuple[Hashable, ...]:
        """Its cells: `holding:0` and `holding:0:int32` overlap, whatever their texts."""
        return tuple((self.unit, self.table.cells, address) for address in range(self.address, self.end))

    def raw(self, words: Sequence[int]) -> int:
        """The raw integer that its registers hold. DriverError for one that is not of 64 bits with a sign."""
        whole = 0
        for word in reversed(words) if self.little else words:
            whole = whole << 16 | word
        if self.scale:
            return self._rounded(struct.unpack(self._packing, whole.to_bytes(2 * self.cells, "big"))[0])
        if self.signed and whole >> (self.bits - 1):
            return whole - (1 << self.bits)
        self.fit(whole)
        return whole

    def words(self, raw: int) -> list[int]:
        """Contents of its registers for a raw integer. DriverError for one beyond its range."""
        self.fit(raw)
        if self.scale:
            raw = int.from_bytes(struct.pack(self._packing, raw * self.scale), "big")
        words = [raw >> shift & 0xFFFF for shift in range(0, 16 * self.cells, 16)]
        return words if self.little else words[::-1]

    @property
    def _packing(self) -> str:
        """IEEE 754 of 32 or 64 bits."""
        return ">f" if self.cells == 2 else ">d"

    def _rounded(self, value: float) -> int:
        quotient = value / self.scale
        if not math.isfinite(quotient) or not INT64.min <= (raw := round(quotient)) <= INT64.max:
            raise DriverError(f"{self.text} reads {value:g}, for which there is no raw integer")
        return raw


def parse(text: str, *, little: bool = False, unit: int = 1) -> ModbusChannel:
    """The channel that the text names; `little`: the low word of several comes first."""
    match = _TEXT.fullmatch(text)
    if match is None:
        raise ChannelError(text, FORMS)
    bit, bit_address, word, word_address, integer, floating, scale = match.groups()
    table, address = TABLES[bit or word], int(bit_address or word_address)
    kind = BIT if bit else TYPES[integer or floating or "uint16"]
    size = float(scale) if scale else 0.0
    if address + kind.cells - 1 > HIGHEST_ADDRESS or (scale and not _SCALES[0] <= size <= _SCALES[1]):
        raise ChannelError(text, FORMS)
    direction = Direction.BOTH if table.most_written else Direction.INPUT
    little = little and kind.cells > 1
    return ModbusChannel(text, direction, kind.bits, kind.signed, table, address, kind.cells, little, size, unit)

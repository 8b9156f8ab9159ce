"""Register maps: the registers of a chip as in its datasheet, and the channels on them. This module uses no device.

A register has an address, a width of whole bytes, a byte order and optionally a page, and may be divided into bit
fields.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from typing_extensions import TypedDict

from umo.drivers.contract import Channel, Direction
from umo.drivers.option_checks import checked_table, one_of, truth, within
from umo.errors import ChannelError, WiringError

WIDTHS = (8, 16, 24, 32, 40, 48, 56, 64)
ACCESS = {"r": Direction.INPUT, "w": Direction.OUTPUT, "rw": Direction.BOTH}
FORMS = ("ADDRESS:BITS[:big|little][:signed]", "REGISTER.BIT", "REGISTER.HIGH:LOW")
"""Forms of channels that the wiring does not name."""

_DIRECT = re.compile(r"(0x[0-9a-fA-F]+|[0-9]+):([0-9]+)(?::(big|little))?(:signed)?")
_BITS = re.compile(r"([0-9]+)(?::([0-9]+))?")
_PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class FieldOptions(TypedDict, total=False):
    """The table of a bit field."""

    bits: int | str
    signed: bool


class RegisterOptions(TypedDict, total=False):
    """The table of a register. It needs `address`."""

    address: int
    bits: int
    byte_order: Literal["big", "little"]
    signed: bool
    shift: int
    page: int
    access: str
    initial: int
    fields: dict[str, int | str | FieldOptions]


@dataclass(frozen=True)
class Register:
    """One register. `shift` is the number of unused bits below a value that is aligned to the left."""

    address: int
    bits: int = 8
    byte_order: Literal["big", "little"] = "big"
    signed: bool = False
    shift: int = 0
    page: int | None = None
    direction: Direction = Direction.BOTH
    initial: int | None = None
    """The value after a reset of the chip, which the first write of a bit field uses for the other bits; None if the
    other bits are read."""

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self.bits // 8

    def unpack(self, data: bytes) -> int:
        return int.from_bytes(data, self.byte_order)

    def pack(self, contents: int) -> bytes:
        return contents.to_bytes(self.size, self.byte_order)


@dataclass(frozen=True)
class RegisterChannel(Channel):
    """A channel of `bits` bits of a register from bit `low` on. `whole`: the channel is the whole register; the unused
    bits below it are written as 0."""

    register: Register = Register(0)
    low: int = 0
    whole: bool = True
    bytewise: bool = False
    """True if the chip counts its addresses in bytes, so that a register of 16 bits takes two addresses."""

    @property
    def places(self) -> tuple[Hashable, ...]:
        """The bits of the channel, so that two fields of one register are two places, and a field is within its
        register."""
        bits = range(self.register.bits) if self.whole else range(self.low, self.low + self.bits)
        return tuple((self.register.page, *self._place(bit)) for bit in bits)

    @property
    def rewrites(self) -> tuple[Hashable, ...]:
        """The other bits of a field's register."""
        bits = () if self.whole else (*range(self.low), *range(self.low + self.bits, self.register.bits))
        return tuple((self.register.page, *self._place(bit)) for bit in bits)

    def _place(self, bit: int) -> tuple[int, int]:
        register = self.register
        if not self.bytewise:
            return register.address, bit
        byte = bit // 8 if register.byte_order == "little" else register.size - 1 - bit // 8
        return register.address + byte, bit % 8

    def decode(self, contents: int) -> int:
        """Return the raw integer in a register's contents. Raises DriverError if it is too large for an int64."""
        raw = contents >> self.low & (1 << self.bits) - 1
        sign = 1 << self.bits - 1 if self.signed else 0
        raw = (raw ^ sign) - sign
        self.fit(raw)
        return raw

    def encode(self, raw: int, contents: int) -> int:
        """Return a register's contents with this raw integer in the bits of the channel. The caller has checked that
        the integer fits."""
        if self.whole:
            return (raw & (1 << self.bits) - 1) << self.low
        mask = (1 << self.bits) - 1 << self.low
        return contents & ~mask | raw << self.low & mask


class ChipRegisters:
    """The registers of a chip by name, from the wiring's `[drivers.NAME.registers]`. Raises WiringError, which names
    the mistake.

    `address_bits`: width of an address. `paged`: the driver has a page register. `bytewise`: see RegisterChannel.
    """

    def __init__(
        self, tables: Mapping[str, RegisterOptions], *, address_bits: int, paged: bool, bytewise: bool
    ) -> None:
        self._highest = (1 << address_bits) - 1
        self._paged, self._bytewise = paged, bytewise
        self.registers: dict[str, Register] = {}
        self.fields: dict[str, dict[str, tuple[int, int, bool]]] = {}
        """The lowest bit, the number of bits and the sign of each field, by register and name."""
        for name, table in tables.items():
            self._add(name, table)

    def channel(self, text: str) -> RegisterChannel:
        """Return the channel for a text such as `NAME`, `NAME.FIELD`, `NAME.7` or `NAME.11:9`. `0x05:16:big` may take
        the place of `NAME`."""
        name, dot, part = text.partition(".")
        register = self.registers.get(name) or self._direct(name)
        if register is None:
            raise ChannelError(text, self.forms)
        if not dot:
            width = register.bits - register.shift
            channel = RegisterChannel(text, register.direction, width, register.signed, register, register.shift)
            return replace(channel, bytewise=self._bytewise)
        fields = self.fields.get(name, {})
        if part not in fields and not _BITS.fullmatch(part):
            raise ChannelError(text, [f"{name}.{each}" for each in fields] or self.forms)
        low, width, signed = fields[part] if part in fields else (*_bits_of(text, part, register.bits), False)
        if register.direction is Direction.OUTPUT and register.initial is None:
            raise WiringError(f"{text}: {name} cannot be read, so it needs `initial`, its value after a reset")
        return RegisterChannel(text, register.direction, width, signed, register, low, False, self._bytewise)

    @property
    def forms(self) -> list[str]:
        named = [*self.registers, *(f"{name}.{field}" for name, fields in self.fields.items() for field in fields)]
        return [*named, *FORMS]

    def _direct(self, text: str) -> Register | None:
        match = _DIRECT.fullmatch(text)
        if match is None:
            return None
        address, bits = int(match[1], 0 if match[1][:2] == "0x" else 10), int(match[2])
        if bits not in WIDTHS or address + self._span(bits) > self._highest:
            return None
        return Register(address, bits, "little" if match[3] == "little" else "big", bool(match[4]))

    def _span(self, bits: int) -> int:
        """Return the number of addresses that a register takes in addition to its first one."""
        return bits // 8 - 1 if self._bytewise else 0

    def _add(self, name: str, table: RegisterOptions) -> None:
        what = f"registers.{name}"
        if not _PLAIN_NAME.fullmatch(name):
            raise WiringError(f"{what}: a register's name is made of letters, digits and _")
        checked_table(what, table, RegisterOptions.__annotations__, "{ address = 0x05, bits = 16 }")
        if "address" not in table:
            raise WiringError(f"{what}.address is missing")
        bits = one_of(f"{what}.bits", table.get("bits", 8), WIDTHS)
        order = one_of(f"{what}.byte_order", table.get("byte_order", "big"), ("big", "little"))
        access = one_of(f"{what}.access", table.get("access", "rw"), tuple(ACCESS))
        page, initial = table.get("page"), table.get("initial")
        if page is not None and not self._paged:
            raise WiringError(f"{what}.page needs the driver's option page_register")
        self.registers[name] = Register(
            within(f"{what}.address", table["address"], 0, self._highest - self._span(bits)),
            bits,
            order,
            truth(f"{what}.signed", table.get("signed", False)),
            within(f"{what}.shift", table.get("shift", 0), 0, bits - 1),
            None if page is None else within(f"{what}.page", page, 0, 255),
            ACCESS[access],
            None if initial is None else within(f"{what}.initial", initial, 0, (1 << bits) - 1),
        )
        fields = table.get("fields", {})
        if not isinstance(fields, Mapping):
            raise WiringError(f'{what}.fields must be a table such as {{ gain = "11:9" }}, not {fields!r}')
        self.fields[name] = {key: _field(f"{what}.fields.{key}", value, bits) for key, value in fields.items()}


def _field(what: str, given: Any, width: int) -> tuple[int, int, bool]:
    """Return lowest bit, number of bits and sign of `7`, `"11:9"` or `{ bits = "11:9", signed = true }`."""
    signed = False
    if not _PLAIN_NAME.fullmatch(what.rpartition(".")[2]):
        raise WiringError(f"{what}: a field's name is made of letters, digits and _")
    if isinstance(given, Mapping):
        checked_table(what, given, FieldOptions.__annotations__, '{ bits = "11:9", signed = true }')
        signed, given = truth(f"{what}.signed", given.get("signed", False)), given.get("bits")
    return (*_bits_of(what, given, width), signed)


def _bits_of(what: str, given: Any, width: int) -> tuple[int, int]:
    """Return lowest bit and number of bits of `7` or `"11:9"`."""
    match = _BITS.fullmatch(str(given)) if isinstance(given, int | str) and not isinstance(given, bool) else None
    high, low = (int(match[1]), int(match[2] or match[1])) if match else (-1, 0)
    if not 0 <= low <= high < width:
        raise WiringError(f'{what}: bits are a number, or "HIGH:LOW", from {width - 1} to 0, not {given!r}')
    return low, high - low + 1

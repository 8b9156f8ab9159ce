"""The values that modbus_peer serves, and what a channel of the driver ought to read of them."""

from __future__ import annotations

import struct
from collections.abc import Callable

from umo.drivers.modbus.channel import ModbusChannel


def coil(i: int) -> int:
    return int(i % 3 == 0)


def discrete(i: int) -> int:
    return int(i % 7 < 3)


def holding(i: int) -> int:
    return i * 40503 & 0xFFFF


def input_register(i: int) -> int:
    return i * 25717 + 32768 & 0xFFFF


CELL = {"coil": coil, "discrete": discrete, "holding": holding, "input": input_register}


def value(channel: ModbusChannel, cell: Callable[[int], int], *, little: bool = False) -> int:
    """What a channel should read, by struct and not by the driver's own arithmetic."""
    if channel.cells == 2:
        words = cell(channel.address), cell(channel.address + 1)
        packed = struct.pack(">HH", *(reversed(words) if little else words))
        return int(struct.unpack(">i" if channel.signed else ">I", packed)[0])
    word = cell(channel.address)
    return int(struct.unpack(">h" if channel.signed else ">H", struct.pack(">H", word))[0])

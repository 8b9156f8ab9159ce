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
    words = [cell(channel.address + i) for i in range(channel.cells)]
    packed = struct.pack(f">{channel.cells}H", *(reversed(words) if little else words))
    if channel.scale:
        return round(struct.unpack(">f" if channel.cells == 2 else ">d", packed)[0] / channel.scale)
    code = {1: "h", 2: "i", 4: "q"}[channel.cells]
    return int(struct.unpack(">" + (code if channel.signed else code.upper()), packed)[0])

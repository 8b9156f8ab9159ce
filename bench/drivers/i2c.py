"""Registers of 8 bits of the kernel's i2c-stub, one by one and in blocks; by hand: smbus2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

from smbus2 import SMBus

from bench.drivers.case import Case, counted, cycle, split, without_clock
from tests.kernel.i2c_stub import i2c_bus
from umo.drivers.i2c import I2c
from umo.drivers.registers import driver as timed

NEEDS_KERNEL = True
OWN, HAND = 0x20, 0x48
WRITTEN = 0x80
"""The first register that is written; those that are read begin at 0."""
BLOCK = 32
_stubs: list[str] = []


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    without_clock(timed, stack)
    path = _bus(stack)
    for name, blocks in (("i2c, i2c-stub", False), ("i2c, i2c-stub, blocks", True)):
        driver = I2c(bus=path, address=OWN, auto_increment=blocks)
        stack.callback(driver.close)
        driver.open()
        inputs, outputs = split(channels)
        run = cycle(
            driver,
            [driver.channel(f"{address}:8") for address in range(inputs)],
            [driver.channel(f"{WRITTEN + i}:8") for i in range(outputs)],
        )
        with counted(I2c, "_get", "_put") as transfers:
            run()
        bus = stack.enter_context(SMBus(path))
        by_hand = (_by_blocks if blocks else _one_by_one)(bus, inputs, outputs)
        yield Case(name, "smbus2", channels, run, by_hand, len(transfers))


def _bus(stack: ExitStack) -> str:
    """One for all rows: the kernel has one i2c-stub."""
    if not _stubs:
        _stubs.append(stack.enter_context(i2c_bus(OWN, HAND)))
        stack.callback(_stubs.clear)
    return _stubs[0]


def _one_by_one(bus: SMBus, inputs: int, outputs: int) -> Callable[[], None]:
    def run() -> None:
        [bus.read_byte_data(HAND, address) for address in range(inputs)]
        for i in range(outputs):
            bus.write_byte_data(HAND, WRITTEN + i, 1)

    return run


def _by_blocks(bus: SMBus, inputs: int, outputs: int) -> Callable[[], None]:
    def run() -> None:
        values: list[int] = []
        for start in range(0, inputs, BLOCK):
            values += bus.read_i2c_block_data(HAND, start, min(BLOCK, inputs - start))
        for start in range(0, outputs, BLOCK):
            bus.write_i2c_block_data(HAND, WRITTEN + start, [1] * min(BLOCK, outputs - start))

    return run

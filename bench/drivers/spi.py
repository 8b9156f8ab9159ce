"""Registers of 8 bits on the kernel's spi-gpio, one by one and in blocks; by hand: spidev. The kernel moves each bit on
lines of gpio-sim, which takes most of the time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

from spidev import SpiDev

from bench.drivers.case import Case, counted, cycle, split, without_clock
from umo.drivers.registers import driver as timed
from umo.drivers.spi import Spi

NEEDS_KERNEL = True
READ, BURST = 0x80, 0x40
"""Bits of the command."""


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    without_clock(timed, stack)
    inputs, outputs = split(channels)
    for name, blocks in (("spi, spi-gpio", False), ("spi, spi-gpio, blocks", True)):
        driver = Spi(bus=0, auto_increment=blocks, burst_mask=BURST if blocks else 0)
        stack.callback(driver.close)
        driver.open()
        registers = [driver.channel(f"{address}:8") for address in range(max(inputs, outputs))]
        run = cycle(driver, registers[:inputs], registers[:outputs])
        with counted(Spi, "_get", "_put") as transfers:
            run()
        by_hand = (_by_blocks if blocks else _one_by_one)(_device(stack), inputs, outputs)
        yield Case(name, "spidev", channels, run, by_hand, len(transfers))


def _device(stack: ExitStack) -> SpiDev:
    device = SpiDev()
    device.open(0, 0)
    stack.callback(device.close)
    device.mode, device.bits_per_word, device.max_speed_hz = 0, 8, 1_000_000
    return device


def _one_by_one(device: SpiDev, inputs: int, outputs: int) -> Callable[[], None]:
    def run() -> None:
        [device.xfer2([READ | address, 0])[1] for address in range(inputs)]
        for address in range(outputs):
            device.xfer2([address, 1])

    return run


def _by_blocks(device: SpiDev, inputs: int, outputs: int) -> Callable[[], None]:
    def run() -> None:
        device.xfer2([READ | BURST, *[0] * inputs])[1:]
        device.xfer2([BURST, *[1] * outputs])

    return run

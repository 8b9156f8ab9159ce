"""Chips on an SPI bus: their registers and bits as channels, through Linux's spidev."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from typing import Literal

from umo.drivers._device_file import opening
from umo.drivers._library import library
from umo.drivers.option_checks import one_of, within
from umo.drivers.registers.driver import RegisterDriver
from umo.drivers.registers.map import RegisterChannel, RegisterOptions
from umo.errors import DriverError, WiringError
from umo.system.packages import how_to_install

_MAX_DUMMY_BYTES = 16
_TURNED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in the other order."""


class Spi(RegisterDriver):
    """One chip at a chip select of an SPI bus.

    Channels: a register of the wiring (`temperature`), a field or bits of one (`control.gain`, `control.7`,
    `control.11:9`), or a register by its address, width and byte order: `0x05:16:big`, `0x05:16:little:signed`.

    Options:
        bus, chip_select: /dev/spidevBUS.CHIP_SELECT.
        mode: 0 to 3; bit 1 is the idle level of the clock, bit 0 the edge at which data are taken (1: the second).
        max_speed_hz: highest frequency of the clock.
        bits_per_word: word of the controller; the bits on the wire are the same with 8, 16 and 32.
        lsb_first: the chip has the lowest bit of each byte first. umo reverses the bits, because most controllers
            cannot.
        registers: the chip's registers by name (docs/driver-spi.md).
        page_register: the register of 8 bits that selects the page, for registers with `page`.
        auto_increment: the chip counts its addresses in bytes and continues to the next one by itself. Consecutive
            registers are then transferred together, up to 256 bytes at a time.
        address_bits: width of the command with the address; 0 for a chip that only answers (its register is at 0).
        address_shift: bits by which the address is shifted to the left in the command.
        read_mask, write_mask, burst_mask: bits that are set in the command of a read, in the command of a write, and in
            both commands if they have more than one byte.
        dummy_bytes: bytes between the command of a read and its answer. Negative: the answer begins this number of
            bytes before the command ends.
        identity: registers with the values that they must have when the bus is opened, such as { who_am_i = 0x33 }.
        setup: registers or fields with the values that are written in this order when the bus is opened: the chip's
            configuration. They are also written when the bus is opened again after a failure, so outputs of the machine
            must not be among them.

    A transfer is a command, and then data, under one chip select. SPI has no acknowledgement: a chip that is not there
    reads as all zeros or all ones. Only `identity` detects this, and only when the bus is opened. `timeout` is observed
    between two transfers: a call ends within `timeout` plus the time of one transfer.

    Source: the kernel's Documentation/spi/spidev.rst.
    """

    max_block_size = 256

    def __init__(
        self,
        *,
        bus: int,
        chip_select: int = 0,
        mode: Literal[0, 1, 2, 3] = 0,
        max_speed_hz: int = 1_000_000,
        bits_per_word: Literal[8, 16, 32] = 8,
        lsb_first: bool = False,
        registers: dict[str, RegisterOptions] | None = None,
        page_register: int | None = None,
        auto_increment: bool = False,
        address_bits: Literal[0, 8, 16, 24] = 8,
        address_shift: int = 0,
        read_mask: int = 0x80,
        write_mask: int = 0,
        burst_mask: int = 0,
        dummy_bytes: int = 0,
        identity: dict[str, int] | None = None,
        setup: dict[str, int] | None = None,
    ) -> None:
        one_of("mode", mode, (0, 1, 2, 3))
        one_of("address_bits", address_bits, (0, 8, 16, 24))
        one_of("bits_per_word", bits_per_word, (8, 16, 32))
        self.path = f"/dev/spidev{within('bus', bus, 0, 65535)}.{within('chip_select', chip_select, 0, 255)}"
        self._settings: dict[str, int] = {"mode": mode, "bits_per_word": bits_per_word}
        self._settings["max_speed_hz"] = within("max_speed_hz", max_speed_hz, 1, 1_000_000_000)
        self._word, self._lsb_first = bits_per_word // 8, lsb_first
        self._command = address_bits // 8
        highest = (1 << address_bits) - 1
        masks = {"read_mask": read_mask, "write_mask": write_mask, "burst_mask": burst_mask}
        if not address_bits:
            masks["read_mask"] = 0
        self._masks = {name: within(name, mask, 0, highest) for name, mask in masks.items()}
        self._shift = within("address_shift", address_shift, 0, max(address_bits - 1, 0))
        self._dummies = within("dummy_bytes", dummy_bytes, -self._command, _MAX_DUMMY_BYTES)
        self._spidev = library("spidev", "spidev")
        super().__init__(registers or {}, page_register, auto_increment, identity or {}, setup or {}, address_bits)

    def channel(self, text: str) -> RegisterChannel:
        """Return the channel with this text. The address of the channel must fit into the command next to the masks."""
        channel = super().channel(text)
        register = channel.register
        last = register.address + (register.size - 1 if self._auto_increment else 0)
        for address in (register.address, last):
            for name, mask in self._masks.items():
                if address << self._shift & mask:
                    raise WiringError(f"{text}: the address {address:#04x} overlaps {name} = {mask:#x}")
            if address << self._shift >> 8 * self._command:
                raise WiringError(f"{text}: the address {address:#04x} does not fit a command of {self._command} bytes")
        return channel

    def devices(self) -> Iterable[str]:
        """Return the device file of the chip select."""
        return [f"spi {os.path.realpath(self.path)}"]

    def _connect(self) -> None:
        if self._spidev is None:
            raise DriverError(f"the spi driver needs spidev: {how_to_install('spi')} (it needs a C compiler)")
        self._bus = self._spidev.SpiDev()
        with opening(self.path):
            self._bus.open_path(self.path)
        os.set_inheritable(self._bus.fileno(), False)  # opened in C: a child process would hold the device
        for name, value in self._settings.items():
            try:
                setattr(self._bus, name, value)
            except OSError as error:
                text = f"the controller of {self.path} refuses {name} = {value} ({error.strerror})"
                raise DriverError(text) from error

    def _get(self, address: int, size: int) -> bytes:
        start = self._command + self._dummies
        sent = self._framed(address, "read_mask", size).ljust(start + size, b"\0")
        return self._exchange(sent)[start : start + size]

    def _put(self, address: int, data: bytes) -> None:
        self._exchange(self._framed(address, "write_mask", len(data)) + data)

    def _framed(self, address: int, mask: str, size: int) -> bytes:
        """Return the bytes of the command: direction, burst and address."""
        burst = self._masks["burst_mask"] if size > 1 else 0
        return (address << self._shift | self._masks[mask] | burst).to_bytes(self._command, "big")

    def _exchange(self, sent: bytes) -> bytes:
        """Transfer whole words once."""
        if len(sent) % self._word:
            raise DriverError(
                f"a transfer of {len(sent)} bytes does not consist of whole words of {8 * self._word} bits"
            )
        if self._lsb_first:
            sent = sent.translate(_TURNED)
        answer = _swapped(bytes(self._bus.xfer2(list(_swapped(sent, self._word)))), self._word)
        return answer.translate(_TURNED) if self._lsb_first else answer


def _swapped(data: bytes, word: int) -> bytes:
    """Return the data with the bytes of each word in the order of the processor, as the kernel requires. On the wire
    the highest bit is first."""
    if word == 1 or sys.byteorder == "big":
        return data
    return b"".join(data[i : i + word][::-1] for i in range(0, len(data), word))

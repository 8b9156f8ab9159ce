"""Chips on an I2C bus or SMBus: their registers and bits as channels, through Linux's i2c-dev."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from math import ceil
from pathlib import Path
from typing import Any, Literal

from umo.drivers._device_file import opening
from umo.drivers._library import library
from umo.drivers.option_checks import one_of, within
from umo.drivers.registers.driver import RegisterDriver
from umo.drivers.registers.map import RegisterChannel, RegisterOptions
from umo.errors import DriverError, WiringError
from umo.system.packages import how_to_install

SYSFS = Path("/sys/bus/i2c/devices")
_I2C_TIMEOUT = 0x0702  # linux/i2c-dev.h: in units of 10 ms
_NO_ANSWER = (errno.ENODEV, errno.ENXIO, errno.EREMOTEIO, errno.EIO)
_UNABLE = (errno.EOPNOTSUPP, errno.EINVAL)


class I2c(RegisterDriver):
    """One chip at an address of an I2C bus.

    Channels: a register of the wiring (`temperature`), a field or bits of one (`control.gain`, `control.7`,
    `control.11:9`), or a register by its address, width and byte order: `0x05:16:big`, `0x05:16:little:signed`.

    Options:
        bus, address: number or path of the bus (1, "/dev/i2c-1") and the chip's address of 7 bits, 0x08 to 0x77.
        registers: the chip's registers by name (docs/driver-i2c.md).
        page_register: the register of 8 bits that selects the page, for registers with `page`.
        auto_increment: the chip counts its addresses in bytes and continues to the next one by itself. Consecutive
            registers are then transferred together, up to 32 bytes at a time.
        address_bits: width of a register's address; 0 for a chip without registers (its only one is at address 0).
        identity: registers with the values that they must have when the bus is opened, such as { who_am_i = 0x33 }.
        setup: registers or fields with the values that are written in this order when the bus is opened: the chip's
            configuration. They are also written when the bus is opened again after a failure, so outputs of the machine
            must not be among them.
        pec: use the checksums of SMBus, for registers of 8 and 16 bits.

    `timeout` is observed between two transfers. If another device holds the bus, a transfer ends when the adapter gives
    up. The adapter's timeout is set to that of the driver, in steps of 10 ms, and applies to all users of the bus. So a
    call ends within twice `timeout` plus 10 ms. After a failed transfer the next call opens the bus again.

    Sources: NXP UM10204 (I2C), the kernel's Documentation/i2c/dev-interface.rst and smbus-protocol.rst.
    """

    def __init__(
        self,
        *,
        bus: int | str,
        address: int,
        registers: dict[str, RegisterOptions] | None = None,
        page_register: int | None = None,
        auto_increment: bool = False,
        address_bits: Literal[0, 8, 16] = 8,
        identity: dict[str, int] | None = None,
        setup: dict[str, int] | None = None,
        pec: bool = False,
    ) -> None:
        one_of("address_bits", address_bits, (0, 8, 16))
        if isinstance(bus, str) and not bus.startswith("/"):
            raise WiringError(f'bus must be a number or a path such as "/dev/i2c-1", not {bus!r}')
        if not isinstance(bus, str):
            within("bus", bus, 0, 1_000_000)
        self.path = bus if isinstance(bus, str) else f"/dev/i2c-{bus}"
        self.address = within("address (7 bits, without the bit for reading)", address, 0x08, 0x77)
        self._pec, self._address_bits = pec, address_bits
        if pec and (auto_increment or address_bits != 8):
            raise WiringError("pec is for registers moved one by one, with addresses of 8 bits")
        self._smbus = library("smbus2", "smbus2")
        self._limit = 0.0
        self._messages = False
        self._blocks = False
        super().__init__(registers or {}, page_register, auto_increment, identity or {}, setup or {}, address_bits)

    def channel(self, text: str) -> RegisterChannel:
        channel = super().channel(text)
        if self._pec and channel.register.bits > 16:
            raise WiringError(f"{text} has {channel.register.bits} bits; pec is for registers of 8 and 16 bits")
        return channel

    def devices(self) -> Iterable[str]:
        """Return the bus and the address of the chip."""
        return [f"i2c {os.path.realpath(self.path)} address {self.address:#04x}"]

    def _connect(self) -> None:
        if self._smbus is None:
            raise DriverError(f"the i2c driver needs smbus2: {how_to_install('i2c')}")
        self._check_free()
        functions = self._smbus.I2cFunc
        bus = self._bus = self._smbus.SMBus()
        with opening(self.path):
            _open(bus, self.path)
            _set_timeout(bus, self.timeout)
        if self._pec:
            if not bus.funcs & functions.SMBUS_PEC:
                raise DriverError(f"the adapter of {self.path} has no pec")
            bus.enable_pec()
        self._limit = self.timeout
        self._messages = bool(bus.funcs & functions.I2C) and not self._pec
        self._blocks = bool(bus.funcs & functions.SMBUS_READ_I2C_BLOCK)

    def _begin(self) -> None:
        super()._begin()
        if self._limit != self.timeout:  # it is longer while objects are initialised and reset
            with opening(self.path):
                _set_timeout(self._bus, self.timeout)
            self._limit = self.timeout

    def _check_free(self) -> None:
        """Raise DriverError if a driver of the kernel uses the chip, because it could change the state of the chip."""
        number = os.path.basename(os.path.realpath(self.path)).removeprefix("i2c-")
        link = SYSFS / f"{number}-{self.address:04x}" / "driver"
        try:
            owner = os.path.basename(os.readlink(link))
        except OSError:
            return
        unbind = f"echo {link.parent.name} > {link}/unbind"
        raise DriverError(f"address {self.address:#04x} of {self.path} is in use by the kernel's {owner} ({unbind})")

    def _get(self, address: int, size: int) -> bytes:
        bus, chip = self._bus, self.address
        if self._messages:
            i2c_msg = self._smbus.i2c_msg
            answer = i2c_msg.read(chip, size)
            if self._address_bits:
                bus.i2c_rdwr(i2c_msg.write(chip, self._start_of(address)), answer)
            else:
                bus.i2c_rdwr(answer)
            return bytes(answer)
        if not self._address_bits and size == 1:
            return bytes([bus.read_byte(chip)])
        self._check_smbus()
        if size == 1:
            return bytes([bus.read_byte_data(chip, address)])
        if self._is_word(size):
            return bytes(bus.read_word_data(chip, address).to_bytes(2, "little"))
        return bytes(bus.read_i2c_block_data(chip, address, size))

    def _put(self, address: int, data: bytes) -> None:
        bus, chip = self._bus, self.address
        if self._messages:
            bus.i2c_rdwr(self._smbus.i2c_msg.write(chip, self._start_of(address) + data))
        elif not self._address_bits and len(data) == 1:
            bus.write_byte(chip, data[0])
        else:
            self._check_smbus()
            if len(data) == 1:
                bus.write_byte_data(chip, address, data[0])
            elif self._is_word(len(data)):
                bus.write_word_data(chip, address, int.from_bytes(data, "little"))
            else:
                bus.write_i2c_block_data(chip, address, list(data))

    def _start_of(self, address: int) -> bytes:
        return address.to_bytes(self._address_bits // 8, "big")

    def _is_word(self, size: int) -> bool:
        """Return True if the value is transferred as a word of SMBus. On the wire this is the same as a block of two
        bytes, the low byte first."""
        return size == 2 and not (self._auto_increment and self._blocks)

    def _check_smbus(self) -> None:
        if self._address_bits != 8:
            raise OSError(errno.EOPNOTSUPP, "")

    def _explained(self, error: OSError) -> str:
        if error.errno in _NO_ANSWER:
            return f"nothing answers at address {self.address:#04x} of {self.path} ({error.strerror})"
        if error.errno == errno.EBADMSG:
            return "the checksum (pec) is wrong"
        if error.errno in _UNABLE:
            return f"the adapter of {self.path} cannot make this transfer ({error.strerror or 'it knows SMBus only'})"
        return super()._explained(error)


def _open(bus: Any, path: str) -> None:
    try:
        bus.open(path)
    except OSError as error:
        if error.errno == errno.ENOTTY:
            raise DriverError(f"{path} is not an I2C bus") from None
        raise


def _set_timeout(bus: Any, seconds: float) -> None:
    """Set the timeout of the adapter."""
    from fcntl import ioctl

    ioctl(bus.fd, _I2C_TIMEOUT, max(1, ceil(seconds * 100)))

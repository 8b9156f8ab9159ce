"""The SPI driver on a fake spidev; tests/kernel/test_spi.py runs it on the kernel's spi-gpio."""

from __future__ import annotations

import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from umo.drivers import spi
from umo.drivers.spi import Spi
from umo.errors import DriverError, WiringError

needs_spidev = pytest.mark.skipif(
    spi.library("spidev", "spidev") is None, reason="needs spidev, which pip builds with a C compiler"
)


class Device:
    """A chip with 128 registers of a byte. Bit 7 of the command reads, its other bits are the address."""

    refuses = ""
    error = 0

    def __init__(self, memory=None):
        self.sent, self.is_open, self.answer, self.descriptor = [], False, None, -1
        self.memory = bytearray(128) if memory is None else memory

    def open_path(self, path):
        self.is_open, self.descriptor = True, os.open(os.devnull, os.O_RDONLY)
        os.set_inheritable(self.descriptor, True)  # as open(2) in C leaves it

    def fileno(self):
        return self.descriptor

    def close(self):
        if self.is_open:
            os.close(self.descriptor)
        self.is_open = False

    def __setattr__(self, name, value):
        if name == self.refuses:
            raise OSError(22, "Invalid argument")
        super().__setattr__(name, value)

    def xfer2(self, data):
        if self.error:
            raise OSError(self.error, os.strerror(self.error))
        self.sent = [*self.sent[-20:], bytes(data)]
        if self.answer is not None:
            return list(self.answer)
        address, size = data[0] & 0x7F, len(data) - 1
        if data[0] & 0x80:
            return [0xFF, *self.memory[address : address + size]]
        self.memory[address : address + size] = bytes(data[1:])
        return [0xFF] * len(data)


@pytest.fixture
def device(monkeypatch):
    device = Device()
    monkeypatch.setattr(spi, "library", lambda *_: SimpleNamespace(SpiDev=lambda: device))
    return device


def opened(**options):
    driver = Spi(**{"bus": 0} | options)
    driver.open()
    return driver


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": 4}, "mode must be one of 0, 1, 2, 3, not 4"),
        ({"bus": -1}, "bus must be a whole number"),
        ({"chip_select": "0"}, "chip_select must be a whole number"),
        ({"bits_per_word": 9}, "bits_per_word must be one of 8, 16, 32"),
        ({"address_bits": 7}, "address_bits must be one of 0, 8, 16, 24"),
        ({"max_speed_hz": 0}, "max_speed_hz"),
        ({"read_mask": 0x100}, "read_mask must be a whole number from 0 to 255"),
        ({"dummy_bytes": -2}, "dummy_bytes must be a whole number from -1 to 16"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(WiringError, match=message):
        Spi(**{"bus": 0} | options)


@pytest.mark.parametrize(
    ("options", "text", "message"),
    [
        ({}, "0x80:8", "the address 0x80 overlaps read_mask = 0x80"),
        ({"auto_increment": True}, "0x7f:16", "the address 0x80 overlaps read_mask"),
        ({"burst_mask": 0x40}, "0x40:8", "overlaps burst_mask"),
        ({"address_shift": 2, "read_mask": 1}, "0x40:8", "does not fit a command of 1 bytes"),
    ],
)
def test_an_address_that_does_not_fit_the_command_is_refused(options, text, message):
    with pytest.raises(WiringError, match=message):
        Spi(bus=0, **options).channel(text)


def test_the_hold_is_of_a_chip_select():
    assert Spi(bus=0).devices() != Spi(bus=0, chip_select=1).devices()


def test_without_spidev_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr(spi, "library", lambda *_: None)
    with pytest.raises(DriverError, match=r'pip install "\.\[spi\]" in the clone of umo \(it needs a C compiler\)'):
        Spi(bus=0).open()


@needs_spidev
def test_a_device_that_is_not_there_is_an_error_of_one_line():
    with pytest.raises(DriverError, match=r"^there is no device /dev/spidev250\.0[^\n]*$"):
        Spi(bus=250).open()


def test_a_setting_that_the_controller_refuses_leaves_nothing_open(device):
    device.refuses = "mode"
    with pytest.raises(DriverError, match=r"the controller of /dev/spidev0\.0 refuses mode = 3"):
        opened(mode=3)
    assert not device.is_open


def test_no_child_process_inherits_the_device(device):
    driver = opened()
    assert not os.get_inheritable(device.fileno())
    driver.close()


def test_a_transfer_is_a_command_and_data_under_one_chip_select(device):
    driver = opened(auto_increment=True, burst_mask=0x40)
    device.answer = b"\xff\x12\x34\x56\x78"
    out = np.zeros(2, np.int64)
    driver.read_many((driver.channel("0x06:16:little"), driver.channel("0x04:16")), out)
    assert out.tolist() == [0x7856, 0x1234]
    device.answer = b"\xff\xff"
    driver.write(driver.channel("0x04:8"), 0xAB)
    assert device.sent == [bytes.fromhex("c4 0000 0000"), bytes.fromhex("04 ab")]


def test_what_is_written_is_read(device):
    driver = opened()
    driver.write(driver.channel("5:16"), 0x1234)
    assert driver.read(driver.channel("5:16")) == 0x1234
    assert device.memory[5:7] == b"\x12\x34"


@pytest.mark.parametrize(
    ("options", "text", "sent", "answer"),
    [
        ({"dummy_bytes": 1}, "0x0b:8", "8b 00 00", "ff ff 2a"),  # fast read
        ({"address_bits": 0}, "0:16", "00 00", "00 2a"),  # MAX6675: it only answers
        ({"address_bits": 16, "read_mask": 0x4100, "write_mask": 0x4000}, "0x12:8", "41 12 00", "ff ff 2a"),  # MCP23S17
        ({"address_bits": 16, "read_mask": 0x0180, "address_shift": 4, "dummy_bytes": -1}, "3:16.9:0",
         "01 b0 00", "ff fc 2a"),  # MCP3008
        ({"address_shift": 1}, "0x37:8", "ee 00", "ff 2a"),  # MFRC522
    ],
)  # fmt: skip
def test_the_commands_of_known_chips(device, options, text, sent, answer):
    driver = opened(**options)
    device.answer = bytes.fromhex(answer)
    assert driver.read(driver.channel(text)) == 0x2A
    assert device.sent == [bytes.fromhex(sent)]


@pytest.mark.skipif(sys.byteorder == "big", reason="words and bytes have one order on this computer")
def test_longer_words_have_the_same_bits_on_the_wire(device):
    driver = opened(bits_per_word=16, address_bits=16, read_mask=0x8000)
    device.answer = bytes.fromhex("ffff 3412")
    assert driver.read(driver.channel("0x0102:16")) == 0x1234
    assert device.sent == [bytes.fromhex("0281 0000")]
    with pytest.raises(DriverError, match="3 bytes does not consist of whole words of 16 bits"):
        driver.read(driver.channel("0x0102:8"))


def test_a_chip_with_the_lowest_bit_first_is_sent_its_bytes_turned_round(device):
    """doceme/py-spidev#49, dotnet/iot#592: the controller of a Raspberry Pi refuses the mode."""
    driver = opened(lsb_first=True)
    device.answer = [0xFF, 0x01, 0x80]
    assert driver.read(driver.channel("0x05:16")) == 0x8001
    assert device.sent[-1] == bytes([0xA1, 0, 0])  # 0x85
    device.answer = [0xFF, 0xFF, 0xFF]
    driver.write(driver.channel("0x05:16"), 0x0102)
    assert device.sent[-1] == bytes([0xA0, 0x80, 0x40])

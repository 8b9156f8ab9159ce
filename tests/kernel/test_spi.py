"""The SPI driver on the kernel's spi-gpio, whose lines are those of a simulated chip.

What is proved: every level that the master drives (clock, data, chip select) is recorded by the kernel's trace of its
GPIO lines and decoded here as a slave decodes it. Of the slave's answers only all zeros and all ones are there: nothing
in the test kernel drives MISO bit by bit. Answers with other bits are tried on a fake (tests/drivers/test_spi.py).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from umo.drivers import spi
from umo.drivers.spi import Spi
from umo.errors import DriverError
from umo.testing.conformance import Input, Output, Subject

from .gpio_sim import Trace, fixed
from .proof import proved

if spi.library("spidev", "spidev") is None:
    pytest.skip("needs spidev, which pip builds with a C compiler", allow_module_level=True)

SCK, MOSI, MISO, CS = 2, 3, 4, 5


class Wire:
    """The bus as seen by a slave: the bytes of each transfer under one chip select, by the edges of the clock."""

    def __init__(self, mode: int, trace: Trace) -> None:
        self.mode = mode
        self._trace = trace
        self.samples = 0
        """How often the master took the level of MISO, in the last `transfers`."""

    def transfers(self) -> list[bytes]:
        """Since the last call. Data are taken at the first edge of the clock (phase 0) or at the second one."""
        polarity, phase = self.mode >> 1, self.mode & 1
        taken_at = polarity if phase else 1 - polarity
        clock, data, bits, found = polarity, 0, "", []
        selected = False
        events = self._trace.taken()
        self.samples = sum(line == MISO and what[:3] == "get" for line, what in events)
        for line, what in events:
            if what[:3] != "set":
                continue
            level = int(what[-1])
            if line == CS:
                if selected and level == 1:
                    found.append(bits)
                selected, bits = level == 0, ""
            elif line == MOSI:
                data = level
            elif line == SCK and level != clock:
                clock = level
                if selected and level == taken_at:
                    bits += str(data)
        return [int(bits, 2).to_bytes(len(bits) // 8, "big") for bits in found if bits]


@pytest.fixture
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    with Trace("fixed") as trace:
        yield Wire(getattr(request, "param", 0), trace)
    fixed(MISO).pull(0)


def opened(**options: Any) -> Spi:
    driver = Spi(bus=0, **options)
    driver.open()
    return driver


@pytest.mark.parametrize("wire", [0, 1, 2, 3], indirect=True)
def test_a_write_sends_its_command_and_data_in_every_mode(wire: Wire) -> None:
    driver = opened(mode=wire.mode, write_mask=0x40)
    wire.transfers()
    driver.write(driver.channel("0x2a:16"), 0x1234)
    driver.close()
    assert wire.transfers() == [bytes.fromhex("6a 12 34")]


@pytest.mark.parametrize("level", [0, 1])
def test_a_read_takes_the_level_of_the_line(wire: Wire, level: int) -> None:
    fixed(MISO).pull(level)
    driver = opened(dummy_bytes=1)
    wire.transfers()
    assert driver.read(driver.channel("0x05:16:big:signed")) == -level
    assert wire.transfers() == [bytes.fromhex("85 00 0000")]
    assert wire.samples == 32
    driver.close()


def test_registers_that_follow_each_other_are_one_transfer(wire: Wire) -> None:
    driver = opened(auto_increment=True, burst_mask=0x40)
    wire.transfers()
    channels = tuple(map(driver.channel, ("0x12:8", "0x10:16:little", "0x13:8")))
    driver.write_many(channels, np.array([3, 0x0201, 4], np.int64))
    assert wire.transfers() == [bytes.fromhex("50 01 02 03 04")]
    driver.read_many(channels, np.zeros(3, np.int64))
    assert wire.transfers() == [bytes.fromhex("d0 00000000")]
    driver.close()


def test_two_fields_of_a_register_are_one_transfer(wire: Wire) -> None:
    control = {"address": 0x20, "bits": 8, "initial": 0x80, "fields": {"on": 0, "gain": "3:1"}}
    driver = opened(registers={"control": control})
    wire.transfers()
    driver.write_many((driver.channel("control.on"), driver.channel("control.gain")), np.array([1, 5], np.int64))
    assert wire.transfers() == [bytes.fromhex("20 8b")]
    driver.close()


def test_longer_words_have_the_same_bits_on_the_wire(wire: Wire) -> None:
    driver = opened(bits_per_word=16, address_bits=16, read_mask=0x8000)
    wire.transfers()
    driver.write(driver.channel("0x0102:16"), 0xA55A)
    assert wire.transfers() == [bytes.fromhex("0102 a55a")]
    driver.close()


def test_an_absent_chip_is_found_by_its_identity(wire: Wire) -> None:
    fixed(MISO).pull(1)
    with pytest.raises(DriverError, match="who is 0xff in place of 0x33: no device, or another device"):
        opened(registers={"who": {"address": 0x0F, "access": "r"}}, identity={"who": 0x33})


def test_a_device_that_may_not_be_opened_is_an_error_of_one_line() -> None:
    os.seteuid(65534)
    try:
        with pytest.raises(DriverError, match=r"^no permission to open /dev/spidev0\.0[^\n]*$"):
            opened()
    finally:
        os.seteuid(0)


def test_a_device_that_is_not_there_is_named_with_those_that_are() -> None:
    driver = Spi(bus=3)
    with pytest.raises(DriverError, match=r"no device /dev/spidev3\.0.*; there are: /dev/spidev0\.0"):
        driver.open()


def test_the_driver_keeps_the_contract(wire: Wire) -> None:
    """The levels of its outputs are those that went over the wire."""
    registers = {
        "dac": {"address": 0x10, "bits": 16, "access": "w"},
        "mode": {"address": 0x20, "access": "w", "initial": 0x40, "fields": {"on": 0, "gain": "3:1"}},
        "status": {"address": 0x30, "access": "r"},
    }
    chip = Spi(bus=0, registers=registers)
    memory = bytearray(128)

    def levels(text: str) -> list[int]:
        """At the last look, and after each write since."""
        channel = chip.channel(text)
        register = channel.register
        place = slice(register.address, register.address + register.size)
        found = [channel.decode(register.unpack(memory[place]))]
        for sent in wire.transfers():
            if not sent[0] & 0x80:
                memory[sent[0] : sent[0] + len(sent) - 1] = sent[1:]
                found.append(channel.decode(register.unpack(memory[place])))
        return found

    subject = Subject(
        name="spi",
        make=lambda: Spi(bus=0, registers=registers),
        sole_writer=True,
        outputs=(Output("dac", 0x0102, 0, 0xFFFF), Output("mode.on", 1, 0, 1), Output("mode.gain", 2, 0, 7)),
        inputs=(Input("status"),),
        device="spi-gpio of the kernel, its lines recorded",
        levels=levels,
    )
    proved(subject)

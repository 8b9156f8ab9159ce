"""The I2C driver on a fake smbus2; tests/kernel/test_i2c.py runs it on the kernel's i2c-stub."""

from __future__ import annotations

import errno
import os
from collections import deque
from types import SimpleNamespace

import pytest

from helpers.machines import bench
from umo import check
from umo.drivers import i2c
from umo.drivers.i2c import I2c
from umo.errors import DeviceTimeout, DriverError, WiringError

FUNCS = SimpleNamespace(I2C=1, SMBUS_PEC=8, SMBUS_READ_I2C_BLOCK=0x04000000)


class Message:
    """A message of a combined transaction, as smbus2's i2c_msg."""

    def __init__(self, chip, size, data=b""):
        self.chip, self.size, self.data = chip, size, bytes(data)

    @classmethod
    def read(cls, chip, size):
        return cls(chip, size)

    @classmethod
    def write(cls, chip, data):
        return cls(chip, 0, data)

    def __bytes__(self):
        return self.data


class Bus:
    """A bus with one chip of 256 bytes at 0x48, which counts its addresses in bytes."""

    funcs = FUNCS.I2C
    error = 0
    opened = 0
    refused = -1
    """An address that the chip does not have."""

    def __init__(self, memory=None):
        self.fd, self.pec, self.log, self.pointer, self.limits = None, False, [], 0, deque(maxlen=20)
        self.memory = bytearray(256) if memory is None else memory

    def open(self, path):
        self.opened += 1
        self.fd = os.open(os.devnull, os.O_RDWR)

    def close(self):
        if self.fd is not None:
            os.close(self.fd)
        self.fd = None

    def enable_pec(self):
        if not self.funcs & FUNCS.SMBUS_PEC:
            raise OSError("SMBUS_PEC is not a feature")
        self.pec = True

    def i2c_rdwr(self, *messages):
        self._log("messages", *[message.size or message.data for message in messages])
        for message in messages:
            assert message.chip == 0x48
            if message.size:
                message.data = bytes(self.memory[self.pointer : self.pointer + message.size])
            elif message.data:
                self.pointer = message.data[0]
                if self.pointer == self.refused:
                    raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
                self.memory[self.pointer : self.pointer + len(message.data) - 1] = message.data[1:]

    def read_byte(self, chip):
        self._log("read_byte")
        return self.memory[0]

    def write_byte(self, chip, value):
        self._log("write_byte", value)
        self.memory[0] = value

    def read_byte_data(self, chip, address):
        self._log("read_byte_data", address)
        return self.memory[address]

    def read_word_data(self, chip, address):
        self._log("read_word_data", address)
        return int.from_bytes(self.memory[address : address + 2], "little")

    def read_i2c_block_data(self, chip, address, size):
        self._log("read_i2c_block_data", address, size)
        return list(self.memory[address : address + size])

    def write_byte_data(self, chip, address, value):
        self._log("write_byte_data", address)
        self.memory[address] = value

    def write_word_data(self, chip, address, value):
        self._log("write_word_data", address)
        self.memory[address : address + 2] = value.to_bytes(2, "little")

    def write_i2c_block_data(self, chip, address, data):
        self._log("write_i2c_block_data", address, len(data))
        self.memory[address : address + len(data)] = bytes(data)

    def _log(self, *what):
        self.log = [*self.log[-20:], what]
        if self.error:
            raise OSError(self.error, os.strerror(self.error))


@pytest.fixture
def bus(monkeypatch):
    bus = Bus()
    library = SimpleNamespace(I2cFunc=FUNCS, SMBus=lambda: bus, i2c_msg=Message)
    monkeypatch.setattr(i2c, "library", lambda *_: library)
    monkeypatch.setattr(i2c, "_set_timeout", lambda bus, seconds: bus.limits.append(seconds))
    yield bus
    bus.close()


def opened(**options):
    driver = I2c(**{"bus": 1, "address": 0x48} | options)
    driver.open()
    return driver


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bus": "i2c-1"}, r'must be a number or a path such as "/dev/i2c-1"'),
        ({"bus": -1}, "bus must be a whole number"),
        ({"address": 0x90}, r"address \(7 bits, without the bit for reading\) must be a whole number from 8 to 119"),
        ({"address": True}, "address"),
        ({"address_bits": 12}, "address_bits must be one of 0, 8, 16"),
        ({"pec": True, "auto_increment": True}, "pec is for registers moved one by one"),
        ({"page_register": 256}, "page_register must be a whole number from 0 to 255"),
        ({"setup": {"0x10:8": "1"}}, r"setup\.0x10:8 must be a whole number from 0 to 255, not '1'"),
        ({"identity": {"0x10:8": 1.5}}, r"identity\.0x10:8 must be a whole number from 0 to 255, not 1\.5"),
        ({"registers": {"x": {"address": 256}}}, r"registers\.x\.address"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(WiringError, match=message):
        I2c(**{"bus": 1, "address": 0x48} | options)


def test_the_hold_is_of_a_bus_and_an_address(tmp_path):
    (tmp_path / "i2c-7").touch()
    (tmp_path / "adc").symlink_to(tmp_path / "i2c-7")
    one, other = (I2c(bus=str(tmp_path / name), address=0x48) for name in ("adc", "i2c-7"))
    assert one.devices() == other.devices()
    assert one.devices() != I2c(bus=str(tmp_path / "adc"), address=0x49).devices()


def test_a_file_that_is_no_bus_is_refused_and_left_closed():
    pytest.importorskip("smbus2")
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(DriverError, match="/dev/null is not an I2C bus"):
        I2c(bus="/dev/null", address=0x48).open()
    assert len(os.listdir("/proc/self/fd")) == before


def test_without_smbus2_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr(i2c, "library", lambda *_: None)
    with pytest.raises(DriverError, match=r'pip install "\.\[i2c\]" in the clone of umo'):
        I2c(bus=1, address=0x48).open()


def test_an_address_that_a_driver_of_the_kernel_has_is_refused(tmp_path, monkeypatch, bus):
    (tmp_path / "1-0048").mkdir()
    (tmp_path / "lm75").mkdir()
    (tmp_path / "1-0048" / "driver").symlink_to(tmp_path / "lm75")
    monkeypatch.setattr(i2c, "SYSFS", tmp_path)
    with pytest.raises(DriverError, match="address 0x48 of /dev/i2c-1 is in use by the kernel's lm75"):
        opened()
    assert bus.fd is None


def test_a_register_is_read_in_one_transaction_with_a_repeated_start(bus):
    driver = opened()
    bus.memory[5:7] = b"\x12\x34"
    assert driver.read(driver.channel("5:16")) == 0x1234
    driver.write(driver.channel("5:16:little"), 0x1234)
    assert bus.log == [("messages", b"\x05", 2), ("messages", b"\x05\x34\x12")]


def test_addresses_of_registers_may_have_two_bytes_or_none(bus):
    wide = opened(address_bits=16)
    wide.write(wide.channel("0x0102:8"), 7)
    wide.close()
    none = opened(address_bits=0)
    none.write(none.channel("0:8"), 9)
    none.read(none.channel("0:24"))
    assert bus.log == [("messages", b"\x01\x02\x07"), ("messages", b"\x09"), ("messages", 3)]


def test_an_adapter_of_smbus_moves_bytes_words_and_blocks(bus):
    bus.funcs = FUNCS.SMBUS_READ_I2C_BLOCK
    bus.memory[5:8] = b"\x01\x02\x03"
    driver = opened()
    assert [driver.read(driver.channel(text)) for text in ("5:8", "5:16", "5:24")] == [1, 0x0102, 0x010203]
    for text in ("5:8", "5:16", "5:24"):
        driver.write(driver.channel(text), 7)
    assert [name for name, *_ in bus.log] == [
        "read_byte_data",
        "read_word_data",
        "read_i2c_block_data",
        "write_byte_data",
        "write_word_data",
        "write_i2c_block_data",
    ]
    assert bus.memory[5:8] == b"\0\0\x07"


def test_with_auto_increment_a_word_is_a_block_of_two_bytes_where_the_adapter_has_blocks(bus):
    bus.funcs = FUNCS.SMBUS_READ_I2C_BLOCK
    driver = opened(auto_increment=True)
    driver.read(driver.channel("5:16"))
    driver.close()
    bus.funcs = 0
    driver.open()
    driver.read(driver.channel("5:16"))
    assert bus.log == [("read_i2c_block_data", 5, 2), ("read_word_data", 5)]


def test_pec_uses_the_transfers_of_smbus_and_needs_an_adapter_that_has_it(bus):
    with pytest.raises(DriverError, match="has no pec"):
        opened(pec=True)
    assert bus.fd is None
    bus.funcs = FUNCS.I2C | FUNCS.SMBUS_PEC
    driver = opened(pec=True)
    driver.read(driver.channel("5:16"))
    assert bus.pec and bus.log == [("read_word_data", 5)]
    with pytest.raises(WiringError, match="pec is for registers of 8 and 16 bits"):
        driver.channel("5:24")


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENXIO, r"reading 0x05: nothing answers at address 0x48 of /dev/i2c-1 \(No such device or address\)"),
        (errno.EREMOTEIO, "nothing answers at address 0x48"),
        (errno.ENODEV, "nothing answers at address 0x48"),
        (errno.EBADMSG, r"the checksum \(pec\) is wrong"),
        (errno.EOPNOTSUPP, "the adapter of /dev/i2c-1 cannot make this transfer"),
        (errno.EAGAIN, "reading 0x05: Resource temporarily unavailable"),
    ],
)
def test_a_failed_transfer_says_what_is_wrong(bus, number, message):
    driver = opened()
    bus.error = number
    with pytest.raises(DriverError, match=message):
        driver.read(driver.channel("5:16"))


def test_a_bus_that_is_held_is_a_timeout(bus):
    driver = opened()
    bus.error = errno.ETIMEDOUT
    with pytest.raises(DeviceTimeout, match="the bus is held"):
        driver.read(driver.channel("5:16"))


def test_the_adapter_has_the_timeout_of_the_call(bus):
    driver = I2c(bus=1, address=0x48)
    for timeout in (3.0, 0.05, 0.05):
        driver.timeout = timeout
        driver.open() if timeout == 3.0 else driver.read(driver.channel("5:8"))
    assert list(bus.limits) == [3.0, 0.05]


def test_a_mistake_in_a_register_of_a_wiring_has_its_line(tmp_path):
    file = tmp_path / "chip.toml"
    file.write_text(
        '[drivers.chip]\ntype = "i2c"\nbus = 1\naddress = 0x48\n'
        "[drivers.chip.registers]\ntemperature = { address = 5 }\nlimit = { adress = 6 }\n"
        '[wire]\n"motor" = { driver = "chip", channel = "limit" }\n'
    )
    told = [str(each) for each in check(bench(), file)]
    assert told[0].startswith(
        f"{file}:7: drivers.chip.registers.limit.adress: unknown key (did you mean 'address'?); known: address, bits"
    )

"""Register maps, and what the drivers of I2C and SPI have in common: blocks, bit fields, pages, identity, failures."""

from __future__ import annotations

import errno
import os
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.drivers import ChannelError, ChannelsFailed, DeviceTimeout, Direction, DriverError, WiringError
from umo.drivers.registers.blocks import plan
from umo.drivers.registers.driver import RegisterDriver
from umo.drivers.registers.map import WIDTHS, ChipRegisters, RegisterChannel

TABLES: dict[str, dict[str, Any]] = {
    "who": {"address": 0x0F, "access": "r"},
    "control": {
        "address": 0x20,
        "bits": 16,
        "fields": {"on": 0, "gain": "3:1", "trim": {"bits": "7:4", "signed": True}},
    },
    "temperature": {"address": 0x05, "bits": 16, "signed": True, "shift": 4, "access": "r"},
    "command": {"address": 0x30, "access": "w", "initial": 0x40, "fields": {"go": 7}},
    "mute": {"address": 0x31, "access": "w"},
}


def table(tables: dict[str, dict[str, Any]] = TABLES, **options: Any) -> ChipRegisters:
    return ChipRegisters(tables, **{"address_bits": 8, "paged": False, "bytewise": False} | options)


class Chip(RegisterDriver):
    """A chip in memory that counts its addresses in bytes, and the transfers on its bus."""

    def __init__(
        self,
        registers: dict[str, dict[str, Any]] = TABLES,
        page_register: int | None = None,
        auto_increment: bool = True,
        identity: dict[str, int] | None = None,
        setup: dict[str, int] | None = None,
    ) -> None:
        super().__init__(registers, page_register, auto_increment, identity or {}, setup or {}, 8)
        self.memory = bytearray(256)
        self.pages: dict[int, bytearray] = {}
        self.log: list[tuple[str, int, int]] = []
        self.failing: dict[int, OSError] = {}
        self.connections = 0

    def _connect(self) -> None:
        self.connections += 1
        self._bus = BytesIO()

    def _now(self) -> bytearray:
        page = None if self._page_register is None else self.memory[self._page_register]
        return self.memory if page is None else self.pages.setdefault(page, bytearray(256))

    def _get(self, address: int, size: int) -> bytes:
        self._log("read", address, size)
        return bytes(self._now()[address : address + size])

    def _put(self, address: int, data: bytes) -> None:
        self._log("write", address, len(data))
        memory = self.memory if address == self._page_register else self._now()
        memory[address : address + len(data)] = data

    def _log(self, what: str, address: int, size: int) -> None:
        self.log.append((what, address, size))
        if address in self.failing:
            raise self.failing[address]


def opened(chip: Chip) -> Chip:
    chip.open()
    chip.log.clear()
    return chip


def many(chip: Chip, *texts: str) -> list[int]:
    out = np.zeros(len(texts), np.int64)
    chip.read_many(tuple(map(chip.channel, texts)), out)
    return out.tolist()


def put(chip: Chip, **raws: int) -> None:
    names = [name.replace("__", ".") for name in raws]
    chip.write_many(tuple(map(chip.channel, names)), np.array(list(raws.values()), np.int64))


# The map ------------------------------------------------------------------------------------------


def test_a_channel_is_a_register_a_field_or_bits_of_it():
    registers = table()
    found = {text: registers.channel(text) for text in ("temperature", "control.gain", "control.9", "control.15:8")}
    assert [(each.bits, each.signed, each.low, each.whole) for each in found.values()] == [
        (12, True, 4, True),
        (3, False, 1, False),
        (1, False, 9, False),
        (8, False, 8, False),
    ]
    assert found["temperature"].direction is Direction.INPUT
    assert registers.channel("control.trim").lowest == -8


def test_a_channel_may_be_a_register_that_has_no_name():
    channel = table().channel("0x05:16:little:signed")
    assert (channel.register.address, channel.bits, channel.signed) == (5, 16, True)
    assert channel.register.byte_order == "little"
    assert table().channel("5:24").register.byte_order == "big"
    assert table().channel("0x12:8.3").low == 3


@pytest.mark.parametrize(
    "text",
    ["contrl", "control.gian", "control.16", "control.1:3", "0x05", "0x05:12", "0x100:8", "5:16:middle", "", "."],
)
def test_a_wrong_channel_is_refused_with_the_valid_forms(text):
    with pytest.raises(WiringError) as refused:
        table().channel(text)
    if isinstance(refused.value, ChannelError):
        assert "the forms are: " in str(refused.value)


@pytest.mark.parametrize(
    ("register", "message"),
    [
        ({"bits": 8}, r"registers\.x\.address is missing"),
        ({"address": 256}, r"registers\.x\.address must be a whole number from 0 to 255, not 256"),
        ({"address": 1, "bits": 12}, r"registers\.x\.bits must be one of 8, 16, .*, 64, not 12"),
        ({"address": 1, "byte_order": "middle"}, r"'big', 'little', not 'middle'"),
        ({"address": 1, "adress": 2}, r"unknown key 'adress' \(did you mean 'address'\?\)"),
        ({"address": 1, "shift": 8}, r"registers\.x\.shift must be a whole number from 0 to 7"),
        ({"address": 1, "signed": 1}, r"registers\.x\.signed must be true or false"),
        ({"address": 1, "page": 0}, r"needs the driver's option page_register"),
        ({"address": 1, "access": "ro"}, r"'r', 'w', 'rw', not 'ro'"),
        ({"address": 1, "initial": 256}, r"registers\.x\.initial"),
        ({"address": 1, "fields": {"a": "8:7"}}, r"registers\.x\.fields\.a: bits are a number"),
        ({"address": 1, "fields": {"a": True}}, r"registers\.x\.fields\.a: bits are a number"),
        ({"address": 1, "fields": {"1": 1}}, r"a field's name"),
        ({"address": 1, "fields": {"a": {"bit": 1}}}, r"unknown key 'bit' \(did you mean 'bits'\?\)"),
        ({"address": 1, "fields": 7}, r"fields must be a table"),
        ({"address": True}, r"registers\.x\.address must be a whole number"),
    ],
)
def test_a_wrong_register_is_refused_with_what_is_wrong(register, message):
    with pytest.raises(WiringError, match=message):
        table({"x": register})


def test_a_register_that_is_no_table_is_refused():
    with pytest.raises(WiringError, match=r"registers\.x must be a table"):
        table({"x": 5})


def test_a_field_of_a_register_that_cannot_be_read_needs_its_initial_value():
    assert table().channel("command.go").bits == 1
    with pytest.raises(WiringError, match="needs `initial`"):
        table().channel("mute.3")


def test_fields_of_one_register_are_two_places_and_a_field_is_within_its_register():
    registers = table()
    places = {text: set(registers.channel(text).places) for text in ("control.on", "control.gain", "control")}
    assert not places["control.on"] & places["control.gain"]
    assert places["control.on"] | places["control.gain"] < places["control"]
    assert places["control.on"] == set(registers.channel("0x20:16.0").places)


def test_registers_that_share_a_byte_share_places_where_the_chip_counts_bytes():
    bytewise = table(bytewise=True)
    assert set(bytewise.channel("0x05:16").places) & set(bytewise.channel("0x06:8").places)
    words = table()
    assert not set(words.channel("0x05:16").places) & set(words.channel("0x06:16").places)


# Coding -------------------------------------------------------------------------------------------


@st.composite
def channels_and_raws(draw: st.DrawFn) -> tuple[RegisterChannel, int]:
    bits = draw(st.sampled_from(WIDTHS))
    signed = draw(st.booleans())
    register = {"address": 0, "bits": bits, "byte_order": draw(st.sampled_from(["big", "little"]))}
    if draw(st.booleans()):
        low = draw(st.integers(0, bits - 1))
        high = draw(st.integers(low, bits - 1))
        register["fields"] = {"part": {"bits": f"{high}:{low}", "signed": signed}}
        channel = table({"x": register}).channel("x.part")
    else:
        channel = table({"x": register | {"signed": signed, "shift": draw(st.integers(0, bits - 1))}}).channel("x")
    return channel, draw(st.integers(channel.lowest, channel.highest))


@given(channels_and_raws(), st.binary(min_size=8, max_size=8))
def test_what_is_written_is_read_and_the_other_bits_stay(placed, before):
    channel, raw = placed
    register = channel.register
    contents = register.unpack(before[: register.size])
    after = register.unpack(register.pack(channel.encode(raw, contents)))
    assert channel.decode(after) == raw
    if not channel.whole:
        mask = (1 << channel.bits) - 1 << channel.low
        assert (after ^ contents) & ~mask == 0


@given(st.binary(min_size=2, max_size=2), st.sampled_from(["big", "little"]), st.booleans())
def test_byte_order_and_sign_are_those_of_the_wiring(data, order, signed):
    channel = table().channel(f"0:16:{order}{':signed' if signed else ''}")
    assert channel.decode(channel.register.unpack(data)) == int.from_bytes(data, order, signed=signed)


def test_a_value_beyond_int64_is_an_error_of_its_channel():
    channel = table().channel("0:64")
    with pytest.raises(DriverError, match="9223372036854775808 does not fit 0:64"):
        channel.decode(1 << 63)


@pytest.mark.parametrize(
    ("text", "raw"), [("control.gain", 8), ("control.gain", -1), ("control.trim", -9), ("0:8", 256)]
)
def test_a_raw_value_that_does_not_fit_is_refused_before_anything_is_sent(text, raw):
    chip = opened(Chip())
    with pytest.raises(DriverError, match="does not fit"):
        chip.write_many((chip.channel("control.on"), chip.channel(text)), np.array([1, raw], np.int64))
    assert chip.log == []


def test_a_register_that_can_only_be_read_is_not_written():
    chip = opened(Chip())
    with pytest.raises(DriverError, match="temperature is an input"):
        chip.write(chip.channel("temperature"), 1)


# Blocks -------------------------------------------------------------------------------------------


def test_registers_that_follow_each_other_are_read_in_one_transfer():
    chip = opened(Chip())
    chip.memory[0x05:0x09] = bytes.fromhex("fff0 1234")
    assert many(chip, "0x07:16", "temperature", "0x08:8", "0x0a:8") == [0x1234, -1, 0x34, 0]
    assert chip.log == [("read", 0x05, 4), ("read", 0x08, 1), ("read", 0x0A, 1)]


def test_without_auto_increment_each_register_is_a_transfer():
    chip = opened(Chip(auto_increment=False))
    many(chip, "0x05:16", "0x07:16")
    assert chip.log == [("read", 0x05, 2), ("read", 0x07, 2)]


def test_a_block_is_no_longer_than_the_bus_allows():
    chip = opened(Chip())
    many(chip, *(f"{address}:8" for address in range(80)))
    assert [size for _, _, size in chip.log] == [32, 32, 16]


def test_registers_that_follow_each_other_are_written_in_one_transfer():
    chip = opened(Chip(registers={}))
    chip.write_many((chip.channel("0x12:16:little"), chip.channel("0x10:16")), np.array([0x0201, 0x0304], np.int64))
    assert chip.log == [("write", 0x10, 4)]
    assert chip.memory[0x10:0x14] == bytes.fromhex("0304 0102")


@given(st.lists(st.tuples(st.integers(0, 40), st.sampled_from(WIDTHS)), max_size=12, unique=True), st.booleans())
def test_every_channel_is_in_one_block_and_gets_its_own_value(registers, joined):
    chip = opened(Chip(registers={}, auto_increment=joined))
    chip.memory[:] = bytes(range(128)) * 2
    texts = [f"{address}:{bits}" for address, bits in registers]
    expected = [int.from_bytes(chip.memory[address : address + bits // 8], "big") for address, bits in registers]
    assert many(chip, *texts) == expected
    blocks = plan([chip.channel(text) for text in texts], joined=joined, max_size=32)
    assert sorted(i for block in blocks for part in block.parts for i, _ in part.channels) == list(range(len(texts)))


@st.composite
def like_channels(draw):
    """Channels on neighbouring registers of one width, byte order and sign, in any order."""
    bits, order = draw(st.sampled_from((8, 16, 32, 64))), draw(st.sampled_from(["big", "little"]))
    sign = ":signed" if bits == 64 or draw(st.booleans()) else ""
    number = draw(st.integers(1, 32 * 8 // bits))
    texts = [f"{3 + i * bits // 8}:{bits}:{order}{sign}" for i in range(number)]
    if draw(st.booleans()):
        texts = draw(st.permutations(texts))
    return [table({}, bytewise=True).channel(text) for text in texts]


@given(like_channels(), st.data())
def test_like_registers_convert_all_at_once_as_they_do_one_by_one(channels, data):
    (block,) = plan(channels, joined=True, max_size=32)
    received = data.draw(st.binary(min_size=block.size, max_size=block.size))
    out = np.zeros(len(channels), np.int64)
    block.like.decode(received, out)
    expected = {}
    for register, start, ((i, channel),), _ in block.parts:
        expected[i] = channel.decode(register.unpack(received[start : start + register.size]))
    assert dict(enumerate(out.tolist())) == expected
    raws = [data.draw(st.integers(each.lowest, each.highest)) for each in channels]
    sent = [part.register.pack(channel.encode(raws[i], 0)) for part in block.parts for i, channel in part.channels]
    assert block.like.encode(raws) == b"".join(sent)


@pytest.mark.parametrize(
    "texts",
    [
        ("4:8", "5:8:signed"),
        ("4:16:big", "6:16:little"),
        ("4:8", "5:16"),
        ("4:24", "7:24"),
        ("4:64", "12:64"),
        ("4:8", "5:8.3"),
        ("5:8.3",),
        ("4:8", "5:8", "5:8.3"),
        ("aligned",),
    ],
)
def test_registers_that_differ_or_have_parts_are_converted_one_by_one(texts):
    registers = table({"aligned": {"address": 4, "bits": 16, "shift": 4}}, bytewise=True)
    (block,) = plan([registers.channel(text) for text in texts], joined=True, max_size=32)
    assert block.like is None


# Bit fields ---------------------------------------------------------------------------------------


def test_two_fields_of_a_register_go_out_in_one_transfer_and_leave_its_other_bits():
    chip = opened(Chip())
    chip.memory[0x20:0x22] = bytes.fromhex("a5ff")
    put(chip, control__on=0, control__trim=-2)
    assert chip.memory[0x20:0x22] == bytes.fromhex("a5ee")
    assert chip.log == [("read", 0x20, 2), ("write", 0x20, 2)]


def test_the_register_is_read_before_its_first_write_only():
    chip = opened(Chip())
    put(chip, control__on=1)
    chip.log.clear()
    put(chip, control__gain=5)
    assert chip.log == [("write", 0x20, 2)]
    assert chip.memory[0x21] == 0b1011


@st.composite
def writes(draw):
    """Some channels on four bytes of a chip, each with a value."""
    found = {}
    for _ in range(draw(st.integers(1, 8))):
        size = draw(st.integers(1, 4))
        text = f"{draw(st.integers(0, 4 - size))}:{8 * size}:{draw(st.sampled_from(['big', 'little']))}"
        if draw(st.booleans()):
            low = draw(st.integers(0, 8 * size - 1))
            text += f".{draw(st.integers(low, 8 * size - 1))}:{low}"
        channel = table({}, bytewise=True).channel(text)
        found[text] = draw(st.integers(channel.lowest, channel.highest))
    return found


@given(writes(), st.binary(min_size=4, max_size=4))
def test_a_write_changes_the_bits_of_its_channel_and_no_others(levels, before):
    """Also after writes to other registers on the same bytes."""
    chip = opened(Chip({}))
    chip.memory[:4] = before
    for text, raw in levels.items():
        channel = chip.channel(text)
        old = bytes(chip.memory[:4])
        chip.write(channel, raw)
        assert chip.read(channel) == raw
        changed = {(None, i, bit) for i in range(4) for bit in range(8) if (old[i] ^ chip.memory[i]) >> bit & 1}
        assert changed <= set(channel.places)


@pytest.mark.parametrize("auto_increment", [False, True])
def test_two_names_of_one_register_know_of_each_other(auto_increment):
    tables = {"first": {"address": 4, "fields": {"a": 0}}, "second": {"address": 4, "signed": True, "fields": {"b": 1}}}
    chip = opened(Chip(tables, auto_increment=auto_increment))
    for levels in ({"first__a": 1, "second__b": 1}, {"first__a": 0}, {"second__b": 1, "first__a": 1}):
        put(chip, **levels)
        assert chip.memory[4] == 2 + levels["first__a"]


def test_the_initial_value_stands_for_a_register_that_cannot_be_read():
    chip = opened(Chip())
    put(chip, command__go=1)
    assert chip.memory[0x30] == 0xC0
    assert chip.log == [("write", 0x30, 1)]


def test_a_second_connection_begins_with_what_the_register_holds():
    chip = opened(Chip())
    put(chip, control__on=1)
    chip.close()
    chip.memory[0x20:0x22] = bytes.fromhex("ff00")
    chip.open()
    put(chip, control__gain=1)
    assert chip.memory[0x20:0x22] == bytes.fromhex("ff02")


def test_the_unused_bits_of_a_value_aligned_to_the_left_are_written_as_zero():
    chip = opened(Chip({"dac": {"address": 0x40, "bits": 16, "shift": 4}}))
    chip.memory[0x40:0x42] = b"\xff\xff"
    put(chip, dac=0xABC)
    assert chip.memory[0x40:0x42] == bytes.fromhex("abc0")
    assert chip.log == [("write", 0x40, 2)]


# Pages --------------------------------------------------------------------------------------------

PAGED: dict[str, dict[str, Any]] = {
    "a": {"address": 1, "page": 0},
    "b": {"address": 2, "page": 0},
    "c": {"address": 1, "page": 3, "fields": {"on": 0}},
}


def test_a_page_is_selected_once_in_a_call():
    chip = opened(Chip(PAGED, page_register=0x7F))
    put(chip, a=1, b=2, c=3)
    assert chip.pages[0][1:3] == b"\x01\x02"
    assert chip.pages[3][1] == 3
    assert chip.log == [("write", 0x7F, 1), ("write", 1, 2), ("write", 0x7F, 1), ("write", 1, 1)]


def test_a_block_stays_within_its_page():
    tables = {"a": {"address": 1, "page": 0}, "b": {"address": 2, "page": 1}}
    chip = opened(Chip(tables, page_register=0x7F))
    put(chip, a=1, b=2)
    assert (chip.pages[0][1:3], chip.pages[1][1:3]) == (b"\x01\0", b"\0\x02")


def test_a_page_is_selected_in_every_call_as_the_chip_may_have_been_reset():
    chip = opened(Chip(PAGED, page_register=0x7F))
    put(chip, c=3)
    chip.memory[0x7F] = 0
    assert many(chip, "c.on") == [1]


def test_a_page_that_could_not_be_selected_fails_its_channels_and_no_others():
    chip = opened(Chip(PAGED | {"free": {"address": 9}}, page_register=0x7F))
    chip.failing[0x7F] = OSError(errno.EIO, os.strerror(errno.EIO))
    with pytest.raises(ChannelsFailed) as failed:
        many(chip, "a", "free", "c")
    assert set(failed.value.causes) == {"a", "c"}


# Failures -----------------------------------------------------------------------------------------


def test_a_register_that_fails_leaves_the_others():
    chip = opened(Chip())
    chip.memory[0x0F] = 7
    chip.failing[0x05] = OSError(errno.EIO, "no answer")
    out = np.zeros(2, np.int64)
    with pytest.raises(ChannelsFailed) as failed:
        chip.read_many((chip.channel("temperature"), chip.channel("who")), out)
    assert failed.value.causes == {"temperature": "reading 0x05: no answer"}
    assert out[1] == 7


def test_after_a_failure_the_next_call_opens_the_bus_again():
    chip = opened(Chip())
    chip.failing[0x0F] = OSError(errno.EIO, "no answer")
    with pytest.raises(DriverError, match="reading 0x0f: no answer"):
        chip.read(chip.channel("who"))
    assert chip.connections == 1
    chip.failing.clear()
    assert chip.read(chip.channel("who")) == 0
    assert chip.connections == 2


def test_a_timeout_of_the_bus_is_one_of_the_call():
    chip = opened(Chip())
    chip.failing[0x05] = TimeoutError(errno.ETIMEDOUT, "timed out")
    with pytest.raises(DeviceTimeout, match="reading 0x05"):
        many(chip, "temperature", "who")
    assert chip.log == [("read", 0x05, 2)]


def test_a_call_does_not_begin_a_transfer_after_its_timeout():
    chip = opened(Chip())
    chip.timeout = -1.0
    with pytest.raises(DeviceTimeout, match="timed out"):
        chip.read_many((chip.channel("who"), chip.channel("control")), np.zeros(2, np.int64))
    assert len(chip.log) == 1


def test_an_answer_that_is_too_short_is_an_error():
    chip = opened(Chip())
    chip._get = lambda address, size: b""
    with pytest.raises(DriverError, match="0 bytes in place of 1"):
        chip.read(chip.channel("who"))


def test_a_driver_that_is_not_open_transfers_nothing():
    chip = Chip()
    with pytest.raises(DriverError, match="not open"):
        chip.read(chip.channel("who"))
    chip.open()
    chip.close()
    with pytest.raises(DriverError, match="not open"):
        chip.write(chip.channel("control"), 1)


def test_the_identity_is_compared_when_the_bus_is_opened():
    chip = Chip(identity={"who": 0x33})
    with pytest.raises(DriverError, match="who is 0x0 in place of 0x33: no device, or another device"):
        chip.open()
    chip.memory[0x0F] = 0x33
    chip.open()
    assert chip.connections == 2


def test_an_identity_that_cannot_be_read_is_refused():
    with pytest.raises(WiringError, match="command cannot be read"):
        Chip(identity={"command": 1})
    with pytest.raises(ChannelError):
        Chip(identity={"whom": 1})


def test_the_setup_is_written_in_its_order_when_the_bus_is_opened():
    chip = Chip(setup={"mute": 1, "control.gain": 5, "control.on": 1})
    chip.memory[0x20:0x22] = bytes.fromhex("8000")
    chip.open()
    assert chip.memory[0x20:0x22] == bytes.fromhex("800b")
    assert chip.log == [("write", 0x31, 1), ("read", 0x20, 2), ("write", 0x20, 2), ("write", 0x20, 2)]


def test_a_chip_that_was_lost_gets_its_setup_again():
    chip = opened(Chip(setup={"mute": 1}))
    chip.memory[0x31] = 0
    chip.failing[0x0F] = OSError(errno.EIO, "no answer")
    for _ in range(2):
        with pytest.raises(DriverError):
            chip.read(chip.channel("who"))
    assert chip.memory[0x31] == 1


def test_a_setup_that_cannot_be_written_is_refused():
    with pytest.raises(WiringError, match=r"setup\.mute must be a whole number from 0 to 255, not 256"):
        Chip(setup={"mute": 256})
    with pytest.raises(WiringError, match="setup: who cannot be written"):
        Chip(setup={"who": 1})

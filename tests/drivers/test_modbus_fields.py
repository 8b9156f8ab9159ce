"""Bits and fields of Modbus registers, and the orders of a value's bytes: against libmodbus (its floats in four orders,
function 22), a server and the conversions of pymodbus, and arithmetic on whole numbers."""

from __future__ import annotations

import asyncio
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from helpers.opened_modbus import Start, opened, read, starting, write
from helpers.peers.modbus_device import PATIENT
from helpers.peers.modbus_map import holding
from helpers.tiers import first
from umo import BinaryActuator, BinarySensor, Compound, DigitalSensor, check, connect
from umo.drivers.contract import Direction
from umo.drivers.modbus import Modbus
from umo.drivers.modbus import driver as modbus
from umo.drivers.modbus import unit as unit_module
from umo.drivers.modbus.answer import Refused
from umo.drivers.modbus.channel import ORDERS, SINGLE_ORDERS, parse
from umo.drivers.modbus.plan import Request, plan_reads, plan_writes
from umo.errors import ChannelsFailed, DriverError
from umo.states import OnOff
from umo.testing import periods

pytest.importorskip("pymodbus")
FLOATS = 480  # of modbus_peer: 238.7 in the four orders


@pytest.fixture
def start() -> Iterator[Start]:
    with starting() as start:
        yield start


# Orders of bytes ----------------------------------------------------------------------------------------


def test_each_order_reads_and_writes_a_float_as_libmodbus_does_in_one_of_its_orders(start: Start) -> None:
    """libmodbus names them by the bytes in memory or on the line, depending on its version and the processor
    (stephane/libmodbus#358, #665, #757): which of its four it is, is not asked here."""
    of = {True: "little", False: "big"}
    read_in, written_in = set(), set()
    for order, (little, swapped) in ORDERS.items():
        driver, peer = start()
        places = [read_one(driver, f"input:{FLOATS + 2 * i}:float32:0.1:{order}") for i in range(4)]
        assert places.count(2387) == 1
        place = FLOATS + 2 * places.index(2387)
        read_in.add(place)
        write(driver, {f"holding:4:float32:0.1:{order}": 1234})
        (seen,) = peer.floats()
        right = [i for i, each in enumerate(seen) if each == pytest.approx(123.4, rel=1e-6)]
        assert len(right) == 1
        written_in.update(right)
        other, _ = start(word_order=of[little], byte_order=of[swapped])
        assert read(other, f"input:{place}:float32:0.1") == [2387], "the options say the same as the channel"
    assert len(read_in) == len(written_in) == 4


def read_one(driver: Modbus, text: str) -> int | None:
    """The raw integer of a channel; None if its registers hold none."""
    try:
        return driver.read(driver.channel(text))
    except ChannelsFailed:
        return None


@pytest.mark.parametrize("kind", ["uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64"])
def test_every_type_has_its_bytes_in_the_order_that_the_letters_say(kind: str) -> None:
    code = {"uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "uint64": "Q", "int64": "q"}
    code |= {"float32": "f", "float64": "d"}
    size = struct.calcsize(code[kind])
    number = 0x1234_5678 if "32" in kind else 0x1234 if "16" in kind else 0x12_3456_789A_BCDE
    number = 12_345 if "float" in kind else -number if kind[0] == "i" else number
    packed = struct.pack(f">{code[kind]}", number)
    for order in SINGLE_ORDERS if size == 2 else ORDERS:
        pairs = [packed[i : i + 2] for i in range(0, size, 2)]
        pairs = pairs[::-1] if order[0] in "CD" else pairs  # the low word first
        line = b"".join(pair[::-1] if order in ("BADC", "DCBA", "BA") else pair for pair in pairs)
        words = list(struct.unpack(f">{size // 2}H", line))
        channel = parse(f"holding:0:{kind}{':1' if 'float' in kind else ''}:{order}")
        assert channel.words(number) == words
        assert channel.raw(words) == number
        assert f"{order} {number} (wired)" in channel.in_each_order(words)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**64 - 1), st.sampled_from(["big", "little"]))
def test_wider_values_are_those_of_pymodbus_in_both_orders_of_words(contents: int, order: str) -> None:
    from pymodbus.client.mixin import ModbusClientMixin as Client

    words = [contents >> shift & 0xFFFF for shift in (48, 32, 16, 0)]
    for kind in ("uint16", "int16", "uint32", "int32", "int64"):
        channel = parse(f"input:0:{kind}", little=order == "little")
        theirs = Client.convert_from_registers(words[: channel.cells], Client.DATATYPE[kind.upper()], order)  # type: ignore[arg-type]
        assert channel.raw(words[: channel.cells]) == theirs


def test_a_value_without_a_raw_integer_is_told_in_every_order_of_its_bytes() -> None:
    channel = parse("input:0:float32:0.1")
    words = [0x0000 | 0x7FC0, 0x436E]
    with pytest.raises(DriverError, match=r"ABCD nan \(wired\), CDAB 238\.\d+, BADC .*, DCBA "):
        channel.raw(words)


METER = """
from umo import Compound, DigitalSensor


class Meter(Compound):
    voltage: DigitalSensor
    raw: DigitalSensor


def machine():
    return Meter(
        voltage=DigitalSensor("V", minimum=0.0, maximum=400.0, resolution=0.1),
        raw=DigitalSensor("count", minimum=0.0, maximum=65535.0, resolution=1.0),
    )
"""


@pytest.mark.parametrize(
    ("order", "off_cycle", "status"), first(1, [(":CDAB", True, 0), (":CDAB", False, 0), ("", False, 1)])
)
def test_umo_get_shows_the_registers_in_each_order_side_by_side(
    umo: Any, tmp_path: Path, order: str, off_cycle: bool, status: int
) -> None:
    """Also where the wired order gives no number that could be read."""
    (tmp_path / "wiring").mkdir()
    (tmp_path / "objects.py").write_text(METER)
    with pymodbus_server([0, 0x9E37, 0x6E43, 0x33B3]) as port:
        (tmp_path / "wiring" / "meter.toml").write_text(
            f'[drivers.meter]\ntype = "modbus"\nport = {port}\ntimeout = "1 s"\n'
            + 'off_cycle = true\nperiod = "100 ms"\n' * off_cycle
            + f'[wire]\n"voltage" = {{ driver = "meter", channel = "holding:2:float32:0.1{order}" }}\n'
            '"raw" = { driver = "meter", channel = "holding:1" }\n'
        )
        result = umo("device", "get", ".", "voltage", "raw", "--wiring", "meter")
        text = " ".join(result.output.split())
        assert result.exit_code == status, text
        if status:
            assert "by the order of bytes: ABCD 1.510302e+28 (wired), CDAB 8.355394e-08, BADC 238.7, DCBA" in text
            return
        assert "holding registers 2 to 3: 6E43 33B3; by the order of bytes: ABCD 1.510302e+28, CDAB" in text
        assert "(wired), BADC 238.7, DCBA" in text
        assert "holding register 1: 9E37; by the order of bytes: AB 40503 (wired), BA 14238" in text


# Fields, as arithmetic ----------------------------------------------------------------------------------


@st.composite
def fields(draw: st.DrawFn) -> tuple[str, str, int, int, bool]:
    """A channel of a whole value, one of a field in it, the field's bits and whether it has a sign."""
    bits = draw(st.sampled_from([16, 32, 64]))
    order = draw(st.sampled_from([*(SINGLE_ORDERS if bits == 16 else ORDERS)]))
    signed = draw(st.booleans())
    low = draw(st.integers(0, bits - 2))
    high = draw(st.integers(low + signed, bits - 1))
    whole = f"holding:{draw(st.integers(0, 5))}:uint{bits}:{order}"
    return whole, f"{'holding' + whole[7:].replace('u', '' if signed else 'u', 1)}.{high}:{low}", high, low, signed


@settings(max_examples=40, deadline=None)
@given(fields(), st.lists(st.integers(0, 0xFFFF), min_size=9, max_size=9), st.data())
def test_a_field_is_these_bits_of_the_whole_value(
    given_: tuple[str, str, int, int, bool], registers: list[int], data: st.DataObject
) -> None:
    whole, text, high, low, signed = given_
    channel, value, width = parse(text), parse(whole), high - low + 1
    contents = int(value.number(registers[value.address : value.end]))
    out = np.zeros(1, np.int64)
    expected = contents >> low & (1 << width) - 1
    expected -= (1 << width) if signed and expected >> (width - 1) else 0
    (request,) = plan_reads([channel])
    if expected < 2**63:
        request.decode(registers[request.address : request.address + request.count], out)
        assert out[0] == expected
    raw = data.draw(st.integers(channel.lowest, channel.highest))
    (request,) = plan_writes([channel])
    cells = request.completed(request.encode([raw]), dict(enumerate(registers)))
    changed = [*registers[: request.address], *cells, *registers[request.address + request.count :]]
    mask = (1 << width) - 1 << low
    assert int(value.number(changed[value.address : value.end])) == contents & ~mask | (raw << low & mask)
    beside = [i for i in range(9) if not value.address <= i < value.end]
    assert [changed[i] for i in beside] == [registers[i] for i in beside]


def test_bits_of_one_register_are_places_of_their_own_and_overlap_with_it() -> None:
    def places(text: str) -> set[Any]:
        return set(parse(text).places)

    assert not places("holding:3.1") & places("holding:3.2")
    for other in ("holding:3", "holding:3.4:0", "holding:2:uint32", "holding:3:BA.9", "holding:2:uint32.1"):
        assert places("holding:3.1") & places(other), other
    assert not places("holding:3.1") & places("holding:2:uint32.17")
    assert not places("holding:3.1") & places("input:3.1")


# Requests -----------------------------------------------------------------------------------------------


def test_fields_of_one_register_are_one_transfer(start: Start) -> None:
    driver, peer = start()
    texts = ["holding:5.3", "holding:6", "holding:5.15:8", "holding:5.0", "holding:4:int16"]
    word = holding(5)
    assert read(driver, *texts) == [word >> 3 & 1, holding(6), word >> 8, word & 1, holding(4)]
    assert peer.requests() == [(3, 4, 3)]
    write(driver, {"holding:5.3": 0, "holding:6": 7, "holding:5.15:8": 0x12, "holding:5.0": 1})
    wanted = word & 0x00F6 | 0x1201
    assert peer.requests()[1:] == [(3, 5, 1), (16, 5, 2, wanted, 7)]
    write(driver, {"holding:5.3": 1, "holding:5.0": 0})
    driver.write(driver.channel("holding:5.1"), 1)
    wanted = wanted & ~1 | 8
    assert peer.requests()[3:] == [(6, 5, 1, wanted), (6, 5, 1, wanted | 2)], "it is known, and not read again"


def test_all_bits_of_a_register_are_written_without_reading_it(start: Start) -> None:
    driver, peer = start()
    write(driver, {"holding:5.15:4": 0xABC, "holding:5.3:0": 0xD})
    assert peer.requests() == [(6, 5, 1, 0xABCD)]


def test_function_22_writes_the_bits_alone(start: Start) -> None:
    driver, peer = start(mask_write=True)
    write(driver, {"holding:5.3": 0, "holding:6": 7, "holding:5.15:8": 0x12, "holding:7": 8, "holding:8:BA.9": 1})
    driver.write(driver.channel("holding:5.0"), 1)
    assert peer.requests() == [
        (22, 5, 0x00F7, 0x1200),
        (16, 6, 2, 7, 8),
        (22, 8, 0xFFFD, 0x0002),
        (22, 5, 0xFFFE, 0x0001),
    ]
    assert read(driver, "holding:5") == [holding(5) & 0x00F6 | 0x1201]
    assert driver.channel("holding:5:uint32.17:3").direction is Direction.INPUT, "it lies in two registers"
    assert driver.channel("holding:5:uint32.17:16").direction is Direction.BOTH


@pytest.mark.parametrize("fault", ["echo=8", "echo=9", "echo=10", "echo=13"])
def test_an_answer_to_function_22_that_confirms_something_else_is_an_error(start: Start, fault: str) -> None:
    driver, _ = start(f"1:{fault}", mask_write=True)
    with pytest.raises(DriverError, match="the answer confirms address"):
        driver.write(driver.channel("holding:5.0"), 1)


def test_a_field_that_the_unit_reads_back_otherwise_fails_and_bits_beside_it_do_not(start: Start) -> None:
    driver, _ = start("2:refuses=257", read_write=True)  # 0x0101
    with pytest.raises(ChannelsFailed) as caught:
        write(driver, {"holding:0.0": 1, "holding:0.1": 1, "holding:3": 1})
    assert list(caught.value.causes) == ["holding:0.1"]


def test_a_register_is_read_again_after_the_connection_was_lost(start: Start) -> None:
    driver, peer = start("3:close")
    bit = driver.channel("holding:5.3")
    driver.write(bit, 1)
    with pytest.raises(DriverError):
        driver.write(bit, 0)
    driver.write(bit, 0)
    word = holding(5)
    assert [each[0] for each in peer.requests()] == [3, 6, 6, 3, 6]
    assert read(driver, "holding:5") == [word & ~8]


class Registers:
    """A unit in place of a connection: eight registers, and a failure at a request that is numbered."""

    def __init__(self, words: Sequence[int]) -> None:
        self.words = list(words)
        self.fails: dict[int, tuple[type[DriverError], bool]] = {}
        self.count = 0
        self.was_lost = False
        """Whether the connection is a new one."""

    def begin(self, timeout: float) -> bool:
        was_lost, self.was_lost = self.was_lost, False
        return was_lost

    def close(self) -> None: ...

    def read(self, request: Request) -> list[int]:
        return self._done(lambda: self.words[request.address : request.address + request.count])

    def write(self, request: Request, cells: list[int]) -> None:
        def put() -> None:
            self.words[request.address : request.address + request.count] = cells

        self._done(put)

    def mask_write(self, request: Request, cells: list[int]) -> None:
        def put() -> None:
            self.words[request.address] = self.words[request.address] & ~request.masks[0] | cells[0]

        self._done(put)

    def _done(self, carry_out: Callable[[], Any]) -> Any:
        self.count += 1
        kind, first = self.fails.pop(self.count, (None, True))
        result = carry_out() if first else None
        if kind:
            raise kind("refused")
        return result


def connected_to(driver: Modbus, unit: Registers) -> None:
    """The driver is connected to this unit."""
    with patch.object(unit_module, "Unit", lambda *_: unit):
        driver.open()


OUTPUTS = ["holding:0.0", "holding:0.5:3", "holding:0.15", "holding:1", "holding:2:BA.3:0", "holding:3.12:2"]
OUTPUTS += ["holding:4:uint32:CDAB.19:12", "holding:4:uint32:CDAB.3", "holding:6:int32.31:0", "holding:2:BA.11"]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 0xFFFF), min_size=8, max_size=8), st.booleans(), st.booleans(), st.data())
def test_whatever_fails_bits_that_nobody_wired_stay_and_the_others_are_as_commanded(
    words: list[int], masked: bool, skipping: bool, data: st.DataObject
) -> None:
    _write_with_failures(words, masked, skipping, data)


def _write_with_failures(words: list[int], masked: bool, skipping: bool, data: st.DataObject) -> None:
    driver = Modbus(mask_write=masked, **({"skip_unchanged": "1 h"} if skipping else {}))
    unit = Registers(words)
    connected_to(driver, unit)
    outputs = [each for text in OUTPUTS if Direction.OUTPUT in (each := driver.channel(text)).direction]
    whole = parse("holding:0:uint64"), parse("holding:4:uint64")
    wired = sum(mask << 16 * (7 - each.address - i) for each in outputs for i, mask in enumerate(each.masks))

    def contents() -> int:
        return int(whole[0].number(unit.words[:4])) << 64 | int(whole[1].number(unit.words[4:]))

    before = contents()
    held: dict[str, set[int]] = {}
    """What each channel may hold: one value, after a failure several."""
    for _ in range(data.draw(st.integers(1, 6))):
        some = data.draw(st.lists(st.sampled_from(outputs), unique=True, min_size=1))
        raws = [data.draw(st.integers(each.lowest, each.highest)) for each in some]
        if data.draw(st.booleans()):
            kind = data.draw(st.sampled_from([Refused, DriverError]))
            unit.fails = {unit.count + data.draw(st.integers(1, 4)): (kind, data.draw(st.booleans()))}
        failed = False
        try:
            driver.write_many(some, np.array(raws, np.int64))
        except DriverError:
            failed = True
        unit.fails = {}
        for each, raw in zip(some, raws, strict=True):
            older = held.get(each.text, {int(each.raw(words[each.address : each.end]))}) if failed else set()
            held[each.text] = {raw} | older
        for each in outputs:
            if each.text in held:
                assert each.raw(unit.words[each.address : each.end]) in held[each.text], each.text
        assert contents() & ~wired == before & ~wired


@pytest.mark.full
@settings(max_examples=1000, deadline=None)
@given(st.lists(st.integers(0, 0xFFFF), min_size=8, max_size=8), st.booleans(), st.booleans(), st.data())
def test_the_same_with_many_more_failures(words: list[int], masked: bool, skipping: bool, data: st.DataObject) -> None:
    _write_with_failures(words, masked, skipping, data)


# Several drivers and another master on the same registers ------------------------------------------------

PARTS = {"0": 0x0001, "7:4": 0x00F0, "7:0": 0x00FF, "15:8": 0xFF00, "15:0": 0xFFFF}
"""Fields of a register, and their bits."""
addresses, words, names = st.integers(0, 1), st.integers(0, 0xFFFF), st.sampled_from(["one", "other", "masked"])


class SharedRegisters(RuleBasedStateMachine):
    """Registers that two drivers write by what they know and one by function 22, while another master writes them too.
    A driver knows what it was told last: what the unit has confirmed, or has given where nothing was known."""

    def __init__(self) -> None:
        super().__init__()
        self.words = [0x1234, 0xFFFF]
        shared = list(self.words)
        self.drivers = {"one": Modbus(), "other": Modbus(), "masked": Modbus(mask_write=True)}
        self.units = {name: Registers([]) for name in self.drivers}
        self.known: dict[str, dict[int, int]] = {name: {} for name in self.drivers}
        for name, driver in self.drivers.items():
            self.units[name].words = shared
            connected_to(driver, self.units[name])

    def _write(self, name: str, address: int, parts: Sequence[str], word: int) -> None:
        channels = [self.drivers[name].channel(f"holding:{address}.{part}") for part in parts]
        raws = [(word & PARTS[part]) >> channel.low for part, channel in zip(parts, channels, strict=True)]  # type: ignore[operator]
        self.drivers[name].write_many(channels, np.array(raws, np.int64))

    def _written(self, name: str, address: int, mask: int, word: int) -> int:
        """What the register holds after a write of these bits."""
        known = self.words[address] if name == "masked" else self.known[name].get(address, self.words[address])
        return known & ~mask | word & mask

    def _confirm(self, name: str, address: int, mask: int, contents: int) -> None:
        self.words[address] = contents
        if mask == 0xFFFF:
            self.known[name].pop(address, None)
        elif name != "masked":
            self.known[name][address] = contents

    @rule(
        name=names, address=addresses, parts=st.sampled_from([*((part,) for part in PARTS), ("0", "15:8")]), word=words
    )
    def write_fields_in_one_transfer(self, name: str, address: int, parts: Sequence[str], word: int) -> None:
        mask, unit = sum(PARTS[part] for part in parts), self.units[name]
        reads = name != "masked" and mask != 0xFFFF and address not in self.known[name]
        contents, before = self._written(name, address, mask, word), unit.count
        self._write(name, address, parts, word)
        self._confirm(name, address, mask, contents)
        assert unit.count == before + 1 + reads, "what is known is not read again, what is not known is"

    @rule(name=names, address=addresses, word=words, kind=st.sampled_from([Refused, DriverError]), taken=st.booleans())
    def fail_to_write_a_field(self, name: str, address: int, word: int, kind: type[DriverError], taken: bool) -> None:
        """`taken`: the unit did what it was asked, and only its answer has failed."""
        unit = self.units[name]
        reads = name != "masked" and address not in self.known[name]
        unit.fails = {unit.count + 1 + reads: (kind, taken)}
        contents = self._written(name, address, PARTS["7:4"], word)
        with pytest.raises(DriverError):
            self._write(name, address, ["7:4"], word)
        if taken:
            self.words[address] = contents
        if name != "masked":
            self.known[name].pop(address, None)
        if kind is DriverError:
            self.known[name].clear()

    @rule(address=addresses, word=words)
    def another_master_writes(self, address: int, word: int) -> None:
        self.words[address] = self.units["one"].words[address] = word

    @rule(name=names)
    def the_connection_is_lost(self, name: str) -> None:
        self.units[name].was_lost = True
        self.known[name].clear()

    @invariant()
    def the_registers_are_as_the_drivers_and_the_master_left_them(self) -> None:
        assert self.units["one"].words == self.words


TestSharedRegisters = SharedRegisters.TestCase
TestSharedRegisters.settings = settings(max_examples=30, stateful_step_count=20, deadline=None)


# A machine, and a server of pymodbus ---------------------------------------------------------------------


class Drive(Compound):
    running: BinarySensor[OnOff]
    start: BinaryActuator[OnOff]
    timer: DigitalSensor


def drive() -> Drive:
    return Drive(
        running=BinarySensor(OnOff, one=OnOff.ON),
        start=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )


@contextmanager
def pymodbus_server(words: list[int]) -> Iterator[int]:
    """A server of pymodbus with these holding registers; its port."""
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    ready = threading.Event()
    place: dict[str, Any] = {}

    async def serve() -> None:
        device = SimDevice(1, [SimData(0, values=words, datatype=DataType.REGISTERS)])
        server = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        place.update(port=server.transport.sockets[0].getsockname()[1], ends=asyncio.Event())
        place["loop"] = asyncio.get_running_loop()
        ready.set()
        await place["ends"].wait()
        await server.shutdown()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(PATIENT)
    try:
        yield place["port"]
    finally:
        place["loop"].call_soon_threadsafe(place["ends"].set)
        thread.join(PATIENT)


@pytest.mark.parametrize("masked", [False, True])
def test_a_machine_has_a_status_word_and_a_control_word_of_a_pymodbus_server(masked: bool) -> None:
    with pymodbus_server([0] * 10 + [0x0300, 0x0080]) as port:
        box = {"type": "modbus", "port": port, "timeout": "5 s", "mask_write": masked}
        wiring: dict[str, Any] = {
            "drivers": {"drive": box},
            "wire": {
                "running": {"driver": "drive", "channel": "holding:10.9"},
                "start": {"driver": "drive", "channel": "holding:11.1"},
                "timer": {"driver": "timerfd", "period": "20 ms"},
            },
        }
        assert check(drive(), wiring) == []
        with opened(port) as other:
            with connect(drive(), wiring) as m:
                m.start.write(OnOff.ON)
                periods(m, 2)
                assert m.running.read() is OnOff.ON
                assert read(other, "holding:11") == [0x0082]
            assert read(other, "holding:11") == [0x0080], "the reset leaves the other bits too"


def test_two_objects_on_one_bit_are_refused() -> None:
    wiring = {
        "drivers": {"drive": {"type": "modbus"}},
        "wire": {
            "running": {"driver": "drive", "channel": "holding:11.1"},
            "start": {"driver": "drive", "channel": "holding:11:uint16.3:1"},
            "timer": {"driver": "timerfd", "period": "20 ms"},
        },
    }
    assert any("holding:11" in fault.message for fault in check(drive(), wiring))


def test_unchanged_bits_are_left_out_only_if_these_very_bits_were_confirmed(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus, "monotonic", lambda: 0.0)
    driver, peer = start(mask_write=True, skip_unchanged="1 h")
    driver.write(driver.channel("holding:5.1"), 1)
    write(driver, {"holding:5.1": 1, "holding:5.2": 0})
    write(driver, {"holding:5.1": 1, "holding:5.2": 0})
    assert peer.requests() == [(22, 5, 0xFFFD, 2), (22, 5, 0xFFF9, 2)]


@pytest.mark.parametrize("order", ORDERS)
def test_a_field_writes_no_register_in_which_it_has_no_bits(order: str) -> None:
    """The device itself counts in the others."""
    unit = Registers([0] * 8)
    driver = Modbus()
    connected_to(driver, unit)
    field = driver.channel(f"holding:0:uint64:{order}.40:20")
    driver.write(field, 1)
    unit.words[0], unit.words[3] = 999, 777
    driver.write(field, 2)
    assert (unit.words[0], unit.words[3]) == (999, 777)
    assert all(field.masks)


def test_a_field_of_a_wide_value_is_shown_in_each_order_of_its_whole_value() -> None:
    channel = parse("input:4:uint32.17")
    assert (channel.address, channel.cells) == (4, 1)
    whole = channel.uncut
    assert whole is not None
    assert (whole.address, whole.cells) == (4, 2)
    assert whole.in_each_order([0x0002, 0x0000]) == "ABCD 1 (wired), CDAB 0, BADC 0, DCBA 0"
    assert whole.in_each_order([0x0000, 0x0002]) == "ABCD 0 (wired), CDAB 1, BADC 0, DCBA 0"

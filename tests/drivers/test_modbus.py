"""The Modbus driver against a device made with libmodbus (tests/helpers/peers/modbus_peer.c): another client wrote the
other end. Its channels and plans as pure functions are in test_modbus_plan.py."""

from __future__ import annotations

import logging
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.peers.modbus_device import PATIENT, Peer, running
from helpers.peers.modbus_map import CELL, coil, discrete, holding, input_register, value
from helpers.tiers import budget
from umo import BinaryActuator, Compound, check
from umo.drivers.contract import Driver
from umo.drivers.modbus import Modbus
from umo.drivers.modbus import driver as driver_module
from umo.drivers.modbus.plan import plan_reads
from umo.drivers.streams import Stream, hosts
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError, WiringError
from umo.states import OnOff

HASTY = 0.05  # for calls that are to time out


# The peer -----------------------------------------------------------------------------------------

Start = Callable[..., Peer]
Connect = Callable[..., Modbus]


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    """start(*faults, port=0): a peer, stopped at the end."""
    with ExitStack() as stack:
        yield lambda *faults, port=0: stack.enter_context(running(port, *faults))


@pytest.fixture
def connected() -> Iterator[Callable[..., Modbus]]:
    """connected(peer, **options): an open driver, closed at the end."""
    drivers: list[Modbus] = []

    def connected(peer: Peer, **options: Any) -> Modbus:
        driver = Modbus(port=peer.port, **options)
        driver.timeout = PATIENT
        drivers.append(driver)
        driver.open()
        return driver

    yield connected
    for driver in drivers:
        driver.close()


def read(driver: Driver, *texts: str) -> list[int]:
    out = np.full(len(texts), -99, np.int64)
    driver.read_many([driver.channel(text) for text in texts], out)
    return out.tolist()


def write(driver: Driver, **raws: int) -> None:
    """write(driver, coil_3=1): the underscore stands for the colon."""
    channels = [driver.channel(name.replace("_", ":")) for name in raws]
    driver.write_many(channels, np.array(list(raws.values()), np.int64))


# Options -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"port": 0},
        {"port": "502"},
        {"unit": 256},
        {"unit": True},
        {"word_order": "middle"},
        {"watchdog_register": 65536},
        {"baudrate": 9600},
        {"parity": "even"},
        {"stop_bits": 1},
        {"rs485": True},
        {"skip_unchanged": "soon"},
        {"skip_unchanged": 0},
        {"recovery": "-1 s"},
        {"recovery": "2 h"},
        {"recovery": True},
        {"recovery": float("nan")},
    ],
)
def test_an_option_beyond_its_range_is_a_wiring_error_before_anything_is_opened(options: Any) -> None:
    with pytest.raises(WiringError, match=next(iter(options))):
        Modbus(**options)


# The device's name --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "devices"),
    [
        ("192.168.0.7", ["modbus tcp 192.168.0.7:5020"]),
        ("127.1", ["modbus tcp 127.0.0.1:5020"]),
        ("0x7f000001", ["modbus tcp 127.0.0.1:5020"]),
        ("0.0.0.0", ["modbus tcp 127.0.0.1:5020"]),
        ("::ffff:127.0.0.1", ["modbus tcp 127.0.0.1:5020"]),
        ("::ffff:0:0", ["modbus tcp 127.0.0.1:5020"]),
        ("::", ["modbus tcp [::1]:5020"]),
        ("0:0:0:0:0:0:0:1", ["modbus tcp [::1]:5020"]),
        ("2001:DB8::0:7", ["modbus tcp [2001:db8::7]:5020"]),
        ("fe80::7%1", ["modbus tcp [fe80::7%1]:5020"]),
    ],
)
def test_every_spelling_of_an_address_is_the_same_device(host: str, devices: list[str]) -> None:
    with patch.object(hosts, "_looked_up", side_effect=AssertionError):
        assert Modbus(host=host, port=5020).devices() == devices


def test_units_behind_one_gateway_are_one_device_and_ports_are_not() -> None:
    assert Modbus(unit=1).devices() == Modbus(unit=2).devices()
    assert Modbus(port=502).devices() != Modbus(port=503).devices()


def resolver(found: dict[str, list[str]]) -> Callable[..., list[Any]]:
    """A getaddrinfo that knows these names alone."""

    def getaddrinfo(host: str, port: object, **options: Any) -> list[Any]:
        if options.get("flags") or host not in found:
            raise socket.gaierror(socket.EAI_NONAME, "not known")
        families = {True: socket.AF_INET6, False: socket.AF_INET}
        return [(families[":" in each], None, 6, "", (each, 0, *[0, 0] * (":" in each))) for each in found[host]]

    return getaddrinfo


def test_a_name_stands_for_every_address_that_it_has() -> None:
    names = {"localhost": ["::1", "127.0.0.1", "::1"], "press.lan": ["10.0.0.7"]}
    with patch.object(socket, "getaddrinfo", resolver(names)):
        assert Modbus(host="localhost").devices() == ["modbus tcp 127.0.0.1:502", "modbus tcp [::1]:502"]
        assert Modbus(host="press.lan").devices() == ["modbus tcp 10.0.0.7:502"]


@pytest.mark.parametrize("host", ["Press7.LAN.", "", "a b", "a\0b", "a" * 70, "ü" * 64, "\udcff"])
def test_a_name_that_cannot_be_looked_up_stands_for_itself(host: str) -> None:
    getaddrinfo = socket.getaddrinfo

    def only_numbers(host: str, port: object, **options: Any) -> Any:
        return getaddrinfo(host, None, **options | {"flags": socket.AI_NUMERICHOST})

    with patch.object(socket, "getaddrinfo", only_numbers):
        assert Modbus(host=host).devices() == [f"modbus tcp {host.lower().rstrip('.')}:502"]


def test_a_look_up_that_does_not_end_is_left_alone_and_the_name_stands_for_itself() -> None:
    ends = threading.Event()

    def stuck(host: str, port: object, **options: Any) -> list[Any]:
        if not options.get("flags"):
            ends.wait(PATIENT)
        raise socket.gaierror(socket.EAI_AGAIN, "no server")

    with patch.object(socket, "getaddrinfo", stuck), patch.object(hosts, "MAX_LOOKUP_TIME", 0.01):
        assert Modbus(host="press.lan").devices() == ["modbus tcp press.lan:502"]
        ends.set()
        for thread in threading.enumerate():
            if thread.name == "umo look-up":
                thread.join(PATIENT)


# Values and requests against the peer -------------------------------------------------------------


@pytest.mark.parametrize("order", ["big", "little"])
def test_every_type_of_channel_reads_what_the_device_holds(start: Start, connected: Connect, order: str) -> None:
    driver = connected(start(), word_order=order)
    texts = ["coil:3", "coil:4", "discrete:8", "discrete:10"]
    texts += [f"{table}:{i}:{kind}" for table in ("holding", "input") for i, kind in enumerate(modbus_types(), 3)]
    texts += ["holding:15:float32:1e3", "input:15:float32:1e3"]
    wanted = [
        value(channel, CELL[channel.table.name], little=order == "little") for channel in map(driver.channel, texts)
    ]
    assert read(driver, *texts) == wanted
    assert [driver.read(driver.channel(text)) for text in texts] == wanted
    assert min(wanted) < 0 < max(wanted)


def modbus_types() -> list[str]:
    return ["uint16", "int16", "uint32", "int32", "int16", "int32", "int64", "uint16"]


@pytest.mark.parametrize("order", ["big", "little"])
def test_every_type_of_channel_keeps_what_was_written(start: Start, connected: Connect, order: str) -> None:
    driver = connected(start(), word_order=order)
    texts = ["coil:1", "holding:0", "holding:1:int16", "holding:2:uint32", "holding:4:int32", "holding:9:int16"]
    texts += ["holding:10:int64", "holding:14:float32:0.001", "holding:20:float64:1e-6"]
    channels = [driver.channel(text) for text in texts]
    for raws in (
        [c.lowest for c in channels],
        [c.highest for c in channels],
        [1, 2, -3, 0x12345678, -2, 7, -8, 9, -10],
    ):
        driver.write_many(channels, np.array(raws, np.int64))
        assert read(driver, *texts) == raws
        for channel, raw in zip(channels, raws, strict=True):
            driver.write(channel, raw)
            assert driver.read(channel) == raw


def test_a_period_takes_one_request_for_each_run_of_a_table(start: Start, connected: Connect) -> None:
    peer = start()
    driver = connected(peer)
    read(driver, "input:3", "discrete:0", "input:1:int32", "input:0", "input:9", "discrete:1")
    assert peer.requests() == [(4, 0, 4), (2, 0, 2), (4, 9, 1)]
    write(driver, coil_2=1, holding_0=7, coil_0=1, coil_1=0, holding_1=8, coil_4=1)
    assert peer.requests()[3:] == [(15, 0, 3, 1, 0, 1), (16, 0, 2, 7, 8), (5, 4, 1, 1)]


def test_a_gap_is_read_over_only_when_asked(start: Start, connected: Connect) -> None:
    peer = start()
    texts = ["holding:0", "holding:17", "holding:35", "coil:0", "coil:65", "coil:131"]
    wanted = [holding(0), holding(17), holding(35), coil(0), coil(65), coil(131)]
    assert read(connected(peer), *texts) == wanted
    assert len(peer.requests()) == 6
    assert read(connected(peer, bridge_gaps=True), *texts) == wanted
    assert peer.requests()[6:] == [(3, 0, 18), (3, 35, 1), (1, 0, 66), (1, 131, 1)]


def test_what_exceeds_the_protocol_s_maxima_is_split(start: Start, connected: Connect) -> None:
    peer = start()
    driver = connected(peer)
    words, bits, longs = range(300), range(4100), range(0, 126, 2)
    assert read(driver, *(f"input:{i}" for i in words)) == [input_register(i) for i in words]
    assert read(driver, *(f"discrete:{i}" for i in bits)) == [discrete(i) for i in bits]
    assert len(read(driver, *(f"holding:{i}:int32" for i in longs))) == 63
    reads = [(4, 0, 125), (4, 125, 125), (4, 250, 50), (2, 0, 2000), (2, 2000, 2000), (2, 4000, 100)]
    assert peer.requests() == [*reads, (3, 0, 124), (3, 124, 2)]
    driver.write_many([driver.channel(f"holding:{i}") for i in words], np.arange(300))
    driver.write_many([driver.channel(f"coil:{i}") for i in bits], np.arange(4100) % 2)
    writes = [request[:3] for request in peer.requests()[8:]]
    assert writes[:3] == [(16, 0, 123), (16, 123, 123), (16, 246, 54)]
    assert writes[3:] == [(15, 0, 1968), (15, 1968, 1968), (15, 3936, 164)]
    assert read(driver, *(f"holding:{i}" for i in words)) == list(words)
    assert read(driver, *(f"coil:{i}" for i in bits)) == [i % 2 for i in bits]


def test_a_single_cell_is_written_by_the_simple_functions(start: Start, connected: Connect) -> None:
    peer = start()
    driver = connected(peer)
    driver.write(driver.channel("coil:7"), 1)
    driver.write(driver.channel("holding:7:int16"), -2)
    driver.write(driver.channel("holding:7:int32"), -2)
    assert peer.requests() == [(5, 7, 1, 1), (6, 7, 1, 65534), (16, 7, 2, 65535, 65534)]


def test_an_output_comes_up_at_its_default_with_no_other_level_and_is_reset_to_it(
    start: Start, connected: Connect
) -> None:
    peer = start()
    driver = connected(peer)
    output, sensor = driver.channel("coil:3"), driver.channel("input:3")
    driver.initialize(output, 1)
    driver.initialize(sensor, None)
    driver.reset(output, 0)
    driver.reset(sensor, None)
    driver.finalize(output)
    assert peer.requests() == [(5, 3, 1, 1), (5, 3, 1, 0)]


def test_a_value_that_does_not_fit_sends_nothing_at_all(start: Start, connected: Connect) -> None:
    peer = start()
    driver = connected(peer)
    with pytest.raises(DriverError, match="65536 does not fit"):
        write(driver, coil_0=1, holding_0=65536)
    with pytest.raises(DriverError, match="2 does not fit coil:0: it takes 0 to 1"):
        write(driver, coil_0=2)
    with pytest.raises(DriverError, match="discrete:0 is an input"):
        write(driver, discrete_0=1)
    assert peer.requests() == []


def test_the_watchdog_takes_its_time_in_ms_where_the_device_has_a_register_for_it(
    start: Start, connected: Connect
) -> None:
    peer = start()
    driver = connected(peer, watchdog_register=400)
    for seconds in (0.2, 0.0001, 0.0, 65.535):
        driver.watchdog(seconds)
    assert peer.requests() == [(6, 400, 1, ms) for ms in (200, 1, 0, 65535)]
    for seconds in (-1.0, 65.6, float("nan")):
        with pytest.raises(DriverError, match="does not fit its register"):
            driver.watchdog(seconds)


@pytest.mark.parametrize(
    ("options", "watchdog", "message"),
    [
        ({}, "1 s", "a watchdog needs the option watchdog_register"),
        ({"watchdog_register": 5}, "100 s", "a watchdog of 100 s does not fit its register (0 to 65.535 s)"),
        ({"watchdog_register": 5, "skip_unchanged": "2 s"}, "1 s", "are not shorter than the watchdog"),
        ({"watchdog_register": 5}, "1 s", ""),
    ],
)
def test_a_watchdog_that_cannot_be_armed_is_a_fault_of_the_wiring(
    options: dict[str, object], watchdog: str, message: str
) -> None:
    class Lamp(Compound):
        lamp: BinaryActuator[OnOff]

    box = {"type": "modbus", "watchdog": watchdog} | options
    given = {"drivers": {"box": box}, "wire": {"lamp": {"driver": "box", "channel": "coil:0"}}}
    faults = check(Lamp(lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)), given)
    assert [fault.key for fault in faults] == ["drivers.box.watchdog"] * bool(message)
    assert not faults or message in faults[0].message


@pytest.mark.parametrize("kind", [DriverError, NotImplementedError])
def test_a_watchdog_without_a_register_is_refused_like_one_that_does_not_exist(
    kind: type[Exception],
) -> None:
    with pytest.raises(kind, match="watchdog_register"):
        Modbus().watchdog(0.2)


def test_a_plan_is_made_once_and_the_number_of_plans_is_bounded(start: Start, connected: Connect) -> None:
    with patch.object(driver_module, "plan_reads", wraps=plan_reads) as planning:
        driver = connected(start())
        for _ in range(3):
            read(driver, "coil:1", "coil:2")
        assert planning.call_count == 1
        for i in range(600):
            read(driver, f"coil:{i}")
        read(driver, "coil:599")
        assert planning.call_count == 601
        read(driver, "coil:0")  # which is not kept any more
        assert planning.call_count == 602


# Failures -----------------------------------------------------------------------------------------

AT_READ = [
    ("close", "the device closed the connection"),
    ("silent", "timed out (50 ms)"),
    ("late=120", "timed out (50 ms)"),
    ("trickle=5", "timed out (50 ms)"),
    ("exception=1", "exception 1, illegal function"),
    ("exception=2", "exception 2, illegal data address"),
    ("exception=4", "exception 4, device failure"),
    ("truncate=3", "the device closed the connection"),
    ("truncate=12", "the device closed the connection"),
    ("fewer", "a byte count of 6 in place of 8"),
    ("bytes=0", "a byte count of 0 in place of 8"),
    ("bytes=9", "a byte count of 9 in place of 8"),
    ("odd", "a byte count of 9 in place of 8"),
    ("tail", "an answer of 11 bytes in place of 10"),
    ("function=3", "an answer to function 3 in place of 4"),
    ("function=99", "an answer to function 99 in place of 4"),
    ("function=132", "an exception answer of 10 bytes in place of 2"),
    ("unit=2", "an answer of unit 2 in place of 1"),
    ("transaction=1", "an answer to transaction 3 in place of 2"),
    ("transaction=-2", "an answer to transaction 0 in place of 2"),
    ("transaction=-1", "an answer to transaction 1 in place of 2, and no other answer came within 50 ms"),
    ("garbage", "the received data is not Modbus"),
]
READING = [f"input:{i}" for i in range(4)]


@pytest.mark.parametrize(("fault", "words"), AT_READ)
def test_a_failed_read_says_where_and_why_and_the_next_call_works_again(
    start: Start, connected: Connect, fault: str, words: str
) -> None:
    peer = start(f"2:{fault}")
    driver = connected(peer)
    wanted = [input_register(i) for i in range(4)]
    assert read(driver, *READING) == wanted
    driver.timeout = HASTY if "50 ms" in words else PATIENT
    with pytest.raises(DriverError) as caught:
        read(driver, *READING)
    assert isinstance(caught.value, DeviceTimeout) == ("50 ms" in words)
    where = "unit 1: reading input registers 0 to 3: "
    assert str(caught.value).startswith(where)
    assert words in str(caught.value)
    driver.timeout = PATIENT
    assert read(driver, *READING) == wanted
    assert peer.requests() == [(4, 0, 4)] * 3, "nothing was sent twice"


@pytest.mark.parametrize("table", ["coil", "discrete"])
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("bytes=0", "a byte count of 0 in place of 1"),
        ("bytes=200", "a byte count of 200 in place of 1"),
        ("odd", "a byte count of 2 in place of 1"),
        ("tail", "an answer of 4 bytes in place of 3"),
    ],
)
def test_bits_whose_number_is_not_what_was_asked_for_are_not_taken(
    start: Start, connected: Connect, table: str, fault: str, words: str
) -> None:
    driver = connected(start(f"1:{fault}"))
    with pytest.raises(DriverError, match=words):
        read(driver, *(f"{table}:{i}" for i in range(8)))


AT_WRITE = [
    (
        {"coil_2": 1},
        "echo=9",
        "writing coil 2: the answer confirms address 3, value 0xff00 in place of address 2, value 0xff00",
    ),
    ({"coil_2": 1}, "confirm=4660", "confirms address 2, value 0x1234 in place of address 2, value 0xff00"),
    ({"coil_2": 1}, "tail", "writing coil 2: an answer of 6 bytes in place of 5"),
    ({"holding_2": 9}, "echo=11", "confirms address 2, value 0x8 in place of address 2, value 0x9"),
    ({"coil_2": 1, "coil_3": 1}, "echo=11", "confirms address 2, count 0x3 in place of address 2, count 0x2"),
    ({"holding_2": 1, "holding_3": 1}, "echo=9", "writing holding registers 2 to 3: the answer confirms address 3"),
    ({"holding_2": 9}, "exception=3", "writing holding register 2: exception 3, illegal data value"),
    ({"holding_2": 9}, "truncate=10", "writing holding register 2: the device closed the connection"),
    ({"holding_2": 9}, "silent", "writing holding register 2: timed out"),
    ({"holding_2": 9}, "function=16", "writing holding register 2: an answer to function 16 in place of 6"),
]


@pytest.mark.parametrize(("raws", "fault", "words"), AT_WRITE)
def test_a_write_that_was_not_confirmed_as_sent_has_failed(
    start: Start, connected: Connect, raws: dict[str, int], fault: str, words: str
) -> None:
    peer = start(f"1:{fault}")
    driver = connected(peer)
    driver.timeout = HASTY if fault == "silent" else PATIENT
    with pytest.raises(DriverError) as caught:
        write(driver, **raws)
    assert words in str(caught.value)
    driver.timeout = PATIENT
    write(driver, **raws)
    assert len(peer.requests()) == 2, "the failed write was not repeated by itself"


@pytest.mark.parametrize("answers_as", [0, 255])
def test_a_gateway_that_answers_as_another_unit_is_believed_when_it_is_told(
    start: Start, connected: Connect, answers_as: int
) -> None:
    peer = start(f"0:unit={answers_as}")
    driver = connected(peer, answers_as=answers_as)
    assert read(driver, "holding:1", "coil:3") == [holding(1), coil(3)]
    write(driver, holding_1=7)
    driver = connected(peer)
    with pytest.raises(DriverError, match=f"an answer of unit {answers_as} in place of 1"):
        read(driver, "holding:1")


def test_a_gateway_that_was_to_answer_as_another_unit_and_does_not_is_refused(start: Start, connected: Connect) -> None:
    driver = connected(start(), answers_as=255)
    with pytest.raises(DriverError, match="an answer of unit 1 in place of 255"):
        read(driver, "holding:1")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"answers_as": 256}, "answers_as must be a whole number from 0 to 255, not 256"),
        ({"answers_as": 0, "serial": "/dev/ttyUSB0"}, "answers_as can only be used with a gateway on TCP"),
    ],
)
def test_answers_as_is_a_unit_of_a_gateway_on_tcp(options: dict[str, Any], words: str) -> None:
    with pytest.raises(WiringError, match=words):
        Modbus(**options)


# Blocks of several requests --------------------------------------------------------------------

MIXED = ["input:0", "input:1:int32", "discrete:0", "coil:3", "coil:9", "holding:5"]
"""Five requests: the input registers, the discrete input, a coil, another one, the holding register."""


def test_requests_beside_one_that_the_device_refuses_are_carried_out(start: Start, connected: Connect) -> None:
    peer = start("1:exception=2", "3:exception=4")
    driver = connected(peer)
    channels = [driver.channel(text) for text in MIXED]
    out = np.full(len(channels), -99, np.int64)
    with pytest.raises(ChannelsFailed) as caught:
        driver.read_many(channels, out)
    where = "unit 1: reading "
    assert caught.value.causes == {
        "input:0": f"{where}input registers 0 to 2: exception 2, illegal data address",
        "input:1:int32": f"{where}input registers 0 to 2: exception 2, illegal data address",
        "coil:3": f"{where}coil 3: exception 4, device failure",
    }
    assert out.tolist() == [-99, -99, discrete(0), -99, coil(9), holding(5)]
    with patch.object(hosts.TcpDial, "__call__", side_effect=AssertionError):
        assert read(driver, *MIXED)[2:] == [discrete(0), coil(3), coil(9), holding(5)]


@pytest.mark.parametrize("fault", ["close", "unit=7", "garbage", "tail"])
def test_what_a_lost_connection_leaves_undone_is_named_and_what_went_before_stands(
    start: Start, connected: Connect, fault: str
) -> None:
    peer = start(f"3:{fault}")
    driver = connected(peer)
    channels = [driver.channel(text) for text in MIXED]
    out = np.full(len(channels), -99, np.int64)
    with pytest.raises(ChannelsFailed) as caught:
        driver.read_many(channels, out)
    assert list(caught.value.causes) == MIXED[3:]
    assert len(set(caught.value.causes.values())) == 1
    assert "reading coil 3: " in caught.value.causes["holding:5"]
    assert out.tolist() == [input_register(0), *read(driver, MIXED[1]), discrete(0), -99, -99, -99]
    assert len(peer.requests()) == 4, "nothing was asked after the loss"


def test_a_connection_that_is_lost_at_the_first_request_fails_the_block_with_its_own_words(
    start: Start, connected: Connect
) -> None:
    driver = connected(start("1:close"))
    with pytest.raises(DriverError, match="reading input registers 0 to 2: the device closed") as caught:
        read(driver, *MIXED)
    assert not isinstance(caught.value, ChannelsFailed)


def test_writes_beside_one_that_the_device_refuses_are_carried_out(start: Start, connected: Connect) -> None:
    peer = start("2:exception=4")
    driver = connected(peer)
    with pytest.raises(ChannelsFailed) as caught:
        write(driver, coil_0=1, holding_4=7, holding_5=8, coil_7=1)
    assert list(caught.value.causes) == ["holding:4", "holding:5"]
    assert peer.requests() == [(5, 0, 1, 1), (16, 4, 2, 7, 8), (5, 7, 1, 1)]


def test_a_write_that_loses_the_connection_fails_with_all_that_were_to_follow(start: Start, connected: Connect) -> None:
    peer = start("2:close")
    driver = connected(peer)
    with pytest.raises(ChannelsFailed) as caught:
        write(driver, coil_0=1, holding_4=7, coil_7=1)
    assert list(caught.value.causes) == ["holding:4", "coil:7"]
    assert [request[:2] for request in peer.requests()] == [(5, 0), (6, 4)]


def test_a_refused_request_that_is_alone_fails_with_its_own_words(start: Start, connected: Connect) -> None:
    driver = connected(start("1:exception=2"))
    with pytest.raises(DriverError, match="illegal data address") as caught:
        write(driver, coil_0=1, coil_1=1)
    assert not isinstance(caught.value, ChannelsFailed)


# Connections -----------------------------------------------------------------------------------


def test_a_late_answer_is_never_taken_for_a_later_one(start: Start, connected: Connect) -> None:
    driver = connected(start("1:late=120"))
    driver.timeout = HASTY
    with pytest.raises(DeviceTimeout, match="timed out"):
        read(driver, "holding:1")
    driver.timeout = PATIENT
    assert read(driver, "holding:2") == [holding(2)]
    assert read(driver, "holding:3") == [holding(3)]


def test_an_answer_to_another_request_is_passed_over(start: Start, connected: Connect) -> None:
    driver = connected(start("2:stale"))
    assert [read(driver, f"holding:{i}") for i in (1, 2, 3)] == [[holding(i)] for i in (1, 2, 3)]


def test_an_answer_in_two_pieces_is_one_answer(start: Start, connected: Connect) -> None:
    driver = connected(start("1:split=5"))
    assert read(driver, *READING) == [input_register(i) for i in range(4)]


def test_what_came_in_unasked_is_thrown_away_with_its_connection(start: Start, connected: Connect) -> None:
    peer = start("1:unasked")
    driver = connected(peer)
    assert read(driver, "holding:1") == [holding(1)]
    peer.wait_for("twice")
    assert read(driver, "holding:2") == [holding(2)]


def test_a_device_that_goes_away_is_named_and_used_again_when_it_is_back(start: Start, connected: Connect) -> None:
    peer = start("2:exit")
    driver = connected(peer)
    assert read(driver, "holding:1") == [holding(1)]
    with pytest.raises(DriverError, match="reading holding register 1: the device closed the connection"):
        read(driver, "holding:1")
    peer.process.wait()
    for _ in range(2):
        with pytest.raises(DriverError, match="unit 1: connecting: connection refused"):
            read(driver, "holding:1")
    start(port=peer.port)
    assert read(driver, "holding:1") == [holding(1)]


def test_all_the_requests_of_a_call_share_one_deadline(start: Start, connected: Connect) -> None:
    driver = connected(start("1:late=300", "2:late=300"))
    driver.timeout = 0.5  # enough for either of them
    with pytest.raises(DeviceTimeout, match=r"reading discrete input 0: timed out \(500 ms\)"):
        read(driver, "input:0", "discrete:0")


def test_a_device_that_does_not_take_the_connection_times_out() -> None:
    with socket.socket() as silent, socket.socket() as filler, socket.socket() as second:
        silent.bind(("127.0.0.1", 0))
        silent.listen(0)  # a queue for one: what comes after it hears nothing
        for each in (filler, second):
            each.setblocking(False)
            each.connect_ex(silent.getsockname())
        driver = Modbus(port=silent.getsockname()[1])
        driver.timeout = HASTY
        with pytest.raises(DeviceTimeout, match=r"connecting: timed out \(50 ms\)"):
            driver.open()
        driver.close()


def test_a_connection_whose_time_is_spent_before_it_begins_leaves_no_socket_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        driver = Modbus(port=server.getsockname()[1])
        driver.timeout = 0.0
        sockets: list[socket.socket] = []
        made = socket.socket

        def make(*arguments: Any) -> socket.socket:
            sockets.append(made(*arguments))
            return sockets[-1]

        with (
            patch.object(socket, "socket", make),
            pytest.raises(DeviceTimeout, match=r"connecting: timed out \(0 s\)"),
        ):
            driver.open()
        assert [each.fileno() for each in sockets] == [-1]


@pytest.mark.parametrize("host", ["256.0.0.1.invalid", "a" * 70])
def test_a_host_that_does_not_exist_fails_at_open(host: str) -> None:
    driver = Modbus(host=host)
    with pytest.raises(DriverError, match=host):
        driver.open()
    driver.close()


def test_a_driver_that_is_not_open_says_so() -> None:
    driver = Modbus()
    driver.close()
    with pytest.raises(DriverError, match="not open"):
        read(driver, "coil:1")


def test_without_pymodbus_the_driver_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [*(name for name in sys.modules if name.startswith("pymodbus.")), "pymodbus"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "umo.drivers.modbus.unit")
    monkeypatch.delattr("umo.drivers.modbus.unit")
    with pytest.raises(DriverError, match=r'pip install "\.\[modbus\]" in the clone of umo'):
        Modbus().open()


def test_pymodbus_s_own_log_stays_quiet(
    start: Start,
    connected: Connect,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    caplog.set_level(logging.DEBUG)
    driver = connected(start("1:function=99", "2:stale", "3:close"))
    for _ in range(3):
        try:
            read(driver, "holding:1")
        except DriverError:
            continue
    assert caplog.records == []
    assert capfd.readouterr() == ("", "")


FRAMES = st.builds(
    lambda number, protocol, unit, body, length: (
        struct.pack(">HHHB", number, protocol, min(len(body) + 1 + length, 65535), unit) + body
    ),
    st.integers(0, 2),
    st.sampled_from([0, 0, 0, 1]),
    st.sampled_from([1, 1, 1, 0]),
    st.binary(max_size=12) | st.builds(lambda f, b: bytes([f]) + b, st.integers(0, 20), st.binary(max_size=9)),
    st.sampled_from([0, 0, 0, -1, 1, 300]),
)


@budget(60, 150)
@given(answer=st.binary(max_size=30) | FRAMES, writing=st.booleans())
def test_whatever_the_device_answers_is_a_value_or_a_driver_error(answer: bytes, writing: bool) -> None:
    near, far = socket.socketpair()

    class Replying(Stream):
        def send(self, data: bytes, deadline: float) -> None:
            super().send(data, deadline)
            far.sendall(answer)
            far.shutdown(socket.SHUT_WR)

    driver = Modbus()
    driver.timeout = PATIENT
    with patch.object(hosts.TcpDial, "__call__", lambda *_: Replying(near, "the end")), near, far:
        driver.open()
        channel = driver.channel("coil:0" if writing else "input:0:int32")
        try:
            if writing:
                driver.write(channel, 1)
            else:
                assert channel.lowest <= driver.read(channel) <= channel.highest
        except DriverError:
            pass
        driver.close()

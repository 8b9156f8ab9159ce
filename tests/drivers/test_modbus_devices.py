"""Modbus devices and adapters that want to be asked in their own way, as users have reported them: an adapter that
repeats what is sent, a device that needs time, one with small requests, one without functions 5 and 6."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from helpers.opened_modbus import Start, read, starting, write
from helpers.peers.modbus_device import PATIENT
from helpers.peers.modbus_map import holding
from umo import Compound, DigitalSensor, Quality, connect
from umo.drivers.modbus import Modbus
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError, WiringError
from umo.testing import periods

pytest.importorskip("pymodbus")
from pymodbus.framer import FramerRTU

from umo.drivers.modbus import tcp, unit

HASTY = 0.05


@pytest.fixture
def start() -> Iterator[Start]:
    with starting() as start:
        yield start


# An adapter that repeats what is sent -------------------------------------------------------------------


@contextmanager
def serial_line(*, repeats: bool, answers: bool) -> Iterator[str]:
    """A pseudo-terminal; its other end repeats each request, and is a unit whose registers hold what was written."""
    near, far = os.openpty()
    tty.setraw(far)
    ends, end = os.pipe()
    registers: dict[int, int] = {}

    def serve() -> None:
        while True:
            ready, _, _ = select.select([near, ends], [], [])
            if ends in ready:
                return
            try:
                frame = os.read(near, 256)
            except OSError:
                continue
            if repeats:
                os.write(near, frame)
            if answers and len(frame) == 8:
                address, value = int.from_bytes(frame[2:4], "big"), int.from_bytes(frame[4:6], "big")
                if frame[1] == 6:
                    registers[address] = value
                    os.write(near, frame)
                else:
                    words = b"".join(registers.get(address + i, 0).to_bytes(2, "big") for i in range(value))
                    body = bytes([frame[0], frame[1], len(words)]) + words
                    os.write(near, body + FramerRTU.compute_CRC(body).to_bytes(2, "big"))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(far)
    finally:
        os.write(end, b".")
        thread.join(PATIENT)
        for each in (near, far, ends, end):
            os.close(each)


@contextmanager
def on_line(path: str, timeout: float, **options: Any) -> Iterator[Modbus]:
    driver = Modbus(serial=path, recovery="10 ms", **options)
    driver.timeout = PATIENT
    driver.open()
    driver.timeout = timeout
    try:
        yield driver
    finally:
        driver.close()


def test_what_an_adapter_repeats_is_passed_over() -> None:
    with serial_line(repeats=True, answers=True) as path, on_line(path, PATIENT, echo=True) as driver:
        for value in (7, 0x0303, 65535):
            driver.write(driver.channel("holding:3"), value)
            assert read(driver, "holding:3", "holding:4") == [value, 0]


def test_an_echo_does_not_confirm_a_write_where_there_is_no_unit() -> None:
    with (
        serial_line(repeats=True, answers=False) as path,
        on_line(path, HASTY, echo=True) as driver,
        pytest.raises(DeviceTimeout, match="timed out"),
    ):
        driver.write(driver.channel("holding:3"), 7)


def test_an_adapter_that_repeats_is_found_by_reading_without_the_option() -> None:
    with (
        serial_line(repeats=True, answers=True) as path,
        on_line(path, PATIENT) as driver,
        pytest.raises(DriverError, match="a byte count of 0 in place of 2"),
    ):
        read(driver, "holding:3")


def test_an_adapter_that_does_not_repeat_is_told_so_with_the_option() -> None:
    with (
        serial_line(repeats=False, answers=True) as path,
        on_line(path, PATIENT, echo=True) as driver,
        pytest.raises(DriverError, match="does not repeat the request; echo = false"),
    ):
        read(driver, "holding:3")


# Devices that need time ---------------------------------------------------------------------------------


class Clock:
    """Time that passes by itself, and in a sleep at once."""

    def __init__(self) -> None:
        self.slept: list[float] = []

    def monotonic(self) -> float:
        return time.monotonic() + sum(self.slept)

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (tcp, unit):
        monkeypatch.setattr(module, "monotonic", clock.monotonic)
        monkeypatch.setattr(module, "sleep", clock.sleep)
    return clock


def test_a_device_that_takes_requests_some_time_after_connecting_is_given_it(start: Start, clock: Clock) -> None:
    driver, peer = start(boot_time="2 s")
    assert peer.requests() == []
    assert read(driver, "holding:1") == [holding(1)]
    assert 1.9 < sum(clock.slept) <= 2.0
    assert read(driver, "holding:1") == [holding(1)]
    assert sum(clock.slept) <= 2.0, "once for a connection"


def test_a_call_that_ends_before_says_so_and_the_connection_stays(start: Start, clock: Clock) -> None:
    driver, peer = start(boot_time="2 s")
    driver.timeout = 0.5
    for _ in range(2):
        with pytest.raises(DriverError, match=r"the device takes requests again in (2|1\.9\d+) s"):
            read(driver, "holding:1")
    clock.slept.append(2.0)
    driver.timeout = PATIENT
    assert read(driver, "holding:1") == [holding(1)]
    assert peer.requests() == [(3, 1, 1)]


def test_a_pause_lies_between_an_answer_and_the_next_request(start: Start, clock: Clock) -> None:
    driver, _ = start(pause="100 ms")
    read(driver, "holding:1", "holding:9", "coil:3")
    assert len(clock.slept) == 2
    assert all(0.05 < each <= 0.1 for each in clock.slept)
    read(driver, "holding:1")
    assert len(clock.slept) == 3


def test_a_pause_longer_than_the_time_of_the_call_fails_it_at_once(start: Start, clock: Clock) -> None:
    driver, peer = start(pause="1 s")
    read(driver, "holding:1")
    slept, driver.timeout = len(clock.slept), 0.1
    with pytest.raises(DriverError, match=r"recovering: the device takes the next request in (1 s|9\d\d ms)"):
        read(driver, "holding:1")
    assert len(clock.slept) == slept
    driver.timeout = PATIENT
    assert read(driver, "holding:1") == [holding(1)]
    assert peer.requests() == [(3, 1, 1)] * 2


# Devices with fewer functions and smaller requests -------------------------------------------------------


def test_no_request_has_more_registers_than_the_device_takes(start: Start) -> None:
    driver, peer = start(max_registers=50)
    texts = [f"holding:{i}" for i in range(120)]
    assert read(driver, *texts) == [holding(i) for i in range(120)]
    write(driver, dict.fromkeys(texts, 5))
    assert [each[:3] for each in peer.requests()] == [
        (3, 0, 50), (3, 50, 50), (3, 100, 20), (16, 0, 50), (16, 50, 50), (16, 100, 20)
    ]  # fmt: skip
    assert read(driver, *(f"discrete:{i}" for i in range(200)))
    assert peer.requests()[6:] == [(2, 0, 200)], "bits are not counted"
    with pytest.raises(WiringError, match="takes 2 registers; max_registers is 1"):
        Modbus(max_registers=1).channel("holding:3:int32")


def test_a_device_without_functions_5_and_6_is_written_by_15_and_16(start: Start) -> None:
    driver, peer = start(write_multiple=True)
    write(driver, {"coil:3": 1, "holding:4": 9})
    driver.write(driver.channel("holding:5.3"), 1)
    word = holding(5) | 8
    assert peer.requests() == [(15, 3, 1, 1), (16, 4, 1, 9), (3, 5, 1), (16, 5, 1, word)]


@pytest.mark.parametrize(
    "options",
    [
        {"echo": True},
        {"boot_time": "1 s", "serial": "/dev/ttyUSB0"},
        {"pause": "-1 s"},
        {"boot_time": 0},
        {"max_registers": 0},
        {"max_registers": 126},
    ],
)
def test_an_option_beyond_its_range_is_named(options: dict[str, Any]) -> None:
    with pytest.raises(WiringError, match=next(iter(options))):
        Modbus(**options)


# Values that mean "none" --------------------------------------------------------------------------------


class Inverter(Compound):
    power: DigitalSensor
    level: DigitalSensor


@pytest.mark.parametrize(
    ("kind", "words", "raw"),
    [
        ("int16", [0x8000], -32768),
        ("uint32", [0xFFFF, 0xFFFF], 0xFFFF_FFFF),
        ("int32", [0x8000, 0], -(2**31)),
        ("int64", [0x8000, 0, 0, 0], -(2**63)),
        ("uint64", [0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF], None),
        ("float32:0.1", [0x7FC0, 0], None),
    ],
)
def test_a_value_that_means_none_is_no_measurement(start: Start, kind: str, words: list[int], raw: int | None) -> None:
    """An inverter at night answers 0x8000 of every register; a sleeping meter NaN."""
    driver, peer = start()
    write(driver, {f"holding:{10 + i}": word for i, word in enumerate(words)})
    invalid = {} if raw is None else {"invalid_raws": [raw]}
    machine = Inverter(
        power=DigitalSensor("W", minimum=0.0, maximum=30_000.0, resolution=1.0, on_error="mark", **invalid),
        level=DigitalSensor("count", minimum=0, maximum=65535, resolution=1.0, on_error="mark"),
    )
    box = {"type": "modbus", "port": peer.port, "timeout": "10 s"}
    wire = {
        "power": {"driver": "box", "channel": f"holding:10:{kind}"},
        "level": {"driver": "box", "channel": "holding:3"},
    }
    with connect(machine, {"drivers": {"box": box}, "wire": wire}) as m:
        periods(m, 1)
        assert m.power.quality is Quality.BAD
        assert m.level.quality is Quality.GOOD
        assert m.level.read() == holding(3)


def test_a_reading_that_fails_names_its_own_channel(start: Start) -> None:
    driver, _ = start()
    write(driver, {"holding:10": 0x7FC0, "holding:11": 0})
    with pytest.raises(ChannelsFailed) as caught:
        read(driver, "holding:10:float32:0.1", "holding:3")
    assert list(caught.value.causes) == ["holding:10:float32:0.1"]

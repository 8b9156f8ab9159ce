"""A channel that stays broken: nothing grows, though the garbage collector is off while a machine runs."""

from __future__ import annotations

import gc
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np
import pytest

from helpers.fmus import tank_fmu
from helpers.machines import sensor, timer
from helpers.peers.line_server import line_server
from helpers.peers.modbus_device import running
from umo import Compound, DigitalSensor, connect
from umo.drivers import Channel, ChannelsFailed, DeviceTimeout, Direction, Driver, DriverError, IntArray
from umo.drivers.counter import Counter
from umo.drivers.gpio import Gpio
from umo.drivers.iio import Iio
from umo.drivers.iio import sysfs as kernels_files
from umo.drivers.modbus import Modbus
from umo.drivers.registers.driver import RegisterDriver
from umo.drivers.streams import hosts
from umo.drivers.text import Text
from umo.testing import VirtualTimer, periods

CALLS = 60
Action = Callable[[], object]


def kept(action: Action) -> int:
    """Exceptions, tracebacks and frames that are left of `CALLS` calls, the first ones aside."""

    def count() -> int:
        return sum(isinstance(each, BaseException | TracebackType | FrameType) for each in gc.get_objects())

    for _ in range(3):
        action()
    gc.collect()
    gc.disable()
    try:
        before = count()
        for _ in range(CALLS):
            action()
        return count() - before
    finally:
        gc.enable()


def fails(call: Action) -> None:
    try:
        call()
    except OSError:
        return
    raise AssertionError("it did not fail")


def transfers(driver: Driver[Any], *texts: str, write: bool = False) -> Iterator[Action]:
    """Of these channels together, and of each by itself."""
    channels = tuple(map(driver.channel, texts))
    raws = np.zeros(len(channels), np.int64)
    yield partial(driver.write_many if write else driver.read_many, channels, raws)
    for each in channels:
        yield partial(driver.write, each, 0) if write else partial(driver.read, each)


@contextmanager
def opened(driver: Driver[Any], timeout: float = 10.0) -> Iterator[Driver[Any]]:
    driver.timeout = timeout
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


def assert_lets_go(driver: Driver[Any], *texts: str, write: bool = False) -> None:
    for call in transfers(driver, *texts, write=write):
        assert kept(partial(fails, call)) <= 2, call


# Drivers by themselves ------------------------------------------------------------------------------


class Small(Driver):
    """A driver of five functions: `bad` fails, `late` times out."""

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 16)

    def read(self, channel: Channel) -> int:
        self.write(channel, 0)
        return 0

    def write(self, channel: Channel, raw: int) -> None:
        if channel.text == "bad":
            raise DriverError("broken")
        if channel.text == "late":
            raise DeviceTimeout("no answer")


@pytest.mark.parametrize("texts", [("good", "bad"), ("bad", "late")])
@pytest.mark.parametrize("write", [False, True])
def test_the_blocks_of_a_small_driver(texts: tuple[str, ...], write: bool) -> None:
    together, *_ = transfers(Small(), *texts, write=write)
    assert kept(partial(fails, together)) <= 2


def test_a_driver_that_hands_its_errors_to_channels_failed() -> None:
    """As drivers of users do."""

    def read_many() -> None:
        failed: dict[str, Exception | str] = {}
        for text in ("a", "b"):
            try:
                raise DriverError("broken")
            except DriverError as error:
                failed[text] = error
        raise ChannelsFailed(failed)

    assert kept(partial(fails, read_many)) <= 2


def test_modbus() -> None:
    with running("quiet") as peer, opened(Modbus(port=peer.port)) as driver:
        out_of_the_map = ("holding:900", "coil:9000", "input:700:int32")
        assert_lets_go(driver, *out_of_the_map)
        assert_lets_go(driver, *out_of_the_map[:2], write=True)


def test_modbus_wide_values() -> None:
    with running("quiet") as peer, opened(Modbus(port=peer.port)) as driver:
        too_large = tuple(f"holding:{i}:float64:1e-12" for i in range(0, 40, 4))
        together, *_ = transfers(driver, "holding:400", *too_large)
        assert kept(partial(fails, together)) <= 2


def test_modbus_that_nobody_serves() -> None:
    with running("quiet") as peer:
        driver = Modbus(port=peer.port)
        driver.timeout = 10.0
        driver.open()
    assert_lets_go(driver, "holding:0", "coil:9")
    driver.close()


def text_driver(port: int, host: str = "127.0.0.1", **options: Any) -> Text:
    channels: dict[str, Any] = {name: {"ask": f"{name}?", "set": f"{name} {{}}", "acknowledge": "OK"} for name in "abc"}
    return Text(host=host, port=port, channels=channels, errors=("ERR*",), **options)


@pytest.mark.parametrize("answer", [b"ERR 1\n", b"nonsense\n", b"NAN\n", None])
def test_text(answer: bytes | None) -> None:
    def answers(line: str) -> bytes | None:
        return b"1\n" if line == "a?" else answer

    with line_server(answers) as server, opened(text_driver(server.port)) as driver:
        for write in (False, True):
            together, *_, last = transfers(driver, *"abc", write=write)
            assert kept(partial(fails, together)) <= 2
            assert kept(partial(fails, last)) <= 2


def test_text_where_several_answers_come_in_one_line() -> None:
    with line_server(lambda line: b"1;ERR;x\n") as server, opened(text_driver(server.port, together=";")) as driver:
        together, *_ = transfers(driver, *"abc")
        assert kept(partial(fails, together)) <= 2


def test_a_device_that_refuses_connections() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    driver = text_driver(port)
    driver.timeout = 10.0
    fails(driver.open)
    assert_lets_go(driver, "a", "b")


def test_a_host_whose_name_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(hosts.socket, "getaddrinfo", unknown)
    driver = text_driver(5025, "psu.example")
    fails(driver.open)
    assert_lets_go(driver, "a")


def test_fmu(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    from umo.drivers.fmu import Fmu

    driver = Fmu(model=tank_fmu(tmp_path, 2))
    driver.period = 0.1
    with opened(driver):
        driver.write(driver.channel("count"), 13)  # "odd" is NaN then
        assert_lets_go(driver, "odd:0.01")
        driver.write(driver.channel("count"), 16)  # and refused then
        together, *_ = transfers(driver, "odd:0.01", "doubled")
        assert kept(partial(fails, together)) <= 2
        assert_lets_go(driver, "broken:1", write=True)


class Chip(RegisterDriver):
    """Registers that do not answer."""

    def _connect(self) -> None:
        self._bus = BytesIO()

    def _get(self, address: int, size: int) -> bytes:
        raise OSError(6, "No such device or address")

    def _put(self, address: int, data: bytes) -> None:
        raise OSError(6, "No such device or address")


def test_registers() -> None:
    tables = {"one": {"address": 1}, "two": {"address": 2}}
    with opened(Chip(tables, None, False, {}, {}, 8)) as driver:
        assert_lets_go(driver, "one", "two")
        assert_lets_go(driver, "one", "two", write=True)


def test_iio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "iio:device0"
    folder.mkdir()
    (folder / "name").write_text("adc")
    (folder / "in_voltage0_raw").write_text("nothing")
    (folder / "out_voltage0_raw").mkdir()
    monkeypatch.setattr(kernels_files, "SYSFS", tmp_path)
    with opened(Iio(device="adc")) as driver:
        assert_lets_go(driver, "in_voltage0", "out_voltage0")
        assert_lets_go(driver, "out_voltage0", write=True)


def test_files_that_are_not_there() -> None:
    for driver, texts in ((Counter(device="counter9"), ("count:0", "count:1")), (Gpio(chip="/no/chip"), ("line:1",))):
        fails(driver.open)
        assert_lets_go(driver, *texts)


# A machine -----------------------------------------------------------------------------------------


class Hoarder(Small):
    """A driver that keeps its errors: one, which it raises again and again, and in a frame of its own."""

    error = DriverError("broken")

    def read_many(self, channels: Any, out: IntArray) -> None:
        found = None
        try:
            raise self.error
        except DriverError as error:
            found = error
        raise DriverError("not read") from found


class Pair(Compound):
    timer: DigitalSensor
    one: DigitalSensor
    two: DigitalSensor


@pytest.mark.parametrize("box", [Small(), Hoarder()])
def test_a_machine_that_goes_on_with_a_broken_channel_does_not_grow(box: Driver) -> None:
    machine = Pair(timer=timer(), one=sensor(on_error="mark"), two=sensor(on_error="mark"))
    wire = {"timer": {"driver": "clock", "period": "1 ms"}}
    wire |= {name: {"driver": "box", "channel": text} for name, text in (("one", "bad"), ("two", "good"))}
    with connect(machine, {"drivers": {"box": box, "clock": VirtualTimer()}, "wire": wire}) as m:
        assert kept(lambda: periods(m, 1)) <= 2
        assert kept(m.one.sample) <= 2
        assert str(m.one.quality) == "BAD"

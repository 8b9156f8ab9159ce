"""Looking for a device without waiting (`Driver.look`): Modbus against libmodbus's peer, text against a line server; a
living device beside a dead one."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

import numpy as np
import pytest

from helpers.machines import relay, sensor, switch, timer
from helpers.peers.hostile import hostile
from helpers.peers.line_server import LineServer, line_server
from helpers.peers.modbus_device import Peer, running
from helpers.waiting import until
from umo import BinaryActuator, Compound, DigitalSensor, Quality, connect
from umo.drivers import DeviceTimeout, Driver, DriverError
from umo.drivers.modbus import Modbus
from umo.drivers.streams import Gone, Host, Look, TimedOut
from umo.drivers.text import Text
from umo.states import OnOff
from umo.testing import VirtualTimer, periods

pytest.importorskip("pymodbus")
pytest.importorskip("serial")
HASTY = 0.05
PATIENT = 10.0


@contextmanager
def stopped(peer: Peer) -> Iterator[None]:
    """The device's process is stopped: its connections are accepted by the kernel, and nothing is answered."""
    os.kill(peer.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(peer.process.pid, signal.SIGCONT)


def found(driver: Driver[Any]) -> bool:
    """The outcome of a look, asked for as often as it takes."""
    outcome: list[bool] = []

    def look() -> bool:
        try:
            answer = driver.look()
        except OSError:
            answer = False
        outcome[:] = [] if answer is None else [answer]
        return bool(outcome)

    until(look)
    return outcome[0]


def read(driver: Driver[Any], text: str) -> int:
    out = np.zeros(1, np.int64)
    driver.read_many((driver.channel(text),), out)
    return int(out[0])


@contextmanager
def modbus(peer: Peer, **options: Any) -> Iterator[Modbus]:
    place = {"serial": peer.path, "baudrate": 115200, "recovery": "20 ms"} if peer.path else {"port": peer.port}
    driver = Modbus(**place, **options)
    driver.timeout = PATIENT
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


@pytest.fixture(params=[0, "rtu"], ids=["tcp", "rtu"])
def peer(request: pytest.FixtureRequest) -> Iterator[Peer]:
    with running(request.param) as peer:
        yield peer


# Modbus -------------------------------------------------------------------------------------------------


def test_a_modbus_device_that_is_stopped_is_not_found_until_it_goes_on(peer: Peer) -> None:
    with modbus(peer) as driver:
        value = read(driver, "holding:3")
        with stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "holding:3")
            assert not found(driver)
            assert not found(driver)
        until(lambda: found(driver))
        driver.timeout = PATIENT
        assert read(driver, "holding:3") == value


def test_the_first_step_of_a_look_knows_nothing_of_a_stopped_device(peer: Peer) -> None:
    with modbus(peer) as driver, stopped(peer):
        driver.timeout = HASTY
        with pytest.raises(DeviceTimeout):
            read(driver, "holding:3")
        driver.timeout = PATIENT
        assert [driver.look() for _ in range(3)] == [None] * 3


def test_a_device_that_answered_the_last_request_is_found_without_another_one(peer: Peer) -> None:
    with modbus(peer) as driver:
        read(driver, "holding:3")
        if not peer.path:
            asked = len(peer.requests())
            assert driver.look() is True
            read(driver, "holding:3")
            assert len(peer.requests()) == asked + 1


def test_a_unit_without_inputs_is_asked_for_what_it_is_sent(peer: Peer) -> None:
    with modbus(peer) as driver:
        with stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                driver.write(driver.channel("coil:3"), 1)
            driver.timeout = PATIENT
            assert driver.look() is None
        until(lambda: found(driver))
        assert peer.requests()[-1] == (1, 3, 1)


def test_an_exception_is_an_answer(peer: Peer) -> None:
    with modbus(peer) as driver:
        with pytest.raises(DriverError, match="illegal data address"):
            read(driver, "holding:65535")
        with stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "holding:65535")
            driver.timeout = PATIENT
        until(lambda: found(driver))


def test_a_device_that_refuses_connections_is_not_found() -> None:
    with running() as peer, modbus(peer) as driver:
        peer.stop()
        with pytest.raises(DriverError):
            read(driver, "holding:3")
        assert not found(driver)


def test_a_call_during_a_look_is_answered_on_a_connection_of_its_own(peer: Peer) -> None:
    with modbus(peer) as driver:
        value = read(driver, "holding:3")
        with stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "holding:3")
            driver.timeout = PATIENT
            driver.look()
        assert read(driver, "holding:3") == value
        assert read(driver, "holding:3") == value


def test_a_look_on_a_line_that_units_share_leaves_the_line_alone() -> None:
    with running("rtu") as peer, modbus(peer) as one, modbus(peer, unit=2):
        asked = len(peer.requests())
        assert one.look() is True
        assert len(peer.requests()) == asked


def test_looks_leave_no_descriptor_behind(peer: Peer) -> None:
    with modbus(peer) as driver:
        read(driver, "holding:3")
        with stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "holding:3")
            before = len(os.listdir("/proc/self/fd"))
            for _ in range(5):
                found(driver)
            assert len(os.listdir("/proc/self/fd")) <= before


def test_a_driver_that_is_closed_during_a_look_leaves_no_descriptor_behind() -> None:
    with running() as peer:
        before = len(os.listdir("/proc/self/fd"))
        with modbus(peer) as driver, stopped(peer):
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "holding:3")
            driver.timeout = PATIENT
            assert driver.look() is None
            driver.close()
            assert len(os.listdir("/proc/self/fd")) == before


# Text ---------------------------------------------------------------------------------------------------

CHANNELS = {"level": {"ask": "L?"}, "valve": {"set": {"0": "V 0", "1": "V 1"}}}


class Device:
    """Answers a level, as long as it is not silent."""

    def __init__(self) -> None:
        self.silent = False

    def __call__(self, line: str) -> bytes:
        return b"" if self.silent else b"7\n" if line == "L?" else b"ACME 1\n" if line == "ID?" else b""


@contextmanager
def text(**options: Any) -> Iterator[tuple[Text, Device, LineServer]]:
    device = Device()
    with line_server(device) as server:
        driver = Text(channels=CHANNELS, host="127.0.0.1", port=server.port, **options)
        driver.timeout = PATIENT
        driver.open()
        try:
            yield driver, device, server
        finally:
            driver.close()


@pytest.mark.parametrize(
    ("options", "last"),
    [({}, "L?"), ({"identify": {"ask": "ID?", "answer": "ACME*"}}, "L?"), ({"quiet": 0.05}, "L?")],
)
def test_a_text_device_is_asked_what_is_read_anyway_and_found_when_it_answers(options: Any, last: str) -> None:
    with text(**options) as (driver, device, server):
        assert read(driver, "level") == 7
        device.silent = True
        driver.timeout = HASTY
        with pytest.raises(DeviceTimeout):
            read(driver, "level")
        assert not found(driver)
        assert server.received[-1] == last
        device.silent = False
        driver.timeout = PATIENT
        assert found(driver)
        connections = server.connections
        assert read(driver, "level") == 7
        assert server.connections == connections


def test_a_text_device_that_is_never_asked_is_identified_or_else_connected() -> None:
    for options, last in (({"identify": {"ask": "ID?", "answer": "ACME*"}}, "ID?"), ({}, "V 1")):
        with text(**options) as (driver, _, server):
            driver.write(driver.channel("valve"), 1)
            until(lambda server=server: server.received[-1:] == ["V 1"])
            server.clients[-1].shutdown(2)
            until(lambda driver=driver, server=server: found(driver) and server.connections == 2)
            assert server.received[-1] == last


def test_a_text_device_on_a_serial_line_is_found_after_its_quiet_time_and_is_used_at_once() -> None:
    silent: list[bool] = []

    def answer(data: bytes) -> tuple[int, bytes]:
        size = data.find(b"\n") + 1
        return size, b"" if silent else b"7\n"

    with hostile(answer, ["right"], line=True) as peer:
        driver = Text(channels={"level": {"ask": "L?"}}, serial=peer.path, quiet=0.03)
        driver.timeout = PATIENT
        driver.open()
        try:
            assert read(driver, "level") == 7
            silent.append(True)
            driver.timeout = HASTY
            with pytest.raises(DeviceTimeout):
                read(driver, "level")
            assert not found(driver)
            silent.clear()
            until(lambda: found(driver))
            asked = peer.met["right"]
            driver.timeout = PATIENT
            assert read(driver, "level") == 7
            assert peer.met["right"] == asked + 1
        finally:
            driver.close()


# Streams ------------------------------------------------------------------------------------------------


def test_a_look_finds_the_addresses_of_a_name_without_waiting_and_gives_the_stream_on_which_it_was_answered() -> None:
    with line_server(lambda line: b"yes\n") as server:
        look = Look(Host("localhost", server.port).dial())
        assert look.found() is None
        look.begin(b"there?\n", lambda data: data.endswith(b"\n"), PATIENT)
        stream = until(look.found)
        assert not look.under_way
        stream.send(b"again?\n", monotonic() + PATIENT)
        assert stream.receive(monotonic() + PATIENT) == b"yes\n"
        stream.close()


def test_a_look_raises_what_is_wrong_and_begins_anew() -> None:
    with line_server(lambda line: b"yes\n") as server:
        dial = Host("127.0.0.1", server.port).dial()
    look = Look(dial)
    for _ in range(2):
        look.begin(b"there?\n", bool, PATIENT)
        with pytest.raises(Gone, match="refused"):
            until(look.found)
        assert not look.under_way


def test_a_look_without_an_answer_ends_with_its_time_and_closes_its_stream() -> None:
    with line_server(lambda line: b"") as server:
        look = Look(Host("127.0.0.1", server.port).dial())
        look.begin(b"there?\n", bool, HASTY)
        with pytest.raises(TimedOut, match="no answer"):
            until(look.found)
        until(lambda: server.clients[0].fileno() < 0)  # its end has come there


# A machine ----------------------------------------------------------------------------------------------


class Pair(Compound):
    timer: DigitalSensor
    near: list[Any]
    far: list[Any]
    valve: BinaryActuator[OnOff]


def pair() -> Pair:
    keep = {"on_error": "hold", "max_age": "1000 s"}
    return Pair(
        timer=timer(),
        near=[sensor(), switch()],
        far=[sensor(**keep), switch(**keep)],
        valve=relay(on_error="retry", max_age="1000 s"),
    )


def wiring(living: Peer, far: Modbus) -> dict[str, Any]:
    return {
        "drivers": {
            "near": {"type": "modbus", "port": living.port, "timeout": f"{PATIENT} s"},
            "far": {"type": far, "timeout": f"{HASTY} s"},
            "clock": RealClock(),
        },
        "wire": {
            "timer": {"driver": "clock", "period": "5 ms"},
            "near.0": {"driver": "near", "channel": "input:0"},
            "near.1": {"driver": "near", "channel": "discrete:0"},
            "far.0": {"driver": "far", "channel": "input:0"},
            "far.1": {"driver": "far", "channel": "discrete:0"},
            "valve": {"driver": "far", "channel": "coil:3"},
        },
    }


class RealClock(VirtualTimer):
    realtime = True


class Counting(Modbus):
    """Counts the transfers that it is asked for."""

    transfers = 0

    def read_many(self, channels: Any, out: Any) -> None:
        self.transfers += 1
        super().read_many(channels, out)

    def write_many(self, channels: Any, raws: Any) -> None:
        self.transfers += 1
        super().write_many(channels, raws)


def test_a_living_modbus_device_is_asked_in_every_period_beside_one_that_is_stopped_for_which_one_waits() -> None:
    m = pair()
    with running() as living, running() as dead:
        far = Counting(port=dead.port)
        with connect(m, wiring(living, far)):
            periods(m, 3)
            asked, tried = len(living.requests()), far.transfers
            with stopped(dead):
                periods(m, 200)
                assert far.transfers == tried + 1
                assert len(living.requests()) == asked + 400
            m.valve.write(OnOff.ON)

            def is_back() -> bool:
                periods(m)
                living.requests(), dead.requests()  # what they log must not fill their pipes
                return m.far[0].quality is not Quality.STALE and m.valve.read() is OnOff.ON

            until(is_back)
            assert dead.requests()[-1] == (5, 3, 1, 1)

"""The Modbus driver on a serial line: units made with libmodbus (modbus_peer.c) behind a pseudo-terminal."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest

from helpers.peers.modbus_device import PATIENT, Peer, running
from helpers.peers.modbus_map import coil, discrete, holding, input_register
from helpers.waiting import until
from umo import Compound, DigitalActuator, DigitalSensor, check, connect
from umo.drivers.modbus import Modbus, rtu, serial_line, unit
from umo.drivers.modbus.serial_line import SerialLine
from umo.drivers.streams import line, stream
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError, WiringError

pytest.importorskip("pymodbus")
pytest.importorskip("serial")

HASTY = 0.1
RECOVERY = 60.0
"""s, longer than any test."""
Start = Callable[..., Peer]
Unit = Callable[..., Modbus]


@pytest.fixture
def start() -> Iterator[Start]:
    """start(*faults): the units 1 to 3 of a line."""
    with ExitStack() as stack:
        yield lambda *faults: stack.enter_context(running("rtu", *faults))


@pytest.fixture
def connected() -> Iterator[Unit]:
    """connected(peer, **options): an open driver."""
    drivers: list[Modbus] = []

    def connected(peer: Peer, **options: Any) -> Modbus:
        driver = Modbus(serial=peer.path, **{"recovery": "20 ms", "baudrate": 115200} | options)
        driver.timeout = PATIENT
        drivers.append(driver)
        driver.open()
        return driver

    yield connected
    for driver in drivers:
        driver.close()
    check_that_no_line_is_kept(*(driver.place for driver in drivers))


def check_that_no_line_is_kept(*places: Any) -> None:
    """A line that this process still has keeps its settings: it is refused with others."""
    for place in places:
        SerialLine.join(replace(place, baudrate=300)).leave()


class Clock:
    """The clock of the driver and its line, which may be set ahead."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.ahead = 0.0
        for module in (rtu, serial_line, unit, line, stream):
            patch.setattr(module, "monotonic", lambda: monotonic() + self.ahead)

    def recovered(self) -> None:
        """So much time passes that nothing recovers any more."""
        self.ahead += RECOVERY


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def read(driver: Modbus, *texts: str) -> list[int]:
    out = np.full(len(texts), -99, np.int64)
    driver.read_many([driver.channel(text) for text in texts], out)
    return out.tolist()


def one(driver: Modbus, text: str) -> int:
    return driver.read(driver.channel(text))


# Options -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"host": "10.0.0.7"}, "host is for TCP: give host and port, or serial and baudrate, not both"),
        ({"port": 502}, "port is for TCP"),
        ({"serial": ""}, "serial must name a device file"),
        ({"baudrate": 0}, "baudrate must be a whole number from 50 to 4000000, not 0"),
        ({"parity": "evn"}, "parity must be one of 'none', 'even', 'odd', 'mark', 'space', not 'evn'"),
        ({"stop_bits": 3}, "stop_bits must be one of 1, 2, not 3"),
        (
            {"unit": 0},
            r"from 1 to 247 on a serial line \(0 is a broadcast, which no unit confirms\), not 0",
        ),
        ({"unit": 248}, "unit must be a whole number from 1 to 247"),
    ],
)
def test_options_that_do_not_fit_a_serial_line_are_refused_before_anything_is_opened(options: Any, words: str) -> None:
    with pytest.raises(WiringError, match=words):
        Modbus(**{"serial": "/dev/ttyUSB0"} | options)


def test_a_wiring_names_the_option_that_is_wrong() -> None:
    wiring = {"drivers": {"io": {"type": "modbus", "serial": "/dev/ttyS0", "host": "10.0.0.7"}}, "wire": {}}
    (fault,) = check(Compound(), wiring)
    assert "host is for TCP" in str(fault)


def test_every_spelling_of_a_line_is_the_same_device_whatever_the_unit(tmp_path: Path) -> None:
    (tmp_path / "line").symlink_to("/dev/null")
    assert Modbus(serial=str(tmp_path / "line"), unit=7).devices() == ["serial /dev/null"]
    assert Modbus(serial="/dev/../dev/null").devices() == ["serial /dev/null"]


# Values and requests -------------------------------------------------------------------------------


def test_blocks_up_to_the_protocol_s_maxima_go_through(start: Start, connected: Unit) -> None:
    peer = start()
    driver = connected(peer)
    assert read(driver, *(f"input:{i}" for i in range(130))) == [input_register(i) for i in range(130)]
    assert read(driver, *(f"discrete:{i}" for i in range(2001))) == [discrete(i) for i in range(2001)]
    driver.write_many([driver.channel(f"holding:{i}") for i in range(124)], np.arange(124))
    assert read(driver, *(f"holding:{i}" for i in range(124))) == list(range(124))
    asked = [(4, 0, 125), (4, 125, 5), (2, 0, 2000), (2, 2000, 1), (16, 0, 123), (6, 123, 1), (3, 0, 124)]
    assert [request[:3] for request in peer.requests()] == asked


@pytest.mark.parametrize("parity", ["even", "odd", "none"])
@pytest.mark.parametrize("read_write", [False, True])
def test_what_is_written_is_what_the_unit_holds(start: Start, connected: Unit, parity: str, read_write: bool) -> None:
    driver = connected(start(), parity=parity, stop_bits=2, baudrate=19200, read_write=read_write)
    texts = ["coil:1", "coil:2", "holding:0:int16", "holding:4:int64", "coil:9", "holding:20:float64:0.01"]
    raws = [1, 0, -5, -(2**40), 1, 12345]
    driver.write_many([driver.channel(text) for text in texts], np.array(raws))
    assert read(driver, *texts) == raws
    for text, raw in zip(texts, raws, strict=True):
        driver.write(driver.channel(text), raw)
        assert one(driver, text) == raw


@pytest.mark.skipif(shutil.which("mbpoll") is None, reason="needs Debian's mbpoll")
@pytest.mark.parametrize("place", ["rtu", 0])
def test_mbpoll_reads_what_the_driver_wrote(place: int | str) -> None:
    with running(place) as peer:
        where = {"serial": peer.path, "parity": "even"} if peer.path else {"port": peer.port}
        driver = Modbus(unit=2, **where)  # type: ignore[arg-type]
        driver.timeout = PATIENT
        driver.open()
        driver.write_many([driver.channel(f"holding:{10 + i}") for i in range(3)], np.array([11, 22, 33]))
        driver.write(driver.channel("holding:13:float32:0.5"), 7)
        driver.write(driver.channel("coil:7"), 1)
        driver.close()
        assert polled(peer, "4", 11, 3) == ["11", "22", "33"]
        assert polled(peer, "4:float", 14, 1) == ["3.5"]
        assert polled(peer, "0", 8, 1) == ["1"]


def polled(peer: Peer, kind: str, reference: int, count: int) -> list[str]:
    """What mbpoll shows of unit 2; it counts from 1."""
    way = ["-m", "rtu", "-b", "19200", "-P", "even", peer.path] if peer.path else ["-p", str(peer.port), "127.0.0.1"]
    words = ["mbpoll", "-1", "-q", "-a", "2", "-B", "-t", kind, "-r", str(reference), "-c", str(count), *way]
    shown = subprocess.run(words, capture_output=True, text=True, timeout=30)
    assert shown.returncode == 0, shown.stdout + shown.stderr
    return [line.split()[1] for line in shown.stdout.splitlines() if line.startswith("[")]


# Wrong answers -------------------------------------------------------------------------------------

SPOILED = [
    ("silent", "timed out (100 ms)"),
    ("exception=2", "exception 2, illegal data address"),
    ("crc", "an answer with a wrong check sum"),
    ("truncate=6", "6 of 13 bytes of an answer came within 100 ms"),
    ("fewer", "a byte count of 6 in place of 8"),
    ("bytes=9", "a byte count of 9 in place of 8"),
    ("odd", "a byte count of 9 in place of 8"),
    ("tail", "an answer with a wrong check sum"),
    ("function=3", "an answer to function 3 in place of 4"),
    ("function=132", "an answer with a wrong check sum"),
    ("unit=2", "an answer of unit 2 in place of 1"),
    ("before=1", "an answer of unit 165 in place of 1"),
    ("before=40", "an answer of unit 165 in place of 1"),
    ("garbage", "an answer of unit 72 in place of 1"),
]
READING = [f"input:{i}" for i in range(4)]


@pytest.mark.parametrize(("fault", "words"), SPOILED)
def test_a_wrong_answer_is_an_error_that_says_why_and_the_unit_is_used_again(
    start: Start, connected: Unit, fault: str, words: str
) -> None:
    driver = connected(start(f"2:{fault}"))
    wanted = [input_register(i) for i in range(4)]
    assert read(driver, *READING) == wanted
    driver.timeout = HASTY if "100 ms" in words else PATIENT
    with pytest.raises(DriverError) as caught:
        read(driver, *READING)
    assert isinstance(caught.value, DeviceTimeout) == ("100 ms" in words)
    assert str(caught.value).startswith("unit 1: reading input registers 0 to 3: ")
    assert words in str(caught.value)
    driver.timeout = PATIENT
    assert read(driver, *READING) == wanted


@pytest.mark.parametrize(
    ("text", "raw", "fault", "words"),
    [
        ("coil:2", 1, "echo=3", "the answer confirms address 3, value 0xff00 in place of address 2, value 0xff00"),
        ("holding:2", 9, "confirm=8", "confirms address 2, value 0x8 in place of address 2, value 0x9"),
        ("holding:2:int32", 9, "confirm=3", "confirms address 2, count 0x3 in place of address 2, count 0x2"),
    ],
)
def test_a_write_that_was_not_confirmed_as_sent_has_failed(
    start: Start, connected: Unit, text: str, raw: int, fault: str, words: str
) -> None:
    peer = start(f"1:{fault}")
    driver = connected(peer)
    with pytest.raises(DriverError, match=words):
        driver.write(driver.channel(text), raw)
    driver.write(driver.channel(text), raw)
    assert len(peer.requests()) == 2, "the failed write was not repeated by itself"


def test_an_exception_answer_is_not_a_failure_of_the_line_and_the_other_requests_are_made(
    start: Start, connected: Unit, clock: Clock
) -> None:
    texts = ("input:0", "discrete:1", "holding:2")
    driver = connected(start("4:exception=2"), recovery=RECOVERY)
    clock.recovered()
    assert read(driver, *texts) == [input_register(0), discrete(1), holding(2)]
    out = np.full(3, -99, np.int64)
    with pytest.raises(ChannelsFailed) as caught:
        driver.read_many([driver.channel(text) for text in texts], out)
    assert list(caught.value.causes) == ["input:0"]
    assert out.tolist() == [-99, discrete(1), holding(2)]
    assert one(driver, "input:0") == input_register(0), "the unit does not recover from an answer"


# Late answers --------------------------------------------------------------------------------------


def test_a_late_answer_is_never_taken_for_a_later_one_of_the_same_kind(
    start: Start, connected: Unit, clock: Clock
) -> None:
    driver = connected(start("2:late=1000"), recovery=RECOVERY)
    clock.recovered()
    assert one(driver, "holding:4") == holding(4)  # else the unit still recovers from the opening
    driver.timeout = HASTY
    with pytest.raises(DeviceTimeout, match="timed out"):
        one(driver, "holding:1")
    with pytest.raises(DriverError, match="holding register 2: recovering: a late answer may still come") as caught:
        one(driver, "holding:2")
    assert not isinstance(caught.value, TimeoutError)
    clock.ahead += RECOVERY - 1.5  # the late answer comes meanwhile
    driver.timeout = PATIENT
    assert [one(driver, f"holding:{i}") for i in (2, 3, 1)] == [holding(2), holding(3), holding(1)]


def test_while_a_unit_recovers_its_other_functions_go_on(start: Start, connected: Unit, clock: Clock) -> None:
    peer = start("3:silent")
    driver = connected(peer, recovery=RECOVERY)
    clock.recovered()
    assert read(driver, "holding:1", "coil:1") == [holding(1), coil(1)]
    driver.timeout = HASTY
    with pytest.raises(DeviceTimeout):
        one(driver, "holding:1")
    driver.timeout = PATIENT
    driver.write(driver.channel("holding:1"), 7)
    driver.write(driver.channel("holding:1"), 0)
    out = np.full(2, -99, np.int64)
    with pytest.raises(ChannelsFailed) as caught:
        driver.read_many([driver.channel("holding:1"), driver.channel("coil:1")], out)
    assert list(caught.value.causes) == ["holding:1"]
    assert out[1] == coil(1)
    assert peer.requests()[3:] == [(6, 1, 1, 7), (6, 1, 1, 0), (1, 1, 1)]


def test_a_call_waits_for_the_end_of_the_recovery_if_that_leaves_it_half_of_its_time(
    start: Start, connected: Unit
) -> None:
    peer = start("1:silent")
    driver = connected(peer, recovery="200 ms")
    driver.timeout = 0.6
    with pytest.raises(DeviceTimeout):
        one(driver, "holding:1")
    assert one(driver, "holding:2") == holding(2)
    assert peer.requests() == [(3, 1, 1), (3, 2, 1)]


def test_the_late_answer_itself_ends_the_recovery(start: Start, connected: Unit, clock: Clock) -> None:
    driver = connected(start("2:late=150"), recovery=RECOVERY)
    clock.recovered()
    assert one(driver, "holding:1") == holding(1)
    driver.timeout = HASTY
    with pytest.raises(DeviceTimeout):
        one(driver, "holding:1")
    until(lambda: recovered(lambda: one(driver, "holding:2")) == holding(2))


def recovered(call: Callable[[], Any]) -> Any:
    """What the call returns; None while the unit recovers."""
    try:
        return call()
    except DriverError as error:
        assert re.search("recovering|timed out", str(error))  # a busy computer may answer late once more
        return None


@pytest.mark.parametrize("fault", ["crc", "truncate=6", "before=1", "before=3", "tail"])
def test_an_answer_that_came_damaged_is_not_waited_for(start: Start, connected: Unit, clock: Clock, fault: str) -> None:
    """On a noisy line each hit costs one reading, and not all that fall into the time of a recovery."""
    peer = start(f"2:{fault}")
    driver = connected(peer, recovery=RECOVERY)
    clock.recovered()
    assert read(driver, *READING) == [input_register(i) for i in range(4)]
    driver.timeout = HASTY
    with pytest.raises(DriverError):
        read(driver, *READING)
    driver.timeout = PATIENT
    # the rest of the answer may still be on its way
    assert until(lambda: recovered(lambda: read(driver, *READING))) == [input_register(i) for i in range(4)]
    assert len(peer.requests()) == 3


@pytest.mark.parametrize("fault", ["silent", "unit=2", "fewer", "odd", "function=3", "garbage"])
def test_what_is_not_known_for_the_answer_leaves_the_unit_recovering(
    start: Start, connected: Unit, clock: Clock, fault: str
) -> None:
    driver = connected(start(f"2:{fault}"), recovery=RECOVERY)
    clock.recovered()
    read(driver, *READING)
    driver.timeout = HASTY
    with pytest.raises(DriverError):
        read(driver, *READING)
    driver.timeout = PATIENT
    for _ in range(3):
        with pytest.raises(DriverError, match="recovering: a late answer may still come"):
            read(driver, *READING)


def test_a_line_that_was_opened_again_begins_with_a_recovery(start: Start, connected: Unit, clock: Clock) -> None:
    peer = start("1:late=600")
    driver = connected(peer, recovery="800 ms")
    clock.recovered()
    driver.timeout = HASTY
    with pytest.raises(DeviceTimeout):
        one(driver, "holding:1")
    driver.close()
    driver.timeout = PATIENT
    driver.open()
    assert one(driver, "holding:2") == holding(2)


def test_what_comes_in_unasked_between_two_requests_is_discarded(start: Start, connected: Unit) -> None:
    peer = start("1:unasked")
    driver = connected(peer)
    with suppress(DriverError):  # if both answers came at once
        read(driver, "holding:1")
    peer.wait_for("twice")
    assert [one(driver, f"holding:{i}") for i in (2, 3)] == [holding(2), holding(3)]


def test_a_line_that_is_never_silent_times_out_before_anything_is_sent(start: Start, connected: Unit) -> None:
    peer = start("1:trickle=1")
    driver = connected(peer, baudrate=150)  # 3.5 characters: 0.26 s, for which a busy computer does not stop the peer
    driver.timeout = 0.5
    with pytest.raises(DriverError, match="an answer of unit 255 in place of 1"):
        one(driver, "holding:1")
    with pytest.raises(DeviceTimeout, match="reading holding register 2: the line was not silent within 500 ms"):
        one(driver, "holding:2")
    assert peer.requests() == [(3, 1, 1)]


# Several units -------------------------------------------------------------------------------------


class Two(Compound):
    motor: DigitalActuator
    speed: DigitalSensor
    level: DigitalSensor
    lost: DigitalSensor


def two() -> Two:
    return Two(
        motor=DigitalActuator("count", default=0.0, minimum=0.0, maximum=60_000.0, resolution=1.0),
        speed=DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0),
        level=DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0),
        lost=DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0, on_error="hold", max_age=60.0),
    )


def wiring(peer: Peer, **lost: Any) -> dict[str, Any]:
    line = {"type": "modbus", "serial": peer.path, "recovery": "20 ms", "baudrate": 115200, "timeout": "1 s"}
    return {
        "drivers": {"drive": line, "meter": line | {"unit": 2}, "lost": line | {"unit": 3} | lost},
        "wire": {
            "motor": {"driver": "drive", "channel": "holding:1"},
            "speed": {"driver": "drive", "channel": "input:1"},
            "level": {"driver": "meter", "channel": "input:2"},
            "lost": {"driver": "lost", "channel": "input:3"},
        },
    }


def test_several_units_of_one_line_are_wired_as_several_drivers(start: Start) -> None:
    peer = start()
    with connect(two(), wiring(peer)) as m:
        m.motor.write(7.0)
        m.update()
        m.sample()
        assert (m.speed.read(), m.level.read()) == (input_register(1), input_register(2))
        assert m.lost.read() == input_register(3)
        assert set(peer.units()) == {1, 2, 3}
    assert peer.requests()[-1] == (6, 1, 1, 0), "the motor is reset at the end"
    check_that_no_line_is_kept(Modbus(serial=peer.path).place)


def test_a_machine_whose_timeout_is_shorter_than_the_recovery_connects(start: Start) -> None:
    hasty = wiring(start())
    for table in hasty["drivers"].values():
        table |= {"timeout": 0.2, "recovery": 0.3}
    with connect(two(), hasty) as m:
        assert m.speed.read() == input_register(1)


def test_two_objects_on_one_register_of_one_unit_are_found_and_the_same_register_of_another_is_another(
    start: Start,
) -> None:
    peer = start()
    both = wiring(peer)
    both["wire"]["level"]["channel"] = "input:1"
    assert check(two(), both) == []
    both["drivers"]["meter"]["unit"] = 1
    assert ["input:1" in str(fault) for fault in check(two(), both)] == [True]


def test_a_dead_unit_fails_for_its_own_objects_and_the_others_of_the_line_go_on(start: Start, connected: Unit) -> None:
    peer = start()
    alive = connected(peer)
    dead = connected(peer, unit=9)
    dead.timeout = HASTY
    for i in range(4):
        with pytest.raises(DriverError, match="unit 9"):
            one(dead, "input:1")
        assert one(alive, f"input:{i}") == input_register(i)


def test_a_late_answer_of_one_unit_is_not_taken_for_that_of_another(start: Start, connected: Unit) -> None:
    peer = start("3:late=150")
    first, second = connected(peer), connected(peer, unit=2)
    assert (one(first, "input:1"), one(second, "input:2")) == (input_register(1), input_register(2))
    first.timeout = HASTY
    with pytest.raises(DeviceTimeout):
        one(first, "input:3")
    assert [one(second, f"input:{i}") for i in range(4, 9)] == [input_register(i) for i in range(4, 9)]
    assert one(first, "input:5") == input_register(5)


def test_units_of_one_line_must_agree_on_its_settings(start: Start, connected: Unit) -> None:
    peer = start()
    connected(peer)
    with pytest.raises(DriverError, match=r"open at 115200 baud 8E1 for another unit, and here it is 9600 baud 8N1"):
        connected(peer, unit=2, baudrate=9600, parity="none")


# The line itself -----------------------------------------------------------------------------------


def test_a_line_that_does_not_exist_fails_at_open_and_leaves_nothing_open() -> None:
    driver = Modbus(serial="/dev/ttyUMO7")
    before = os.listdir("/proc/self/fd")
    with pytest.raises(DriverError, match="no device /dev/ttyUMO7"):
        driver.open()
    driver.close()
    assert os.listdir("/proc/self/fd") == before
    check_that_no_line_is_kept(driver.place)


@pytest.mark.parametrize("path", ["/dev/null", __file__])
def test_a_file_that_is_not_a_serial_line_fails_at_open(path: str) -> None:
    driver = Modbus(serial=path)
    with pytest.raises(DriverError, match=f"{path} cannot be used as a serial line"):
        driver.open()
    driver.close()


def test_a_line_that_another_program_has_names_that_program(start: Start, connected: Unit) -> None:
    peer = start()
    lock = "import fcntl, sys; f = open(sys.argv[1], 'rb+', 0); fcntl.flock(f, fcntl.LOCK_EX)"
    words = [sys.executable, "-c", f"{lock}; print(1, flush=True); input()", peer.path]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        other.stdout.readline()
        driver = Modbus(serial=peer.path)
        driver.timeout = HASTY
        with pytest.raises(DriverError, match=rf"{peer.path} is in use by .*pid {other.pid} "):
            driver.open()
        driver.close()
        other.communicate("\n")
    connected(peer)


def test_rs485_on_a_line_that_cannot_switch_its_direction_is_refused(start: Start) -> None:
    driver = Modbus(serial=start().path, rs485=True)
    with pytest.raises(DriverError, match="its kernel driver does not switch the direction of RS-485"):
        driver.open()
    driver.close()


def test_an_adapter_that_was_taken_out_is_an_error_and_is_opened_again_when_it_is_back(
    start: Start, tmp_path: Path
) -> None:
    peer = start()
    link = tmp_path / "line"
    link.symlink_to(peer.path)
    driver = Modbus(serial=str(link), recovery="20 ms")
    driver.timeout = PATIENT
    driver.open()
    assert one(driver, "input:1") == input_register(1)
    peer.process.kill()
    peer.process.wait()
    with pytest.raises(DriverError, match=r"unit 1: .*(the serial line is gone|put error)"):
        one(driver, "input:1")
    link.unlink()
    with pytest.raises(DriverError, match=f"no device {link}"):
        one(driver, "input:1")
    link.symlink_to(start().path)
    assert one(driver, "input:1") == input_register(1)
    driver.close()


def test_without_pyserial_the_driver_of_a_line_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [*(name for name in sys.modules if name.startswith("serial.")), "serial"]:
        monkeypatch.setitem(sys.modules, name, None)
    asked = re.escape('needs pymodbus and pyserial: pip install ".[modbus]" in the clone of umo')
    with pytest.raises(DriverError, match=asked):
        Modbus(serial="/dev/ttyUSB0").open()

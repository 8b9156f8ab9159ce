"""The driver of line protocols: options, exchanges, failures and reconnections, against a device of the test."""

from __future__ import annotations

import os
import re
import socket
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import signature
from time import monotonic
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from helpers.peers.line_server import LineServer, line_server
from helpers.waiting import until
from umo import BinaryActuator, Compound, DigitalSensor, check
from umo.drivers.contract import Driver
from umo.drivers.modbus import Modbus
from umo.drivers.streams import Stream, hosts
from umo.drivers.text import Text
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError, WiringError
from umo.states import OnOff
from umo.text import options_in

PATIENT = 10.0
HASTY = 0.05
LINE: dict[str, Any] = {"host": None, "serial": "/dev/ttyUSB0"}
CHANNELS: dict[str, Any] = {
    "a": {"ask": "A?", "set": "A {}"},
    "b": {"ask": "B?"},
    "q": {"ask": "Q?"},
    "c": {"ask": "C?", "answer": "C={}"},
    "x": {"ask": "ALL?", "answer": "{},*"},
    "y": {"ask": "ALL?", "answer": "*,{}"},
}
ANSWERS = {"A?": b"1\n", "B?": b"2\n", "C?": b"C=3\n", "ALL?": b"4,5\n", "ID?": b"ACME,7\n", "E?": b"0\n"}


def plain(line: str) -> bytes:
    return ANSWERS.get(line, b"")


@contextmanager
def opened(server: LineServer, timeout: float = PATIENT, **options: Any) -> Iterator[Text]:
    driver = Text(host="127.0.0.1", port=server.port, **{"channels": CHANNELS} | options)
    driver.timeout = PATIENT
    try:
        driver.open()
        driver.timeout = timeout
        yield driver
    finally:
        driver.close()


@contextmanager
def device(
    answer: Callable[[str], bytes | None] = plain, hello: bytes = b"", timeout: float = PATIENT, **options: Any
) -> Iterator[tuple[Text, LineServer]]:
    with line_server(answer, hello) as server, opened(server, timeout, **options) as driver:
        yield driver, server


def read(driver: Text, *names: str) -> list[int]:
    out = np.zeros(len(names), np.int64)
    driver.read_many(tuple(map(driver.channel, names)), out)
    return out.tolist()  # type: ignore[no-any-return]


def write(driver: Text, **levels: int) -> None:
    driver.write_many(tuple(map(driver.channel, levels)), np.array(list(levels.values())))


# Exchanges ----------------------------------------------------------------------------------------


def test_channels_are_read_and_set() -> None:
    with device() as (driver, server):
        assert [driver.read(driver.channel(name)) for name in "abcxy"] == [1, 2, 3, 4, 5]
        driver.write(driver.channel("a"), -7)
        assert read(driver, "b") == [2]
        assert server.received == ["A?", "B?", "C?", "ALL?", "ALL?", "A -7", "B?"]


@pytest.mark.parametrize("end", ["\r\n", "abc", "\n"])
def test_an_answer_that_comes_byte_by_byte_is_one_answer(end: str) -> None:
    near, far = socket.socketpair()
    near.setblocking(False)
    answer = f"12{end}".encode()

    class Bytewise(Stream):
        """Sees one byte at a time."""

        def receive(self, deadline: float) -> bytes:
            return answer[(i := next(places)) : i + 1]

    places = iter(range(len(answer)))
    driver = Text(host="127.0.0.1", channels=CHANNELS, answer_terminator=end)
    with near, far, patch.object(hosts.TcpDial, "__call__", lambda *_: Bytewise(near, "the end")):
        driver.open()
        assert read(driver, "a") == [12]
        driver.close()


def test_queries_are_joined_where_the_device_takes_several_in_a_line() -> None:
    def answer(line: str) -> bytes:
        return b";".join(ANSWERS[part].strip() for part in line.split(";")) + b"\n"

    with device(answer, together=";", longest_request=6) as (driver, server):
        assert read(driver, "a", "b", "c", "x", "y") == [1, 2, 3, 4, 5]
        assert server.received == ["A?;B?", "C?", "ALL?"]


def test_requests_that_set_are_joined_unless_each_is_acknowledged() -> None:
    tables = {"a": {"set": "A {}"}, "b": {"set": "B {}"}, "c": {"set": "C {}", "acknowledge": "OK"}}
    with device(lambda line: b"OK\n" if line[0] == "C" else b"", together=";", channels=tables) as (driver, server):
        write(driver, a=1, b=2, c=3)
        assert server.received[-1] == "C 3"
        assert server.received == ["A 1;B 2", "C 3"]


@pytest.mark.parametrize("answer", [b"1\n", b"1;2;3\n", b";\n"])
def test_another_number_of_joined_answers_is_an_error(answer: bytes) -> None:
    with device(lambda _: answer, together=";") as (driver, _), pytest.raises(DriverError, match=r"answers|number"):
        read(driver, "a", "b")


def test_a_request_that_sets_is_acknowledged() -> None:
    said = iter([b"OK\n", b"ERR 5\n", b"OK\n", b"what?\n", b"OK\n"])
    with device(lambda _: next(said), acknowledge="OK", errors=["ERR*"]) as (driver, server):
        write(driver, a=1)
        with pytest.raises(DriverError, match=r"the device answers 'ERR 5' to 'A 2'"):
            write(driver, a=2)
        write(driver, a=3)
        assert server.connections == 1  # an error that the device answers leaves the connection in step
        with pytest.raises(DriverError, match=r"the device answers 'what\?' to 'A 4', expected 'OK'"):
            write(driver, a=4)
        write(driver, a=5)
        assert server.connections == 2


def test_a_request_that_sets_is_confirmed_by_a_query() -> None:
    def answer(line: str) -> bytes:
        errors.extend([b"-222,range\n"] if line == "A 99" else [])
        return (errors.pop() if errors else b"0\n") if line == "E?" else b""

    errors: list[bytes] = []
    with device(answer, confirm={"ask": "E?", "answer": "0"}, errors=["-*,*"]) as (driver, server):
        write(driver, a=1)
        with pytest.raises(DriverError, match=r"'-222,range' to 'E\?' after 'A 99'"):
            write(driver, a=99)
        write(driver, a=2)
        assert server.received == ["A 1", "E?", "A 99", "E?", "A 2", "E?"]


def test_a_device_that_echoes_is_checked_by_its_echo() -> None:
    wrong: list[str] = []

    def answer(line: str) -> bytes:
        return (wrong.pop() if wrong else line).encode() + b"\r\n" + ANSWERS.get(line, b"")

    with device(answer, echo=True) as (driver, _):
        assert read(driver, "a", "b") == [1, 2]
        write(driver, a=5)
        wrong.append("B?")
        with pytest.raises(DriverError, match=r"echoes 'B\?', not 'A\?'"):
            read(driver, "a")
        assert read(driver, "a") == [1]


def test_a_value_that_does_not_fit_leaves_the_device_alone() -> None:
    tables = {"a": {"set": "A {}"}, "b": {"set": "B {}", "bits": 4}}
    with device(channels=tables) as (driver, server):
        with pytest.raises(DriverError, match="8 does not fit b: it takes -8 to 7"):
            write(driver, a=1, b=8)
        write(driver, b=7)
        driver.close()
        assert "A 1" not in server.received


def test_input_and_output_channels_keep_their_direction() -> None:
    with device(channels={"in": {"ask": "A?"}, "out": {"set": "A {}"}}) as (driver, _):
        with pytest.raises(DriverError, match="channel in cannot be written: it has no set"):
            driver.write(driver.channel("in"), 1)
        with pytest.raises(DriverError, match="channel out cannot be read: it has no ask"):
            driver.read(driver.channel("out"))


def test_the_pause_is_kept_between_an_answer_and_the_next_request() -> None:
    with device(pause=0.02) as (driver, _):
        assert read(driver, "a", "b", "c") == [1, 2, 3]
        driver.timeout = 0.03
        with pytest.raises(DeviceTimeout):  # two pauses between the three
            read(driver, "a", "b", "c")


@pytest.mark.parametrize(("text", "sent"), [("WD {ms}", "WD 500"), ("WD {s}", "WD 0.500")])
def test_the_watchdog_is_armed_by_its_request(text: str, sent: str) -> None:
    with device(lambda _: b"OK\n", watchdog_set=text, acknowledge="OK") as (driver, server):
        driver.watchdog(0.5)
        driver.watchdog(1e-5)
        driver.watchdog(0)
        assert server.received[0] == sent
        assert float(server.received[1].split()[1]) > 0 == float(server.received[2].split()[1])
        with pytest.raises(DriverError, match="is not within"):
            driver.watchdog(float("nan"))


def test_without_its_request_there_is_no_watchdog() -> None:
    with device() as (driver, _), pytest.raises(DriverError, match="needs the option watchdog_set"):
        driver.watchdog(1)


# Opening ------------------------------------------------------------------------------------------


def test_the_device_is_identified_and_started_at_each_connection() -> None:
    identify = {"ask": "ID?", "answer": "ACME,*"}
    with device(identify=identify, startup=["REMOTE"], timeout=HASTY) as (driver, server):
        with pytest.raises(DeviceTimeout):
            read(driver, "q")
        driver.timeout = PATIENT
        assert read(driver, "a") == [1]
        assert server.received == ["ID?", "REMOTE", "Q?", "ID?", "REMOTE", "A?"]


def test_another_device_is_refused() -> None:
    with line_server(plain) as server:
        driver = Text(
            host="127.0.0.1", port=server.port, channels=CHANNELS, identify={"ask": "ID?", "answer": "OTHER*"}
        )
        driver.timeout = PATIENT
        with pytest.raises(DriverError, match=r"answers 'ACME,7' to 'ID\?', expected 'OTHER\*'"):
            driver.open()
        driver.close()


def test_a_greeting_ends_the_boot_time() -> None:
    with device(hello=b"Welcome\r\nready\r\n", boot_time=30, greeting="ready") as (driver, _):
        assert read(driver, "a") == [1]


def test_a_boot_time_goes_on_from_call_to_call() -> None:
    with line_server(plain) as server:
        driver = Text(host="127.0.0.1", port=server.port, channels=CHANNELS, boot_time=1.0)
        driver.timeout = 0.03
        with pytest.raises(DeviceTimeout, match=r"has not started yet: timed out \(30 ms\)"):
            driver.open()
        with pytest.raises(DeviceTimeout):
            read(driver, "a")
        driver.timeout = PATIENT
        assert read(driver, "a") == [1]
        assert server.connections == 1
        driver.close()


def test_what_comes_before_the_line_is_quiet_is_thrown_away() -> None:
    with device(hello=b"7\n8\n", quiet=0.3) as (driver, _):
        assert read(driver, "a") == [1]


def test_a_missing_device_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    driver = Text(host="127.0.0.1", port=port, channels=CHANNELS)
    with pytest.raises(DriverError, match=r"^connecting: connection refused$"):
        driver.open()
    driver.close()
    with pytest.raises(DriverError, match="it is not open"):
        driver.read(driver.channel("a"))


# Failures -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "why"),
    [
        (b"C=x\n", "'x' is not a number"),
        (b"D=3\n", "the answer 'D=3' does not match 'C={}'"),
        (b"\n", "the answer '' does not match"),
        (b"C=3\nC=4\n", "the device sent 'C=4\\n' unasked"),
        (b"C=3\nC", "the device sent 'C' unasked"),
        (b"C=\xff3\n", "is not ascii"),
        (b"C=\x003\n", "does not match"),
        (b"C=" + b"3" * 5000 + b"\n", "is longer than 4096 bytes"),
        (b"3" * 5000, "is longer than 4096 bytes"),
        (None, "the device closed the connection"),
    ],
)
def test_an_unexpected_answer_drops_the_connection(sent: bytes | None, why: str) -> None:
    answers = iter([sent])
    with device(lambda line: next(answers) if line == "C?" else plain(line)) as (driver, server):
        with pytest.raises(DriverError, match=re.escape(why)) as raised:
            read(driver, "c")
        assert not isinstance(raised.value, TimeoutError)
        assert read(driver, "a") == [1]
        assert server.connections == 2


def test_a_timeout_drops_the_connection() -> None:
    with device(timeout=HASTY) as (driver, server):
        with pytest.raises(DeviceTimeout, match=re.escape("no answer to 'Q?': timed out (50 ms)")):
            read(driver, "q", "a")
        driver.timeout = PATIENT
        assert read(driver, "a") == [1]
        assert server.connections == 2


def test_an_answer_for_which_ctrl_c_did_not_wait_is_not_taken_for_the_next_one() -> None:
    with device() as (driver, server):
        with patch.object(Stream, "receive", side_effect=KeyboardInterrupt), pytest.raises(KeyboardInterrupt):
            read(driver, "a")
        assert read(driver, "b") == [2]
        assert server.connections == 2


def test_half_an_answer_is_shown_when_it_times_out() -> None:
    half = re.escape("the device sent '12' without the terminator '\\n': timed out (50 ms); set answer_terminator")
    with device(lambda _: b"12", timeout=HASTY) as (driver, _), pytest.raises(DeviceTimeout, match=half):
        read(driver, "a")


def test_data_that_nobody_asked_for_is_an_error_once() -> None:
    with device() as (driver, server):
        read(driver, "a")
        server.clients[0].sendall(b"ALARM 3\n")
        _wait_for_input(driver)
        with pytest.raises(DriverError, match=re.escape("the device sent 'ALARM 3\\n' unasked")):
            read(driver, "a")
        assert read(driver, "a") == [1]


def test_a_connection_that_the_device_closed_between_calls_is_opened_again() -> None:
    with device() as (driver, server):
        read(driver, "a")
        server.clients[0].shutdown(socket.SHUT_RDWR)
        _wait_for_input(driver)
        assert read(driver, "a") == [1]


def _wait_for_input(driver: Text) -> None:
    link: Any = driver._link
    assert link._stream._in.poll(PATIENT * 1000)


def test_an_error_answer_fails_for_its_own_channels() -> None:
    with device(lambda line: b"ERR 1\n" if line == "ALL?" else plain(line), errors=["ERR*"]) as (driver, server):
        with pytest.raises(ChannelsFailed) as raised:
            read(driver, "a", "x", "b", "y")
        assert set(raised.value.causes) == {"x", "y"}
        assert server.received == ["A?", "ALL?", "B?"]
        with pytest.raises(DriverError, match="ERR 1") as one:
            read(driver, "x")
        assert not isinstance(one.value, ChannelsFailed)


def test_a_lost_connection_fails_for_the_rest_of_the_block() -> None:
    with device(lambda line: b"?!\n" if line == "B?" else plain(line)) as (driver, server):
        out = np.zeros(3, np.int64)
        with pytest.raises(ChannelsFailed) as raised:
            driver.read_many(tuple(map(driver.channel, "abc")), out)
        assert set(raised.value.causes) == {"b", "c"}
        assert out[0] == 1
        assert server.received == ["A?", "B?"]


def test_the_quiet_time_is_doubled_with_each_failure_in_succession(monkeypatch: pytest.MonkeyPatch) -> None:
    passed = [0.0]
    for module in ("text.text_link", "streams.stream"):
        monkeypatch.setattr(f"umo.drivers.{module}.monotonic", lambda: monotonic() + passed[0])

    def is_quiet_after(seconds: float) -> None:
        """The line is not before, and Q? has no answer then."""
        for waits, words in ((seconds - 10.0, "the line is not quiet"), (10.0, re.escape("to 'Q?'"))):
            passed[0] += waits
            with pytest.raises(DeviceTimeout, match=words):
                read(driver, "q")

    with line_server(plain) as server:
        driver = Text(host="127.0.0.1", port=server.port, channels=CHANNELS, quiet=50.0)
        driver.timeout = HASTY
        with pytest.raises(DeviceTimeout, match="the line is not quiet"):
            driver.open()
        for seconds in (50.0, 50.0, 100.0, 200.0):
            is_quiet_after(seconds)
            with pytest.raises(DeviceTimeout, match="the line is not quiet"):  # it begins with the next connection
                read(driver, "a")
        passed[0] += 400.0
        driver.timeout = PATIENT
        assert read(driver, "a") == [1]
        driver.timeout = HASTY
        with pytest.raises(DeviceTimeout, match=re.escape("to 'Q?'")):
            read(driver, "q")
        with pytest.raises(DeviceTimeout, match="the line is not quiet"):
            read(driver, "a")
        is_quiet_after(50.0)
        driver.close()


# Options ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"host": None}, 'needs host = "..." for TCP or serial'),
        ({"serial": "/dev/ttyUSB0"}, "host is for TCP: give host and port, or serial and baudrate, not both"),
        ({"port": 0}, "port must be a whole number from 1 to 65535, not 0"),
        ({"baudrate": 9600}, "baudrate is for a serial line: it needs serial ="),
        ({**LINE, "serial": ""}, "serial must name a device file"),
        ({**LINE, "baudrate": 0}, "baudrate must be a whole number from 50 to 4000000, not 0"),
        ({**LINE, "parity": "odd "}, "parity must be one of 'none', 'even', 'odd', 'mark', 'space', not 'odd '"),
        ({**LINE, "flow": "rts"}, "flow must be one of 'none', 'rtscts', 'xonxoff'"),
        ({**LINE, "data_bits": 9}, "data_bits must be one of 5, 6, 7, 8, not 9"),
        ({"encoding": "utf-16"}, "encoding must be one of 'ascii', 'latin-1', 'utf-8'"),
        ({"pause": -1.0}, "pause must be from 0 to 60 s"),
        ({"quiet": float("nan")}, "quiet must be from 0 to 60 s"),
        ({"greeting": "ready"}, "greeting needs boot_time"),
        ({"together": ""}, "must not be empty"),
        ({"terminator": ""}, "must not be empty"),
        ({"watchdog_set": "WD"}, "needs {s} or {ms}"),
        ({"startup": ["REMOTE\n"]}, "contains the terminator"),
        ({"startup": ["°"]}, "'°' is not ascii; encodings: ascii, latin-1, utf-8"),
        ({"identify": {"ask": "ID?"}}, "identify needs both ask and answer"),
        ({"errors": ["ERR {}"]}, "errors: 'ERR {}' takes no {}"),
        ({"channels": {}}, "channels is empty"),
    ],
)
def test_a_wrong_option_is_refused(options: dict[str, Any], why: str) -> None:
    with pytest.raises(WiringError, match=re.escape(why)):
        Text(**{"host": "127.0.0.1", "channels": CHANNELS} | options)


class Rig(Compound):
    voltage: DigitalSensor
    output: BinaryActuator[OnOff]


def rig() -> Rig:
    return Rig(
        voltage=DigitalSensor("V", minimum=0, maximum=10, resolution=0.001),
        output=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )


def faults(**options: Any) -> list[str]:
    wire = {name: {"driver": "supply"} for name in ("voltage", "output")}
    driver = {"type": "umo.drivers.text:Text", "host": "127.0.0.1"}
    return [
        f"{each.key}: {each.message}" for each in check(rig(), {"drivers": {"supply": driver | options}, "wire": wire})
    ]


def test_a_wiring_is_checked_with_the_key_of_each_fault() -> None:
    good = {"voltage": {"ask": "V?", "scale": 0.001}, "output": {"set": {"0": "OFF", "1": "ON"}}}
    assert faults(channels=good) == []
    assert faults() == ["drivers.supply.channels: is missing"]
    assert faults(channels={"voltage": {"aks": "V?"}, "output": 3})[0].startswith(
        "drivers.supply.channels.voltage.aks: unknown key (did you mean 'ask'?); known: ask, answer, states, set"
    )
    assert faults(channels=good, confirm={"query": "E?"}) == [
        "drivers.supply.confirm.query: unknown key; known: ask, answer, terminator, answer_terminator"
    ]
    assert "voltage.ask: must be a string, not 3" in faults(channels=good | {"voltage": {"ask": 3}})[0]
    assert "the forms are: voltage" in faults(channels={"voltage": {"ask": "V?"}})[0]


@pytest.mark.parametrize(("scale", "off"), [({}, "9990 V"), ({"scale": 0.01}, "90 V"), ({"scale": 0.0001}, "9 V")])
def test_a_scale_that_differs_from_the_resolution_is_a_fault_where_the_units_are_known(scale: Any, off: str) -> None:
    output = {"set": {"0": "OFF", "1": "ON"}}
    table: dict[str, Any] = {"ask": "V?", "set": "V {}"} | scale
    assert faults(channels={"voltage": table, "output": output}) == []
    [fault] = faults(channels={"voltage": table | {"units": "V"}, "output": output})
    assert f"the wired scale is up to {off} away from the scale of the circuit, channel voltage" in fault


def test_a_unit_that_pint_does_not_know_is_a_fault() -> None:
    output = {"set": {"0": "OFF", "1": "ON"}}
    [fault] = faults(channels={"voltage": {"ask": "V?", "scale": 0.001, "units": "Vlots"}, "output": output})
    assert fault.startswith("wire.\"voltage\".channel: the unit of channel 'voltage': 'Vlots' is not a unit")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"port": "5020"}, "drivers.supply.port: must be a whole number, without quotes, not '5020'"),
        ({"pause": "1"}, "drivers.supply.pause: must be a number, without quotes, not '1'"),
        ({"echo": "true"}, "drivers.supply.echo: must be true or false, without quotes, not 'true'"),
        ({"terminator": 5}, "drivers.supply.terminator: must be a string, not 5"),
        ({"port": 5020.5}, "drivers.supply.port: must be a whole number, not 5020.5"),
    ],
)
def test_an_option_of_another_type_is_a_fault_in_plain_words(options: dict[str, Any], message: str) -> None:
    assert faults(channels={"voltage": {"ask": "V?"}, "output": {"set": {"0": "a", "1": "b"}}}, **options) == [message]


def test_a_missing_timer_beside_hardware_is_explained_with_the_real_clock() -> None:
    class Timed(Compound):
        timer: DigitalSensor
        voltage: DigitalSensor

    timer = DigitalSensor("sampling_period", minimum=0, maximum=99, resolution=1, synchronous=False)
    box = {"type": "modbus", "host": "127.0.0.1"}
    given = {"drivers": {"box": box}, "wire": {"voltage": {"driver": "box", "channel": "input:0"}}}
    [fault] = check(Timed(timer=timer, voltage=DigitalSensor("V", minimum=0, maximum=10, resolution=1)), given)
    assert fault.message == 'is not wired; for real time use { driver = "timerfd", period = "50 ms" }'


@pytest.mark.parametrize("driver", [Text, Modbus])
def test_each_option_has_a_description_of_its_own(driver: type[Driver[Any]]) -> None:
    described = options_in(driver.__doc__ or "")
    assert list(signature(driver).parameters) and set(signature(driver).parameters) == set(described)
    assert len(set(described.values())) == len(described)


def test_a_scale_in_another_unit_of_the_dimension_fits() -> None:
    output = {"set": {"0": "OFF", "1": "ON"}}
    assert faults(channels={"voltage": {"ask": "V?", "scale": 1, "units": "mV"}, "output": output}) == []


def test_a_wiring_is_checked_without_pyserial(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("serial", "serial.rs485"):
        monkeypatch.setitem(sys.modules, name, None)
    driver = Text(serial="/dev/ttyUSB0", channels=CHANNELS)
    assert driver.channel("a").text == "a"
    with pytest.raises(DriverError, match=re.escape('needs pyserial: pip install ".[text]" in the clone of umo')):
        driver.open()


def test_tcp_needs_no_pyserial() -> None:
    code = (
        "import sys; sys.modules['serial'] = None; from umo.drivers.text import Text;"
        "Text(host='h', channels={'a': {'ask': 'A?'}})"
    )
    assert os.spawnv(os.P_WAIT, sys.executable, [sys.executable, "-c", code]) == 0


# Devices ------------------------------------------------------------------------------------------


def test_one_device_has_one_name(tmp_path: Any) -> None:
    def devices(**options: Any) -> list[str]:
        return list(Text(channels=CHANNELS, **options).devices())

    assert devices(host="127.0.0.1") == ["tcp 127.0.0.1:5025"] == devices(host="0.0.0.0")
    line, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    line.touch()
    link.symlink_to(line)
    assert devices(serial=str(link)) == [f"serial {line}"] == devices(serial=str(line))


# Serial lines -------------------------------------------------------------------------------------


def test_a_serial_line_is_opened_by_one_process_only() -> None:
    master, slave = os.openpty()
    path = os.ttyname(slave)
    first, second = (Text(serial=path, channels=CHANNELS, quiet=0.0) for _ in range(2))
    try:
        first.open()
        second.timeout = HASTY
        with pytest.raises(DriverError, match=rf"{path} is in use by .*pid {os.getpid()}"):
            second.open()
        first.close()
        second.open()  # nothing is left behind
    finally:
        first.close()
        second.close()
        os.close(master)
        os.close(slave)


def test_a_missing_serial_line_and_one_that_is_none(tmp_path: Any) -> None:
    driver = Text(serial="/dev/ttyNOPE7", channels=CHANNELS)
    with pytest.raises(DriverError, match="no device /dev/ttyNOPE7"):
        driver.open()
    file = tmp_path / "ttyUSB0"
    file.touch()
    with pytest.raises(DriverError, match=f"{file} cannot be used as a serial line"):
        Text(serial=str(file), channels=CHANNELS).open()


def test_the_level_of_dtr_stays_when_a_serial_line_is_closed() -> None:
    master, slave = os.openpty()
    driver = Text(serial=os.ttyname(slave), channels=CHANNELS, quiet=0.0)
    try:
        driver.open()
        assert not termios.tcgetattr(slave)[2] & termios.HUPCL
    finally:
        driver.close()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("identify", [None, {"ask": "ID?", "answer": "ACME*"}])
def test_a_late_answer_on_a_serial_line_is_not_taken_for_another(identify: Any) -> None:
    master, slave = os.openpty()
    driver = Text(serial=os.ttyname(slave), channels=CHANNELS, quiet=1.0, identify=identify)

    def serve(count: int) -> None:
        for _ in range(count):
            asked = b""
            while not asked.endswith(b"\n"):
                asked += os.read(master, 1)
            os.write(master, ANSWERS[asked.decode().strip()])

    opening = threading.Thread(target=serve, args=(1 if identify else 0,))
    opening.start()
    try:
        driver.timeout = PATIENT
        driver.open()
        opening.join()
        driver.timeout = 0.5  # below `quiet`, and long enough for a request beside a busy process
        with pytest.raises(DeviceTimeout):
            read(driver, "a")
        assert os.read(master, 100) == b"A?\n"
        with pytest.raises(DeviceTimeout, match="the line is not quiet"):
            read(driver, "b")
        os.write(master, b"1\n")  # late, within the quiet time
        driver.timeout = PATIENT
        answering = threading.Thread(target=serve, args=(2 if identify else 1,))
        answering.start()
        assert read(driver, "b") == [2]
        answering.join()
    finally:
        driver.close()
        os.close(master)
        os.close(slave)


# Empty lines, and terminators of single commands ------------------------------------------------------


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
@pytest.mark.parametrize(
    "form",
    ["{end}{answer}{end}", "{answer}{end}{end}", "\n{answer}{end}", "\r\n{answer}{end}", "{end} {end}{answer}{end}"],
)
def test_an_answer_among_empty_lines_is_the_answer_where_they_are_skipped(end: str, form: str) -> None:
    def answer(line: str) -> bytes:
        return form.format(answer=plain(line).decode().rstrip("\n"), end=end).encode()

    options: dict[str, Any] = {"answer_terminator": end, "skip_empty_lines": True, "together": None}
    identify = {"ask": "ID?", "answer": "ACME*"}
    with device(answer, timeout=PATIENT, identify=identify, **options) as (driver, server):
        for _ in range(3):
            assert read(driver, "a", "b", "x") == [1, 2, 4]
        assert server.connections == 1


def test_a_device_is_not_found_by_an_empty_line_alone() -> None:
    with device(lambda line: b"\r\n" + plain(line), skip_empty_lines=True) as (driver, server):
        assert read(driver, "a") == [1]
        assert driver._link is not None
        driver._link.close()
        until(lambda: driver.look())
        assert read(driver, "a") == [1]
        assert server.connections == 2


def test_an_empty_line_before_an_answer_is_an_error_that_names_the_option() -> None:
    with (
        device(lambda line: b"\r\n" + plain(line)) as (driver, _),
        pytest.raises(DriverError, match=r"empty answer is not a number or state; set skip_empty_lines = true|unasked"),
    ):
        read(driver, "a")


def test_an_empty_answer_may_be_a_state_unless_empty_lines_are_skipped() -> None:
    channels = {"relay": {"ask": "R?", "states": {0: ["", "NONE"], 1: "ON"}}}
    said = iter([b"\n", b"ON\n", b"NONE\n"])
    with device(lambda line: next(said), channels=channels, identify=None) as (driver, _):
        assert [read(driver, "relay") for _ in range(3)] == [[0], [1], [0]]
    with pytest.raises(
        WiringError, match=r'^channels\.relay\.states: "" never arrives, because skip_empty_lines = true$'
    ):
        Text(host="127.0.0.1", port=1, channels=channels, skip_empty_lines=True)


def test_a_channel_may_be_named_terminator() -> None:
    channels = {"terminator": {"ask": "T?", "answer": "{}"}}
    with device(lambda line: b"5\n", channels=channels, identify=None) as (driver, _):
        assert read(driver, "terminator") == [5]


def test_a_device_that_sends_empty_lines_for_ever_is_an_error() -> None:
    with (
        device(lambda line: b"\n" * 500, skip_empty_lines=True) as (driver, _),
        pytest.raises(DriverError, match=r"more than 100 empty lines in place of an answer to 'A\?'"),
    ):
        read(driver, "a")


def test_a_command_may_have_terminators_of_its_own() -> None:
    """Such as a gauge that sends its value at a single ENQ, without a line's end."""
    got: list[bytes] = []

    def serve(server: socket.socket) -> None:
        answers = {b"\x05": b"7;", b"B?\n": b"2\n", b"C?!": b"C=3\n", b"A 4\r": b"", b"S?\r": b"ok\r"}
        client, _ = server.accept()
        left = b""
        with client:
            while data := client.recv(100):
                left += data  # two messages may come in one piece
                while known := [each for each in answers if left.startswith(each)]:
                    got.append(known[0])
                    left = left.removeprefix(known[0])
                    client.sendall(answers[known[0]])
        got.append(left)

    channels: dict[str, Any] = {
        "gauge": {"ask": "\x05", "terminator": "", "answer_terminator": ";"},
        "b": {"ask": "B?"},
        "c": {"ask": "C?", "answer": "C={}", "terminator": "!"},
        "set": {
            "set": "A {}",
            "terminator": "\r",
            "confirm": {"ask": "S?", "answer": "ok", "terminator": "\r", "answer_terminator": "\r"},
        },
    }
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, args=(server,))
        thread.start()
        driver = Text(host="127.0.0.1", port=server.getsockname()[1], channels=channels, together="+")
        driver.timeout = PATIENT
        driver.open()
        assert read(driver, "b", "gauge", "c") == [2, 7, 3]
        write(driver, set=4)
        assert driver.look() is True
        driver.close()
        thread.join(PATIENT)
    assert b"".join(got) == b"B?\n\x05C?!A 4\rS?\r"


def test_only_queries_that_end_alike_are_joined_in_one_line() -> None:
    channels = {
        "a": {"ask": "A?", "answer_terminator": "\n"},
        "b": {"ask": "B?", "answer_terminator": "\n"},
        "c": {"ask": "C?", "answer": "C={}"},
    }
    with device(lambda line: {"A?;B?": b"1;2\n", "C?": b"C=3\n"}[line], channels=channels, together=";") as (
        driver,
        server,
    ):
        assert read(driver, "a", "c", "b") == [1, 3, 2]
        assert server.received == ["A?;B?", "C?"]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"ask": "A?", "answer_terminator": ""}, "answer_terminator must not be empty"),
        ({"ask": "A?!", "terminator": "!"}, "contains the terminator '!'"),
        ({"ask": "A?", "terminator": "ü"}, "is not ascii"),
    ],
)
def test_a_wrong_terminator_of_a_command_is_a_fault_of_the_wiring(table: dict[str, Any], message: str) -> None:
    with pytest.raises(WiringError, match=re.escape(message)):
        Text(host="127.0.0.1", channels={"a": table})


# Instruments that users of other projects have reported ------------------------------------------------


def test_an_instrument_that_ends_its_answers_with_nul_each_in_its_way() -> None:
    """pyvisa/pyvisa#202, #120 and #772: "\\n", "\\n\\0" and "\\0" from one instrument."""
    answers = {"READ?": b"-4.2E-1\n", "ERR?": b"0\n\0", "V?": b"3.805\0"}
    channels: dict[str, Any] = {
        "reading": {"ask": "READ?", "scale": 0.01},
        "error": {"ask": "ERR?", "answer_terminator": "\n\0"},
        "voltage": {"ask": "V?", "answer_terminator": "\0", "scale": 0.001},
    }
    with device(answers.__getitem__, channels=channels) as (driver, server):
        for _ in range(3):
            assert read(driver, "reading", "error", "voltage") == [-42, 0, 3805]
        assert server.connections == 1


def test_an_answer_of_several_lines_is_one_by_its_last_terminator() -> None:
    """pyvisa/pyvisa#808: lines that end with LF, and the answer with CR LF."""
    channels: dict[str, Any] = {"b": {"ask": "ALL?", "answer": "/(?s)A=.*B=(\\d+).*/"}}
    with device(lambda _: b"A=1\nB=22\nC=3\r\n", channels=channels, answer_terminator="\r\n") as (driver, _):
        assert read(driver, "b") == [22]


@pytest.mark.parametrize("answer", ["9.9E+37", "-9.9E37", "9.91E37", "199.999E+99", "9.99999999e+37"])
def test_an_overflow_is_no_measurement(answer: str) -> None:
    """microsoft/Qcodes#1929 and #2074, N0ury/dmm_util#26."""
    with (
        device(lambda _: f"{answer}\n".encode(), channels={"a": {"ask": "A?", "scale": 0.001}}) as (driver, _server),
        pytest.raises(DriverError, match="overflow, or no valid measurement"),
    ):
        read(driver, "a")


def test_a_whole_number_may_be_written_with_an_exponent() -> None:
    """sigrokproject/libsigrok#94."""
    with device(lambda _: b"4.0000E+03\n") as (driver, _):
        assert read(driver, "a") == [4000]

"""The served z-theta plant: its box with injected time, its server against mbpoll (libmodbus) and our driver.

The registers are derived from the station's two wirings; the plant is a fake one behind the same channels.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import stat
import struct
import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.drivers import Reports
from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.modbus import Modbus
from umo.errors import DriverError, WiringError
from umo.plant import serve as serving
from umo.plant.box import Box, Watchdog
from umo.plant.modbus_server import Connection, answer
from umo.plant.register_map import RegisterMap, register_maps
from umo.plant.serve import ReportFile, serve, serve_until_signal, turn
from umo.plant.simulation import MAX_LAG, MAX_PERIODS, Pace, Simulation
from umo.process.station import find
from umo.stations.ztheta.objects import machine
from umo.stations.ztheta.plant import Plant
from umo.wiring import Wired, resolve

PATIENT = 10.0
WATCHDOG_REGISTER = 4096
WIRINGS = find("ztheta").wirings
BITS = {"counter:z": 16, "counter:theta": 24, "adc:counterweight": 10, "dac:z": 12, "tick": 31}
COILS = ["step", "direction", "z_index", "theta_index", "counterweight", "vacuum", "pressure"]
RESET = {f"dio:{name}": int(name == "direction") for name in COILS} | {"dac:z": 0}


class FakePlant(Driver, Reports):
    """The levels of the station's channels; time only counts."""

    def __init__(self) -> None:
        self.is_open = False
        self.periods = 0
        self.inputs = {"counter:z": 58117, "counter:theta": -2, "adc:counterweight": 1000, "dio:gripper": 1}
        self.outputs: dict[str, int] = {}
        self.writes: list[tuple[str, int]] = []
        self.broken: Exception | None = None
        self.placed = 0
        self.at_report: Callable[[], object] = lambda: None

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def channel(self, text: str) -> Channel:
        direction = Direction.INPUT if text in self.inputs or text == "tick" else Direction.OUTPUT
        return Channel(text, direction, BITS.get(text, 1), text in ("counter:theta", "dac:z"))

    def initialize(self, channel: Channel, default: int | None) -> None:
        assert self.is_open
        if default is not None:
            self.outputs[channel.text] = default

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.periods += 1
            return 0
        if self.broken is not None:
            raise self.broken
        return self.inputs[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        self.writes.append((channel.text, raw))
        self.outputs[channel.text] = raw

    def report(self) -> dict[str, Any]:
        self.at_report()
        return {"placed": self.placed}


def of(plant: Driver, port: int = 0, **changes: Any) -> tuple[Wired, list[RegisterMap]]:
    """The station's own wirings, with this plant, served at another port."""
    simulated = tomllib.loads(WIRINGS["simulated"].read_text())
    simulated["drivers"]["plant"] = plant
    resolved = resolve(machine(), simulated)
    (registers,) = register_maps(resolved, resolve(machine(), WIRINGS["modbus"]))
    return resolved, [replace(registers, port=port, **changes)]


class Bench:
    """A box over a fake plant, its clock in the test's client."""

    def __init__(self, *, watchdog: float = 0.2) -> None:
        self.plant = FakePlant()
        self.now = 1000.0
        resolved, (registers,) = of(self.plant, watchdog=watchdog)
        self.simulation = Simulation(resolved, lambda: self.now)
        self.box = Box(self.simulation, registers)
        self.simulation.__enter__()

    def ask(self, function: int, address: int, *words: int) -> bytes:
        return self.box.request(struct.pack(f">BH{len(words)}H", function, address, *words))

    def turn(self) -> None:
        turn(self.simulation, [self.box])

    def wait(self, seconds: float) -> None:
        """Let time pass, with a turn of the box in every period."""
        for _ in range(round(seconds * 1000)):
            self.now += 0.001
            self.turn()


# The watchdog -------------------------------------------------------------------------------------


def test_a_watchdog_sleeps_until_the_first_write() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(0.0, write=False)
    assert not watchdog.expired(100.0)
    watchdog.feed(100.0, write=True)
    assert not watchdog.expired(100.24)
    assert watchdog.expired(100.25)


def test_a_watchdog_expires_once_and_is_armed_again_by_a_write() -> None:
    watchdog = Watchdog(0.2)
    watchdog.feed(0.0, write=True)
    assert [watchdog.expired(1.0), watchdog.expired(2.0)] == [True, False]
    watchdog.feed(3.0, write=False)
    assert not watchdog.expired(4.0)
    watchdog.feed(5.0, write=True)
    assert watchdog.expired(6.0)
    assert watchdog.drops == 2


# The pace -----------------------------------------------------------------------------------------


@given(st.lists(st.floats(0.0, 3.0), max_size=60))
def test_every_period_is_taken_or_given_up_and_never_too_many_at_once(steps: list[float]) -> None:
    pace, now, taken = Pace(0.001, 50.0), 50.0, 0
    for step in steps:
        now += step
        due = pace.due(now)
        assert 0 <= due <= MAX_PERIODS
        taken += due
    while due := pace.due(now):
        taken += due
    assert taken + pace.given_up == int((now - 50.0) / 0.001)
    assert 0.0 <= pace.left(now) <= 0.001 + 1e-9


def test_a_short_delay_is_caught_up_with_and_a_long_one_is_not() -> None:
    pace = Pace(0.001, 0.0)
    assert [pace.due(0.0500001) for _ in range(4)] == [20, 20, 10, 0]
    assert pace.given_up == 0
    assert pace.due(0.05 + (MAX_LAG + 1.5) * 0.001) == MAX_PERIODS
    assert pace.given_up == MAX_LAG + 1 - MAX_PERIODS


# The box ------------------------------------------------------------------------------------------


def test_the_outputs_come_up_at_their_safe_levels() -> None:
    bench = Bench()
    assert bench.plant.outputs == RESET
    assert bench.plant.period == 0.001


def test_the_physics_is_brought_up_to_each_request() -> None:
    bench = Bench()
    bench.now += 0.0035
    bench.ask(4, 0, 1)
    assert bench.plant.periods == 3
    bench.now += 0.001
    bench.turn()
    assert bench.plant.periods == 4


def test_inputs_are_read_when_the_request_comes() -> None:
    bench = Bench()
    bench.plant.inputs["counter:z"] = 43689
    assert bench.ask(4, 0, 4) == struct.pack(">BBHiH", 4, 8, 43689, -2, 1000)
    bench.plant.inputs["counter:theta"] = -(1 << 23)
    assert bench.ask(4, 1, 2) == struct.pack(">BBi", 4, 4, -(1 << 23))
    assert bench.ask(2, 0, 1) == b"\x02\x01\x01"


def test_outputs_are_written_at_once_and_read_back() -> None:
    bench = Bench()
    assert bench.ask(6, 0, 0x10000 - 2048) == struct.pack(">BHH", 6, 0, 0x10000 - 2048)
    assert bench.plant.outputs["dac:z"] == -2048
    assert bench.ask(3, 0, 1) == struct.pack(">BBH", 3, 2, 0x10000 - 2048)
    assert bench.box.request(struct.pack(">BHHBB", 15, 0, 7, 1, 0b0110001)) == struct.pack(">BHH", 15, 0, 7)
    assert bench.plant.writes[1:] == [(f"dio:{name}", 0b0110001 >> i & 1) for i, name in enumerate(COILS)]
    assert bench.ask(1, 0, 7) == bytes([1, 1, 0b0110001])
    assert bench.ask(5, 6, 0xFF00) == struct.pack(">BHH", 5, 6, 0xFF00)
    assert bench.plant.outputs["dio:pressure"] == 1


REFUSED = [
    ((1, 0, 8), 2),  # coil 7 is not mapped
    ((1, 7, 1), 2),
    ((2, 1, 1), 2),
    ((3, 0, 2), 2),
    ((3, 4095, 1), 2),
    ((4, 4, 1), 2),
    ((4, 0, 0), 3),
    ((4, 0, 126), 3),
    ((1, 0, 2001), 3),
    ((4, 0), 3),
    ((5, 0, 1), 3),  # on is 0xFF00
    ((5, 7, 0xFF00), 2),
    ((6, 0, 2048), 3),  # the DAC has 12 bits
    ((6, 1, 0), 2),
    ((7, 0, 0), 1),
]


@pytest.mark.parametrize(("request_", "code"), REFUSED)
def test_what_the_box_does_not_have_is_refused_by_the_right_exception(request_: tuple[int, ...], code: int) -> None:
    bench = Bench()
    assert bench.ask(*request_) == bytes([request_[0] | 0x80, code])
    assert bench.plant.writes == []


def test_a_write_is_done_whole_or_not_at_all() -> None:
    bench = Bench()
    assert bench.box.request(struct.pack(">BHHBB", 15, 5, 3, 1, 0b111)) == b"\x8f\x02"
    assert bench.plant.writes == []


def test_a_plant_that_fails_is_a_device_failure() -> None:
    bench = Bench()
    bench.plant.broken = DriverError("broken")
    assert bench.ask(4, 0, 1) == b"\x84\x04"
    bench.turn()  # and the box lives on


def test_outputs_drop_to_their_safe_levels_when_the_client_falls_silent_and_then_just_work_again() -> None:
    bench = Bench()
    bench.ask(5, 0, 0xFF00)
    bench.ask(5, 1, 0)
    bench.ask(6, 0, 100)
    bench.wait(0.15)
    bench.ask(4, 0, 1)
    bench.wait(0.199)
    assert bench.plant.outputs["dac:z"] == 100
    bench.wait(0.002)
    assert bench.plant.outputs == RESET
    assert bench.box.watchdog.drops == 1
    assert bench.ask(3, 0, 1) == b"\x03\x02\x00\x00"
    bench.ask(6, 0, 200)
    assert bench.plant.outputs["dac:z"] == 200


def test_a_request_that_waited_for_a_slow_turn_still_feeds_the_watchdog() -> None:
    bench = Bench()
    bench.ask(6, 0, 100)
    bench.now += 0.5
    bench.ask(4, 0, 1)
    bench.turn()
    assert bench.box.watchdog.drops == 0


def test_the_watchdog_s_time_is_a_register() -> None:
    bench = Bench()
    assert bench.ask(3, WATCHDOG_REGISTER, 1) == struct.pack(">BBH", 3, 2, 200)
    bench.ask(6, WATCHDOG_REGISTER, 50)
    assert bench.ask(3, WATCHDOG_REGISTER, 1) == struct.pack(">BBH", 3, 2, 50)
    bench.wait(0.051)
    assert bench.box.watchdog.drops == 1
    bench.ask(6, WATCHDOG_REGISTER, 0)
    bench.wait(1.0)
    assert bench.box.watchdog.drops == 1


def test_function_23_writes_registers_and_reads_registers_or_changes_nothing() -> None:
    bench = Bench()
    words = [WATCHDOG_REGISTER, 1, WATCHDOG_REGISTER, 1]
    asked = struct.pack(">B4HBH", 23, *words, 2, 70)
    assert bench.box.request(asked) == struct.pack(">BBH", 23, 2, 70)
    assert bench.ask(3, WATCHDOG_REGISTER, 1) == struct.pack(">BBH", 3, 2, 70)
    for wrong, code in (
        (asked[:-1], 3),
        (asked[:6], 3),
        (struct.pack(">B4HBH", 23, 9_999, 1, WATCHDOG_REGISTER, 1, 2, 80), 2),
        (struct.pack(">B4HBH", 23, WATCHDOG_REGISTER, 1, 9_999, 1, 2, 80), 2),
    ):
        assert bench.box.request(wrong) == bytes([0x80 | 23, code])
    assert bench.ask(3, WATCHDOG_REGISTER, 1) == struct.pack(">BBH", 3, 2, 70)


@given(st.binary(min_size=1, max_size=30) | st.builds(lambda f, b: bytes([f]) + b, st.integers(1, 23), st.binary()))
def test_every_request_has_an_answer(request: bytes) -> None:
    reply = answer(request, Bench().box)
    assert reply[0] & 0x7F == request[0] & 0x7F
    if reply[0] & 0x80:
        assert len(reply) == 2
        assert reply[1] in (1, 2, 3, 4)


# Over the network ---------------------------------------------------------------------------------


@contextmanager
def served(plant: FakePlant) -> Iterator[int]:
    """Serve the plant from a thread on a free port."""
    port: list[int] = []
    ends: list[Callable[[], object]] = []
    ready = threading.Event()

    async def main() -> None:
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        ends.append(lambda: loop.call_soon_threadsafe(stop.set))

        def at(_: str, __: str, number: int) -> None:
            port.append(number)
            ready.set()

        await serve(*of(plant, watchdog=0.0), ready=at, stop=stop)

    thread = threading.Thread(target=asyncio.run, args=[main()])
    thread.start()
    try:
        assert ready.wait(PATIENT)
        yield port[0]
    finally:
        ends[0]()
        thread.join(PATIENT)
    assert not thread.is_alive()
    assert not plant.is_open


@contextmanager
def driving(port: int) -> Iterator[Modbus]:
    driver = Modbus(port=port, watchdog_register=WATCHDOG_REGISTER)
    driver.timeout = PATIENT
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


SENSORS = ["input:0", "input:1:int32", "input:3", "discrete:0"]


def test_our_driver_reads_and_writes_the_served_plant() -> None:
    plant = FakePlant()
    with served(plant) as port, driving(port) as driver:
        out = np.zeros(4, np.int64)
        driver.read_many([driver.channel(text) for text in SENSORS], out)
        assert out.tolist() == [58117, -2, 1000, 1]
        outputs = ["holding:0:int16", *(f"coil:{i}" for i in range(7))]
        driver.write_many([driver.channel(text) for text in outputs], np.array([-7, 1, 0, 1, 0, 1, 0, 1]))
        assert [plant.outputs[f"dio:{name}"] for name in COILS] == [1, 0, 1, 0, 1, 0, 1]
        assert plant.outputs["dac:z"] == -7
        driver.watchdog(1.5)
        assert driver.read(driver.channel(f"holding:{WATCHDOG_REGISTER}")) == 1500
        with pytest.raises(DriverError, match="exception 2, illegal data address"):
            driver.read(driver.channel("coil:7"))


def frame(number: int, *body: int, protocol: int = 0) -> bytes:
    return struct.pack(">HHHB", number, protocol, len(body) + 1, 9) + bytes(body)


def test_requests_in_one_packet_or_in_pieces_are_all_answered() -> None:
    with served(FakePlant()) as port, socket.create_connection(("127.0.0.1", port), PATIENT) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.sendall(frame(1, 2, 0, 0, 0, 1) + frame(2, 4, 0, 3, 0, 1)[:5])
        answers = client.makefile("rb")
        assert answers.read(10) == frame(1, 2, 1, 1)
        client.sendall(frame(2, 4, 0, 3, 0, 1)[5:])
        assert answers.read(11) == frame(2, 4, 2, 3, 232)
        answers.close()


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.0\r\n\r\n", frame(1, 2, 0, 0, 0, 1, protocol=1), bytes(8)])
def test_a_client_that_speaks_no_modbus_is_cut_off_and_the_others_are_served(
    rubbish: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    with served(FakePlant()) as port, driving(port) as driver:
        with socket.create_connection(("127.0.0.1", port), PATIENT) as client:
            client.sendall(rubbish)
            assert client.recv(100) == b""
        assert driver.read(driver.channel("input:3")) == 1000
    assert caplog.records == [], "cut off on purpose, not by an error"


class Wire(asyncio.Transport):
    """A connection's other side, in the test's client; `full` answers are in the way of more."""

    def __init__(self, full: int = 1_000_000) -> None:
        super().__init__()
        self.answers: list[bytes] = []
        self.full = full
        self.reading = True
        self.connection: Connection | None = None

    def is_closing(self) -> bool:
        return False

    def pause_reading(self) -> None:
        self.reading = False

    def resume_reading(self) -> None:
        self.reading = True

    def write(self, data: bytes) -> None:  # type: ignore[override]
        self.answers.append(data)
        if len(self.answers) == self.full:
            assert self.connection is not None
            self.connection.pause_writing()


def wired(handle: Callable[[bytes], bytes], full: int = 1_000_000) -> tuple[Connection, Wire]:
    wire = Wire(full)
    wire.connection = Connection(handle, set())
    wire.connection.connection_made(wire)
    return wire.connection, wire


async def turns(number: int) -> None:
    for _ in range(number):
        await asyncio.sleep(0)


FLOOD = [bytes([3, 0, 0, 0, i]) for i in range(200)]


def flood() -> bytes:
    return b"".join(frame(i, *request) for i, request in enumerate(FLOOD))


def test_clients_that_flood_the_box_take_turns_with_the_others() -> None:
    served_: list[str] = []

    def handle(name: str) -> Callable[[bytes], bytes]:
        return lambda request: served_.append(name) or request

    async def main() -> None:
        first, second, good = (wired(handle(name)) for name in ("first", "second", "good"))
        first[0].data_received(flood())
        second[0].data_received(flood())
        for i in range(20):
            before = len(served_)
            good[0].data_received(frame(i, *FLOOD[i]))
            assert served_[before:] == ["good"], "at once, whoever else waits"
            await turns(1)
            assert sorted(served_[before:]) == ["first", "good", "second"], "one request of each in a turn"
        await turns(200)
        for _, wire in (first, second):
            assert wire.answers == [frame(i, *request) for i, request in enumerate(FLOOD)]

    asyncio.run(main())


def test_nothing_is_read_of_a_client_while_its_requests_wait() -> None:
    async def main() -> None:
        connection, wire = wired(bytes)
        connection.data_received(flood() + frame(7, 1, 2)[:5])
        assert not wire.reading
        await turns(198)
        assert not wire.reading
        await turns(3)
        assert wire.reading
        assert len(wire.answers) == 200
        connection.data_received(frame(7, 1, 2)[5:])
        assert wire.answers[200:] == [frame(7, 1, 2)]

    asyncio.run(main())


def test_a_client_that_does_not_take_its_answers_gets_no_more_of_them_until_it_does() -> None:
    async def main() -> None:
        connection, wire = wired(bytes, full=5)
        connection.data_received(flood())
        await turns(50)
        assert len(wire.answers) == 5
        assert not wire.reading
        connection.resume_writing()
        before = len(wire.answers)
        await turns(10)
        assert len(wire.answers) == before + 10, "one in a turn, as ever"
        await turns(200)
        assert len(wire.answers) == 200
        assert wire.reading

    asyncio.run(main())


# Beginning, end and report ------------------------------------------------------------------------


def test_an_address_in_use_is_said_in_one_sentence_and_the_plant_is_left_closed() -> None:
    plant = FakePlant()
    with served(FakePlant()) as port, pytest.raises(WiringError, match=f"127.0.0.1:{port}: address already in use"):
        asyncio.run(serve(*of(plant, port), stop=asyncio.Event()))
    assert not plant.is_open


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_server_with_the_report_written(number: signal.Signals, tmp_path: Path) -> None:
    plant, report = FakePlant(), tmp_path / "report.json"
    summary = serve_until_signal(*of(plant), ready=lambda *at: signal.raise_signal(number), report=report)
    assert summary == {"placed": 0, "requests": 0, "watchdog_drops": 0, "periods_given_up": 0}
    assert json.loads(report.read_text()) == summary
    assert list(tmp_path.iterdir()) == [report]
    assert not plant.is_open


def test_the_report_is_written_when_another_part_has_been_placed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "REPORT_INTERVAL", 0.0)
    path, stop = tmp_path / "report.json", asyncio.Event()
    seen: set[int] = set()
    plant = FakePlant()

    def look() -> None:
        if path.exists():
            seen.add(json.loads(path.read_text())["placed"])
        if 1 in seen:
            stop.set()
        plant.placed = int(plant.periods > 5)

    plant.at_report = look
    asyncio.run(asyncio.wait_for(serve(*of(plant), stop=stop, report=path), PATIENT))
    assert seen == {0, 1}


def serving_to(report: Path) -> FakePlant:
    """A plant that was served until it could take requests, with this report."""
    plant, stop = FakePlant(), asyncio.Event()
    asyncio.run(serve(*of(plant), ready=lambda *at: stop.set(), stop=stop, report=report))
    return plant


@pytest.mark.parametrize("bad", ["folder", "device", "pipe", "linked", "loop", "missing/report", "x" * 300, "a\0b"])
def test_a_report_that_is_not_a_regular_file_is_refused_before_serving_and_left_as_it_is(
    bad: str, tmp_path: Path
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "device").symlink_to("/dev/null")
    (tmp_path / "linked").symlink_to("folder")
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    before = {path.name: path.lstat().st_ino for path in tmp_path.iterdir()}
    with pytest.raises(WiringError, match="no report can be written to"):
        serving_to(tmp_path / bad)
    assert {path.name: path.lstat().st_ino for path in tmp_path.iterdir()} == before
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_report_that_became_something_else_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    report = ReportFile(path)
    path.symlink_to("/dev/null")
    with pytest.raises(DriverError, match=r"report\.json cannot be written: this is not a regular file"):
        report.write({})
    assert path.is_symlink()


def test_a_report_behind_a_symlink_is_written_there_and_the_link_stays(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder/report.json")
    for _ in range(2):
        serving_to(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert json.loads((tmp_path / "folder" / "report.json").read_text())["placed"] == 0
    assert len(list(tmp_path.rglob("*"))) == 3


def test_a_report_may_have_the_longest_name_that_a_file_can_have(tmp_path: Path) -> None:
    serving_to(tmp_path / ("r" * 250 + ".json"))
    assert [path.suffix for path in tmp_path.iterdir()] == [".json"]


def test_a_report_never_follows_a_draft_that_somebody_else_has_put_there(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("kept")
    (tmp_path / f".umo-report-{os.getpid()}").symlink_to(victim)
    serving_to(tmp_path / "report.json")
    assert victim.read_text() == "kept"
    assert (tmp_path / "report.json").is_file()


def test_a_report_that_cannot_be_written_any_more_is_said_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "REPORT_INTERVAL", 0.0)
    folder, stop = tmp_path / "folder", asyncio.Event()
    folder.mkdir()
    plant = FakePlant()

    looks: list[int] = []

    def look() -> None:
        plant.placed += 1
        looks.append(plant.placed)
        if len(looks) == 5:
            stop.set()

    plant.at_report = look
    with pytest.raises(DriverError, match=r"report\.json cannot be written: no such file"):
        asyncio.run(serve(*of(plant), ready=lambda *at: folder.rmdir(), stop=stop, report=folder / "report.json"))
    assert len(looks) >= 5, "it was served on meanwhile"
    assert not plant.is_open


@pytest.mark.parametrize("watchdog", [float("inf"), float("nan"), -0.001, 65.536])
def test_a_watchdog_that_its_register_cannot_hold_is_refused_before_serving(watchdog: float) -> None:
    with pytest.raises(WiringError, match=r"the watchdog takes 0 \(off\) to 65.535 s"):
        serve_until_signal(*of(FakePlant(), watchdog=watchdog), ready=print, report=None)


@pytest.mark.parametrize(("watchdog", "milliseconds"), [(0.0, 0), (0.0001, 1), (0.2, 200), (65.535, 65535)])
def test_a_watchdog_above_0_is_never_none(watchdog: float, milliseconds: int) -> None:
    assert Bench(watchdog=watchdog).ask(3, WATCHDOG_REGISTER, 1) == struct.pack(">BBH", 3, 2, milliseconds)


def test_an_address_that_cannot_be_a_name_is_said_in_one_sentence() -> None:
    with pytest.raises(WiringError, match="not the name of a host"):
        asyncio.run(serve(*of(FakePlant(), host="a" * 70), stop=asyncio.Event()))


def test_the_station_s_plant_is_served_as_it_is() -> None:
    pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install '.[plant]'")
    counts: list[int] = []

    def look(name: str, host: str, port: int) -> None:
        def work() -> None:
            with driving(port) as driver:
                counts.append(driver.read(driver.channel("input:0")))
                driver.write(driver.channel("holding:0:int16"), 0)
            signal.raise_signal(signal.SIGTERM)

        workers.append(threading.Thread(target=work))
        workers[0].start()

    workers: list[threading.Thread] = []
    summary = serve_until_signal(*of(Plant(parts=1)), ready=look, report=None)
    workers[0].join()
    assert counts == [0] or counts[0] > 65_000  # the counter is at its power-up value, or just below it
    assert summary["parts_placed"] == 0
    assert summary["requests"] == 2

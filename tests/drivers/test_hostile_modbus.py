"""Modbus devices that misbehave (hostile.py), on TCP and on a serial line: nothing crashes, hangs or grows the
process, and a value that is not the device's is never GOOD.

A register of the device counts the requests that read it, so an old answer has an old value. What no master can notice
is left out: on TCP a changed value in a sound frame, on a serial line an answer that the device sends twice, or keeps
and sends in place of the right one. There the old answers are those to other requests.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.peers.hostile import BEHAVIOURS, DAMAGED, Hostile, fuzz, hostile
from helpers.tiers import first, some
from umo import BinarySensor, Compound, DigitalActuator, DigitalSensor, Quality, connect
from umo.errors import DriverError, StopError
from umo.states import OnOff

pytest.importorskip("pymodbus")
pytest.importorskip("serial")

TIMEOUT = 0.06
RECOVERY = "250 ms"
"""With the timeout twice as long as the device may take: its thread may be held up."""
PATIENT = 10.0
GROWTH = 64e6
"""Bytes."""
REPEATS = ("twice", "twice, apart", "an earlier answer", "an earlier answer first", "all earlier answers")
REPEATS += ("endless answers",)
FUZZED = 2.0
"""s."""
SHORT = {"late", "byte by byte", "an earlier answer first", "noise before", "one bit wrong"}
"""Behaviours with tests of their own in `make test`; there the fuzzed ones have all of them."""


# The device ----------------------------------------------------------------------------------------


class Device:
    """Input registers 0 to 2, of which the first counts its readings; discrete input 0, holding registers 0 and 1."""

    def __init__(self, counts: bool = True) -> None:
        self.reads = 0
        self.holding = [0, 0]
        self._step = int(counts)

    def tcp(self, data: bytes) -> tuple[int, bytes]:
        if len(data) < 6 or len(data) < (size := 6 + struct.unpack_from(">H", data, 4)[0]):
            return 0, b""
        body = data[6:7] + self._answer(data[7:size])
        return size, data[:4] + struct.pack(">H", len(body)) + body

    def rtu(self, data: bytes) -> tuple[int, bytes]:
        size = 8 if data[1:2] != b"\x10" else 9 + data[6] if len(data) > 6 else 99
        if len(data) < size:
            return 0, b""
        assert check_sum(data[: size - 2]) == data[size - 2 : size], "the driver sent a damaged frame"
        body = data[:1] + self._answer(data[1 : size - 2])
        return size, body + check_sum(body)

    def _answer(self, request: bytes) -> bytes:
        function, address = struct.unpack_from(">BH", request)
        if function == 4:
            self.reads += self._step
            return struct.pack(">BBHHH", 4, 6, self.reads & 0xFFFF, 0x1234, 0xABCD)
        if function == 2:
            return b"\x02\x01\x01"
        if function == 16:
            self.holding = list(struct.unpack(">HH", request[6:]))
        elif function == 6:
            self.holding[address] = struct.unpack_from(">H", request, 3)[0]
        return request[:5]


def check_sum(data: bytes) -> bytes:
    """Bit by bit, as the specification has it (Modbus over Serial Line V1.02, 6.2.2)."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


# The machine ---------------------------------------------------------------------------------------


class Rig(Compound):
    count: DigitalSensor
    fixed: DigitalSensor
    high: DigitalSensor
    ready: BinarySensor[OnOff]
    first: DigitalActuator
    second: DigitalActuator


def rig() -> Rig:
    whole = {"minimum": 0.0, "maximum": 65_535.0, "resolution": 1.0}
    return Rig(
        count=DigitalSensor("count", **whole),
        fixed=DigitalSensor("count", **whole),
        high=DigitalSensor("count", **whole),
        ready=BinarySensor(OnOff, one=OnOff.ON),
        first=DigitalActuator("count", default=0.0, **whole),
        second=DigitalActuator("count", default=0.0, **whole),
    )


def wiring(peer: Hostile) -> dict[str, Any]:
    place = {"serial": peer.path, "recovery": RECOVERY} if peer.path else {"host": "127.0.0.1", "port": peer.port}
    channels = {"count": "input:0", "fixed": "input:1", "high": "input:2", "ready": "discrete:0"}
    channels |= {"first": "holding:0", "second": "holding:1"}
    return {
        "drivers": {"io": {"type": "modbus", "timeout": PATIENT, **place}},
        "wire": {path: {"driver": "io", "channel": channel} for path, channel in channels.items()},
    }


class Trial:
    """A connected machine that samples and updates against a script, and checks every value that is GOOD."""

    def __init__(self, script: Iterator[str], line: bool, repeats: bool = False) -> None:
        self.device, self._script, self._line, self._repeats = Device(not repeats), script, line, repeats
        self.good = self.failed = 0
        self._misbehaves = False
        self._stack = ExitStack()

    def run(self, seconds: float) -> None:
        answer = self.device.rtu if self._line else self.device.tcp
        peer = self._stack.enter_context(hostile(answer, self._behaviours(), line=self._line))
        connection = connect(rig(), wiring(peer))
        with self._stack, reset_in_the_end(), connection as m:
            driver = connection.driver("io")
            before, end = memory(), time.monotonic() + seconds
            self._misbehaves, driver.timeout = True, TIMEOUT
            turn = 0
            while (now := time.monotonic()) < end or (not self.good and now < end + PATIENT):  # on a busy computer
                turn += 1
                self._call(m.sample, partial(self._check_inputs, m, self.device.reads))
                m.first.write(turn % 60_000)
                m.second.write(turn // 2)
                self._call(m.update, lambda: self._repeats or self._check_outputs(m))
            self._misbehaves, driver.timeout = False, PATIENT
            assert memory() - before < GROWTH
        assert self.device.holding == [0, 0], "both are at their defaults at the end"

    def _behaviours(self) -> Iterator[str]:
        """The device behaves while the machine is connected and reset."""
        while True:
            yield next(self._script) if self._misbehaves else "right"

    def _call(self, call: Any, check: Any) -> None:
        try:
            call()
        except DriverError:
            self.failed += 1
            time.sleep(0.002)  # as a period would
        check()

    def _check_inputs(self, m: Rig, reads_before: int) -> None:
        if m.count.quality is Quality.GOOD:
            assert reads_before < m.count.read() <= self.device.reads or self._repeats
            assert (m.fixed.read(), m.high.read()) == (0x1234, 0xABCD)
            self.good += 1
        if m.ready.quality is Quality.GOOD:
            assert m.ready.read() is OnOff.ON

    def _check_outputs(self, m: Rig) -> None:
        for actuator, holds in zip((m.first, m.second), self.device.holding, strict=True):
            if actuator.quality is Quality.GOOD:
                assert actuator.read() == holds, f"{actuator.path} is taken for written"


@contextmanager
def reset_in_the_end() -> Iterator[None]:
    """The device may misbehave when its reset begins: then the second attempt must have reached it."""
    try:
        yield
    except StopError:
        raise
    except DriverError as error:
        assert all(failure.cause.startswith("reset at a later attempt") for failure in error.failures), error


def memory() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


# Tests ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", some(SHORT.__contains__, [name for name in BEHAVIOURS if name != "right"]))
def test_on_tcp_no_behaviour_makes_a_wrong_value_good(name: str) -> None:
    trial = Trial(iter_of("right", "right", name), False)
    trial.run(0.4)
    assert trial.good


@pytest.mark.parametrize(
    "name",
    some(
        (SHORT - {"late"}).__contains__, [name for name in (*BEHAVIOURS, *DAMAGED) if name not in ("right", *REPEATS)]
    ),
)
def test_on_a_serial_line_no_behaviour_makes_a_wrong_value_good(name: str) -> None:
    trial = Trial(iter_of("right", "right", name), True)
    trial.run(0.5)
    assert trial.good


@pytest.mark.parametrize("name", some(SHORT.__contains__, REPEATS))
def test_on_a_serial_line_an_answer_to_a_request_of_another_kind_is_never_good(name: str) -> None:
    trial = Trial(iter_of("right", "right", "right", name), True, repeats=True)
    trial.run(0.5)
    assert trial.good


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3))
def test_a_tcp_device_that_misbehaves_at_random_never_makes_a_wrong_value_good(seed: int) -> None:
    trial = Trial(fuzz(seed, rights=0.7), False)
    trial.run(FUZZED)
    assert trial.good
    assert trial.failed


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(3)))
def test_a_serial_device_that_misbehaves_at_random_never_makes_a_wrong_value_good(seed: int) -> None:
    names = [name for name in (*BEHAVIOURS, *DAMAGED) if name not in REPEATS]
    trial = Trial(fuzz(seed, names, rights=0.8), True)
    trial.run(FUZZED)
    assert trial.good
    assert trial.failed


def iter_of(*names: str) -> Iterator[str]:
    while True:
        yield from names


REQUESTS = [b"\x01\x04\x00\x00\x00\x03", b"\x01\x02\x00\x00\x00\x09", b"\x01\x06\x00\x00\x12\x34"]


@given(st.sampled_from(REQUESTS), st.binary(max_size=40) | st.binary(max_size=12).map(lambda b: b"\x01\x04\x06" + b))
@example(REQUESTS[0], b"\x01\x84\x02" + check_sum(b"\x01\x84\x02"))
def test_a_frame_of_a_serial_line_is_incomplete_wrong_or_has_the_right_check_sum(request: bytes, data: bytes) -> None:
    from umo.drivers.modbus.answer import Lost
    from umo.drivers.modbus.rtu_frame import answer_end

    for answer in (data, data + check_sum(data)):
        try:
            end = answer_end(request, answer)
        except Lost:
            continue
        assert 0 <= end <= len(answer)
        if end:
            assert check_sum(answer[: end - 2]) == answer[end - 2 : end]
            assert answer[0] == 1
            assert answer[1] & 0x7F == request[1]

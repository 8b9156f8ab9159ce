"""Whoever resets goes on as long as an attempt reaches anything: what answers again does not stay driven."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import umo
from helpers.machines import Board, bench, on, relay
from umo import connect
from umo.cycle import segments, transfer
from umo.cycle.attempts import Attempts
from umo.drivers import Channel, Direction, Driver
from umo.drivers.off_cycle import DeviceServer, Exchange
from umo.errors import DeviceTimeout, StopError
from umo.process.reset import Resetter
from umo.process.run_state import RunState
from umo.process.worker import WorkerProcess
from umo.system import calls
from umo.testing import periods
from umo.wiring import resolve

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux"),
    pytest.mark.timeout(method="thread"),  # a resetter in this process takes the alarm
]
CALL = 0.001
"""s that a call takes that is answered."""
ANSWERED_FOR = 0.5
"""s for which a device has to answer before the end for nothing on it to stay driven."""
RESET_FOR = 3.0


class Time:
    """The clock of a reset, and of the device: it goes on by waiting and by calls."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@dataclass(frozen=True)
class Outage:
    """The device is away from `start` for `length` s, counted from the begin of the reset."""

    start: float
    length: float
    how: str
    """silent: no answer in time; refused: an error at once. In both cases a request that is sent then is lost."""
    breaks: bool
    """Whether the first call afterwards, on a connection of before, fails at once: RST."""


@dataclass
class Device(Driver):
    time: Time
    outages: Sequence[Outage]
    timeout: float = 0.1
    levels: dict[str, int] = field(default_factory=dict)
    answered: list[float] = field(default_factory=list)
    """When it has carried out a reset, s."""
    began: float = 1000.0
    opened: list[float] = field(default_factory=list)
    """When it was opened, or was to be: once in each attempt, s."""
    timeouts: list[float] = field(default_factory=list)
    """Its timeouts then, s."""
    _opened: float = 0.0

    def channel(self, text: str) -> Channel:
        self.levels[text] = 1
        return Channel(text, Direction.OUTPUT, 1)

    def devices(self) -> list[str]:
        return [f"device {id(self)}"]

    def open(self) -> None:
        self._opened = self.time.now
        self.opened.append(self.time.now)
        self.timeouts.append(self.timeout)
        self._called()

    def _called(self) -> None:
        now = self.time.now - self.began
        for outage in self.outages:
            end = outage.start + outage.length
            if outage.start <= now < end:
                self.time.now += self.timeout if outage.how == "silent" else CALL
                raise DeviceTimeout("no answer") if outage.how == "silent" else ConnectionRefusedError("refused")
            if outage.breaks and end <= now and self._opened - self.began < end:
                self._opened = self.time.now
                raise ConnectionResetError("reset by the device")
        self.time.now += CALL

    def initialize(self, channel: Channel, default: int | None) -> None:
        self.reset(channel, default)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._called()
        self.levels[channel.text] = default or 0
        self.answered.append(self.time.now)

    def write(self, channel: Channel, raw: int) -> None:
        self.reset(channel, raw)

    def read(self, channel: Channel) -> int:
        raise AssertionError("nothing is read")


class Rack(umo.Compound):
    outs: list[umo.BinaryActuator[umo.states.OnOff]]


def resetter_of(*devices: Device, each: int) -> Resetter:
    """Of a machine with so many outputs at each device."""
    names = [f"d{number}" for number in range(len(devices))]
    machine = Rack(outs=[relay() for _ in range(each * len(devices))])
    wire = {f"outs.{i}": {"driver": names[i // each], "channel": f"{i}"} for i in range(each * len(devices))}
    wired = resolve(machine, {"drivers": dict(zip(names, devices, strict=True)), "wire": wire})
    for device in devices:
        device.timeout = 0.1
    return Resetter(machine, wired)


def no_room() -> int:
    raise BlockingIOError("no room for another process")


@pytest.fixture(scope="module")
def time() -> Iterator[Time]:
    """In place of the clocks of whoever resets, which works in this process."""
    time = Time()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "monotonic", time)
        patch.setattr(segments, "sleep", time.sleep)
        patch.setattr(calls, "now", time)
        patch.setattr(calls, "sleep", time.sleep)
        patch.setattr(calls, "fork", no_room)
        yield time


LENGTHS = st.floats(RESET_FOR - 0.5, RESET_FOR + 1.0) | st.floats(0.05, 0.4) | st.floats(0.0, 2 * RESET_FOR)
OUTAGES = st.builds(Outage, st.floats(-0.3, 0.01), LENGTHS, st.sampled_from(["silent", "refused"]), st.booleans())


@settings(deadline=None, max_examples=80)
@given(outages=st.lists(OUTAGES, min_size=1, max_size=2), each=st.integers(1, 5))
def test_nothing_stays_driven_on_a_device_that_answered_before_the_end(
    time: Time, outages: list[Outage], each: int
) -> None:
    devices = [Device(time, [outage], began=time.now) for outage in outages]
    left = resetter_of(*devices, each=each).reset(RESET_FOR)
    driven = {f"outs.{text}" for device in devices for text, level in device.levels.items() if level}
    assert driven <= set(left)  # nothing is told as reset that is not
    for device in devices:
        (outage,) = device.outages
        answers_for = time.now - device.began - outage.start - outage.length
        if answers_for >= ANSWERED_FOR or (device.answered and device.answered[-1] >= device.opened[-1]):
            assert not any(device.levels.values()), f"driven, though it has answered for {answers_for:.2f} s"


def test_a_device_that_answers_again_in_the_middle_of_the_last_attempt_is_reset_whole(time: Time) -> None:
    """The first write met the RST, the others of the attempt were carried out, and the time was over."""
    device = Device(time, [Outage(-0.1, RESET_FOR + 0.05, "silent", breaks=True)], began=time.now)
    assert resetter_of(device, each=4).reset(RESET_FOR) == {}
    assert not any(device.levels.values())


def test_a_dead_device_ends_the_attempts(time: Time) -> None:
    device = Device(time, [Outage(-1.0, 1e9, "silent", breaks=False)], began=time.now)
    assert len(resetter_of(device, each=3).reset(RESET_FOR)) == 3
    assert time.now - device.began < RESET_FOR + 2 * segments.UNCONTROLLED_TIMEOUT + 1.0


def test_a_silent_device_gets_more_time_from_attempt_to_attempt(time: Time) -> None:
    """A device that frees its one connection late was kept busy by the reconnecting."""
    device = Device(time, [Outage(-1.0, 1e9, "silent", breaks=False)], began=time.now)
    said = list[str]()
    resetter_of(device, each=2).reset(20.0, said=said.append)
    assert device.timeouts[:5] == [0.1, 0.4, 1.6, 3.0, 3.0]
    assert device.timeouts[-1] == 0.1
    assert [text.partition(": ")[0] for text in said] == ["not reached yet, retrying for up to 20 s"]


def test_what_was_not_tried_is_said_to_be_so(time: Time) -> None:
    class Opens(Device):
        def open(self) -> None:
            self.opened.append(self.time.now)

    said = list[str]()
    resetter_of(Opens(time, [Outage(-1.0, 1e9, "silent", False)], began=time.now), each=2).reset(1.0, said=said.append)
    assert "outs.0: d0 (device" in said[0]
    assert "outs.1: not tried: its driver did not answer in time" in said[0]


def test_the_attempts_of_a_reset_in_this_process_have_an_end(time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
    """What none has come to is tried one by one for as long again; then follows one more."""
    monkeypatch.setattr(calls, "set_alarm", lambda *given: None)  # the alarm is of real time
    device = Device(time, [Outage(-1.0, 1e9, "silent", breaks=False)], began=time.now)
    opened, closed = list[float](), list[float]()
    monkeypatch.setattr(device, "open", lambda: opened.append(time.now))
    monkeypatch.setattr(device, "close", lambda: closed.append(time.now))
    left = resetter_of(device, each=100).reset(RESET_FOR)
    assert time.now - device.began < 2 * RESET_FOR + 2 * segments.UNCONTROLLED_TIMEOUT + 1.0
    assert set(left.values()) == {f"d0 (device {id(device)}): no answer", "not tried: no time was left"}
    assert len(closed) == len(opened) > 2


def test_attempts_with_progress_are_as_many_as_there_are_actuators_at_most() -> None:
    attempts = Attempts()
    assert [attempts.add(reached) for reached in ("a", "", "ab", "ba", "c", "abc")] == [
        True,
        False,
        True,
        False,
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("failing", "left"),
    [
        ([0, 1, 2], []),  # it answers again in the middle of the second reset
        ([0, 1, 2, 4], ["motor"]),  # the third reaches no more than the second
        ([0, 2], ["motor"]),
        ([0, 1, 2, 3], ["motor", "valve"]),
    ],
)
def test_a_machine_is_left_by_as_many_resets_as_reach_anything(failing: list[int], left: list[str]) -> None:
    machine, box = bench(), Board("test_reset_attempts")
    connection = connect(machine, on(box, machine))
    connection.pause = lambda seconds: None
    unreached: list[str] = []
    try:
        with connection as m:
            periods(m)
            for number in failing:
                box.at(len(box.calls) + number, DeviceTimeout("no answer"))
    except StopError as error:
        unreached = [failure.path for failure in error.failures if "later attempt" not in failure.cause]
    except umo.errors.DriverError:  # some were reached at a later attempt
        pass
    assert unreached == left


# A worker that is left alone ---------------------------------------------------------------------------------


def alone(time: Time, count: int, outage: Outage) -> Device:
    """Initialise so many outputs, then reset them as the last process of a run; the outage is counted from there."""
    device = Device(time, [])
    channels = [device.channel(f"{i}") for i in range(count)]
    exchange = Exchange(channels, shared=False)
    server = DeviceServer(device, exchange, 0.02, lambda: round(time.now * 1e9))
    server.perform({"call": "open"})
    for channel in channels:
        server.perform({"call": "initialize", "channel": channel.text, "raw": 0})
        device.levels[channel.text] = 1
    device.began, device.outages = time.now, [outage]
    proxy: Any = SimpleNamespace(server=server, exchange=exchange)
    order = [channel.text for channel in channels]
    WorkerProcess(RunState(), [proxy], [order], 0.1, RESET_FOR, None)._reset_alone()
    return device


@settings(deadline=None, max_examples=50)
@given(outage=OUTAGES, count=st.integers(1, 4))
def test_a_worker_that_is_left_alone_tries_as_a_guardian_would(time: Time, outage: Outage, count: int) -> None:
    device = alone(time, count, outage)
    if time.now - device.began - outage.start - outage.length >= ANSWERED_FOR:
        assert not any(device.levels.values())

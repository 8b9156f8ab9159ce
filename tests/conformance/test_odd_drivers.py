"""The kit blames no driver that keeps the contract in an unusual way."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from time import monotonic, sleep
from typing import Any

import pytest

from conformance.careful import Careful, Place
from conformance.device import READ, frame
from conformance.plain import Bytes, Plain, Scpi, TwoBytes, of_bytes, scpi, serving
from conformance.subjects import HASTE, careful
from helpers.tiers import some
from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import ChannelError, DeviceTimeout, DriverError
from umo.testing.conformance import Input, Judgement, Output, Subject, TcpTap, conform

CYCLES = 20
LEVELS = {"wide": 0, "switch": 0}


class Memory(Driver):
    """Channels of 64 bits and of one."""

    CHANNELS = {
        "wide": Channel("wide", Direction.BOTH, 64, signed=True),
        "switch": Channel("switch", Direction.OUTPUT, 1),
    }

    def channel(self, text: str) -> Channel:
        if text not in self.CHANNELS:
            raise ChannelError(text, self.CHANNELS)
        return self.CHANNELS[text]

    def read(self, channel: Channel) -> int:
        return LEVELS[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        if not channel.lowest <= raw <= channel.highest:
            raise DriverError(f"{raw} does not fit {channel.text}")
        LEVELS[channel.text] = raw


class NearItsTimeout(Careful):
    """Each exchange takes most of the timeout."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        sleep(0.7 * HASTE)
        return super().exchange(function, channels, raws)


class Distant(Careful):
    """Each exchange takes 5 ms."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        sleep(0.005)
        return super().exchange(function, channels, raws)


class StartsSlowly(Careful):
    """The device needs 60 ms after it was connected; a call with less time ends in time."""

    def open(self) -> None:
        super().open()
        if self.timeout < 0.06:
            sleep(self.timeout)
            raise DeviceTimeout("the device is starting")
        sleep(0.06)


class SendsChangesOnly(Careful):
    """A level that the device has confirmed is not sent again on the same connection."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.confirmed: dict[Place, int] = {}

    def drop(self) -> None:
        super().drop()
        self.confirmed = {}

    def initialize(self, channel: Place, default: int | None) -> None:
        self.confirmed.pop(channel, None)
        super().initialize(channel, default)

    def reset(self, channel: Place, default: int | None) -> None:
        self.confirmed.pop(channel, None)
        super().reset(channel, default)

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        new = {c: raw for c, raw in zip(channels, raws, strict=True) if self.confirmed.get(c) != raw}
        for channel in new:
            self.confirmed.pop(channel, None)
        super().write_raws(list(new), list(new.values()))
        self.confirmed |= new


class ChecksWhatItWrote(Careful):
    """Each write is read back, in one more exchange."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        super().write_raws(channels, raws)
        if channels and [raw for _, raw in self.exchange(READ, channels, [0] * len(channels))] != list(raws):
            raise DriverError("it was not taken")


class SwitchesOnFirst(Careful):
    """Reset and initialise switch the output on first, by a level of another place: out:2 for out:0."""

    def initialize(self, channel: Place, default: int | None) -> None:
        self.reset(channel, default)

    def reset(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.write_raws((replace(channel, number=channel.number + 2),), [channel.highest])
        super().reset(channel, default)


class WritesTwice(Careful):
    """Reset writes the level that is there once more, then the default, twice."""

    def reset(self, channel: Place, default: int | None) -> None:
        if default is not None:
            there = self.exchange(READ, (channel,), [0])[0][1]
            for raw in (there, default, default):
                self.write(channel, raw)


class LogsItsFailures(Careful):
    """A call that fails tells `logging` why; nothing is set up there, so it would come to stderr."""

    log = logging.getLogger("conformance.careful")
    log.propagate = False

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        try:
            return super().exchange(function, channels, raws)
        except OSError as error:
            self.log.warning("failed: %s", error)
            raise


class OneByOne(Careful):
    """A block is a request for each channel."""

    read_many = Driver.read_many
    write_many = Driver.write_many

    def read(self, channel: Place) -> int:
        answer = self.exchange(READ, (channel,), [0])
        self.check((channel,), answer)
        return answer[0][1]


class GreetsTheDevice(Careful):
    """A request with its answer follows each connection."""

    greeted: Any = None

    def connect(self) -> None:
        super().connect()
        if self.greeted is not self.connection:
            self.greeted = self.connection
            self.number += 1
            self.send(frame(self.number, READ, [(41, 0)]))
            self.answer(READ, 1)
            self.number += 1


class Beats(Careful):
    """A thread of its own tells the device, on a connection of its own, that the driver lives."""

    def open(self) -> None:
        super().open()
        self.end = threading.Event()
        self.beat = Careful(host=self.host, port=self.port)
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self) -> None:
        while not self.end.wait(0.01):
            try:
                self.beat.timeout = 0.02
                self.beat.is_open or self.beat.open()
                self.beat.exchange(READ, (self.channel("in:8"),), [0])
            except OSError:
                pass
        self.beat.close()

    def close(self) -> None:
        super().close()
        if hasattr(self, "end"):
            self.end.set()
            self.thread.join()


class Steps(Careful):
    """The device has steps of 4 for its outputs."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        coarse = [raw // 4 * 4 if c.lowest <= raw <= c.highest else raw for c, raw in zip(channels, raws, strict=True)]
        super().write_raws(channels, coarse)


class Moving(Careful):
    """in:8 and in:9 change with each reading."""

    turn = 0

    def read_many(self, channels: Sequence[Place], out: Any) -> None:
        super().read_many(channels, out)
        Moving.turn += 1
        for i, channel in enumerate(channels):
            if channel.text in ("in:8", "in:9"):
                out[i] += self.turn % 7


class Noisy(Careful):
    """The last digit of in:0 varies."""

    noise = 0

    def read_many(self, channels: Sequence[Place], out: Any) -> None:
        super().read_many(channels, out)
        for i, channel in enumerate(channels):
            if channel.text == "in:0":
                Noisy.noise = (self.noise + 1) % 3
                out[i] += self.noise


class SensorsOnly(Careful):
    """It has no `write` of its own."""

    write, write_many = Driver.write, Driver.write_many  # type: ignore[assignment]


class OutputsOnly(Careful):
    """It has no `read` of its own."""

    read, read_many = Driver.read, Driver.read_many  # type: ignore[assignment]


class Event(Place):
    """A channel whose writes are events."""

    @property
    def event(self) -> bool:
        return True


class EventsOnly(OutputsOnly):
    """A write is a pulse: the device is back at 0 by itself."""

    def channel(self, text: str) -> Place:
        channel = super().channel(text)
        return Event(text, channel.direction, 1, number=channel.number)

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        super().write_raws(channels, raws)
        pulsed = [channel for channel, raw in zip(channels, raws, strict=True) if raw]
        if pulsed:
            super().write_raws(pulsed, [0] * len(pulsed))


class Told(Careful):
    """The device is asked at most every 20 ms: the readings in between are older, which `ages` says."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.kept: dict[tuple[Place, ...], tuple[float, list[int]]] = {}

    def read(self, channel: Place) -> int:
        out = [0]
        super().read_many((channel,), out)  # type: ignore[arg-type]
        return out[0]

    def read_many(self, channels: Sequence[Place], out: Any) -> None:
        at, raws = self.kept.get(tuple(channels), (0.0, []))
        if monotonic() - at < 0.02:
            out[:] = raws
            return
        began = monotonic()
        super().read_many(channels, out)
        self.kept[tuple(channels)] = began, list(out)

    def drop(self) -> None:
        super().drop()
        self.kept = {}

    def ages(self, channels: Sequence[Place]) -> Sequence[float]:
        return [monotonic() - self.kept[tuple(channels)][0] for _ in channels]


class LooksByReading(Careful):
    """Its look reads an input in a call that waits a little."""

    def look(self) -> bool | None:
        timeout, self.timeout = self.timeout, 0.03
        try:
            self.read(self.channel("in:8"))
        finally:
            self.timeout = timeout
        return True


INPUTS = (Input("in:8"), Input("in:9"))
OUTPUTS = (Output("out:0", 5, 0, 255), Output("out:1", 0, 0, 255))
MOVING = (Input("in:8", steady=False), Input("in:9", steady=False))
NO_OUTPUTS: dict[str, Any] = {"outputs": (), "loopbacks": (), "refused": ("in:40",), "levels": None}
ODD: dict[str, Callable[[], Any]] = {
    "careful": careful,
    "its answers take most of the timeout": lambda: careful(NearItsTimeout),
    "its answers take 5 ms": lambda: careful(Distant),
    "it starts slowly": lambda: careful(StartsSlowly),
    "its timeout is 5 s": lambda: careful(timeout=5.0),
    "it sends changes only": lambda: careful(SendsChangesOnly),
    "it reads back what it wrote": lambda: careful(ChecksWhatItWrote),
    "it switches outputs on first": lambda: careful(SwitchesOnFirst, levels=None),
    "its reset writes twice": lambda: careful(WritesTwice, levels=None),
    "it has no blocks": lambda: careful(OneByOne),
    "it greets the device": lambda: careful(GreetsTheDevice),
    "a thread of it beats": lambda: careful(Beats),
    "its outputs have steps": lambda: careful(Steps, agree=lambda one, raw, other, seen: 0 <= raw - seen < 4),
    "sensors only": lambda: careful(inputs=INPUTS, **NO_OUTPUTS),
    "sensors that move": lambda: careful(Moving, inputs=MOVING, **NO_OUTPUTS),
    "one sensor": lambda: careful(inputs=INPUTS[:1], **NO_OUTPUTS),
    "outputs only": lambda: careful(
        outputs=(Output("out:0", 5, 0, 255), Output("out:1")), inputs=(), loopbacks=(), refused=(), levels=None
    ),
    "one output": lambda: careful(outputs=(Output("out:0"),), inputs=(), loopbacks=(), refused=()),
    "sensors only, without a write of its own": lambda: careful(SensorsOnly, inputs=INPUTS, **NO_OUTPUTS),
    "outputs only, and one that the device refuses": lambda: careful(
        OutputsOnly, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",)
    ),
    "outputs only, without a record": lambda: careful(
        OutputsOnly, outputs=OUTPUTS, inputs=(), loopbacks=(), refused=("out:40",), levels=None
    ),
    "events only": lambda: careful(
        EventsOnly,
        outputs=(Output("out:0"), Output("out:1")),
        inputs=(),
        loopbacks=(),
        refused=("out:40",),
        levels=None,
        checksum=False,
    ),
    "it is told its values": lambda: careful(Told),
    "it looks by reading": lambda: careful(LooksByReading),
    "two channels": lambda: careful(outputs=(Output("out:0"),), inputs=(Input("in:0"),), refused=(), levels=None),
    "its device has a watchdog": lambda: careful(watchdog=0.15, timeout=0.25),
    "no record of levels": lambda: careful(levels=None),
    "no refused channel": lambda: careful(refused=()),
    "answers of one byte": lambda: plain(Bytes, of_bytes(1), 255),
    "answers of two bytes without a frame": lambda: plain(TwoBytes, of_bytes(2), 65535),
    "silence for what is unknown": lambda: plain(Scpi, scpi(), 65535, refused=("unknown",), settle=0.1),
}


@contextmanager
def plain(driver: type[Plain], device: Callable[[bytes], bytes], greatest: int, **more: Any) -> Iterator[Subject]:
    """A driver of a device with an output and an input that reads it."""
    with serving(device) as port, TcpTap("127.0.0.1", port) as tap:
        subject = Subject(
            driver.__name__,
            make=lambda: driver(port=tap.port),
            direct=lambda: driver(port=port),
            outputs=(Output("out", 0, 0, greatest),),
            inputs=(Input("in"),),
            loopbacks=(("out", "in"),),
            line=tap,
            timeout=0.1,
        )
        yield replace(subject, **more)


@pytest.mark.full
@pytest.mark.parametrize("what", ODD)
def test_a_correct_driver_passes(what: str) -> None:
    with ODD[what]() as subject:
        certificate = conform(subject, cycles=CYCLES)
    assert certificate.passed, str(certificate)
    assert certificate.line_tried


@pytest.mark.parametrize(
    "driver",
    some(
        lambda driver: driver in (SwitchesOnFirst, SendsChangesOnly),
        (SwitchesOnFirst, SendsChangesOnly, WritesTwice, ChecksWhatItWrote, OneByOne, GreetsTheDevice, Beats),
    ),
)
def test_the_requests_of_a_correct_reset_are_not_blamed(driver: type[Careful]) -> None:
    with careful(driver, levels=None) as subject:
        certificate = conform(subject, only=["glitch"])
    assert certificate.finding("glitch").verdict is Judgement.PASSED, str(certificate)
    said = certificate.finding("glitch").why or ""
    if driver is not Beats:  # it depends on when it beats
        assert ("short pulses of" in said) == (driver in (SwitchesOnFirst, WritesTwice)), said


def test_what_a_driver_logs_does_not_count_as_printed() -> None:
    with careful(LogsItsFailures) as subject:
        found = conform(subject, only=["process"]).finding("process")
    assert found.verdict is Judgement.PASSED, found


def wide() -> Subject:
    return Subject("wide", make=Memory, outputs=(Output("wide", -7, -(2**63), 2**63 - 1),))


def switch() -> Subject:
    return Subject("switch", make=Memory, outputs=(Output("switch"),), levels=lambda text: [LEVELS[text]])


@pytest.mark.parametrize("subject", [wide, switch])
def test_a_channel_of_64_bits_and_a_single_binary_output_pass(subject: Callable[[], Subject]) -> None:
    certificate = conform(subject(), cycles=CYCLES)
    assert certificate.passed, str(certificate)


@pytest.mark.full
def test_a_loop_back_that_follows_late_and_with_noise_passes() -> None:
    with careful(
        Noisy, wire=0.004, inputs=(Input("in:0"), Input("in:9")), levels=None,
        agree=lambda one, raw, other, seen: 0 <= seen - raw <= 2 if one == "out:0" else raw == seen,
    ) as subject:  # fmt: skip
        lines = ["late answer", "short answer", "garbled answer", "error answer", "answer in pieces", "long run"]
        certificate = conform(subject, only=lines, cycles=100)
    assert {each.verdict for each in certificate.findings} == {Judgement.PASSED}, str(certificate)


def test_a_loop_back_that_takes_longer_than_a_cycle_passes_the_long_run() -> None:
    with careful(wire=0.004) as subject:
        certificate = conform(subject, only=["long run"], cycles=400)
    assert "in:0: compared now and then" in certificate.finding("long run").why
    assert certificate.passed, str(certificate)

"""Correct drivers that keep the contract in an unusual way."""

from __future__ import annotations

import atexit
import logging
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import monotonic, sleep
from typing import Any

from conformance.careful import HASTE, Careful, Place
from conformance.device import READ, frame
from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.optional import KnowsAges
from umo.errors import ChannelError, DeviceTimeout, DriverError

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


class Lags(Driver):
    """An input that takes its time to come to the level of its output, through those in between."""

    CHANNELS = {
        "out": Channel("out", Direction.OUTPUT, 8),
        "in": Channel("in", Direction.INPUT, 8),
        "none": Channel("none", Direction.BOTH, 8),
    }
    TIME = 0.03
    """s until it is there."""
    way = 0, 0.0, 0
    """Of the circuit, which all drivers have in common: where it was at which time, and where it goes to."""

    def channel(self, text: str) -> Channel:
        if text not in self.CHANNELS:
            raise ChannelError(text, self.CHANNELS)
        return self.CHANNELS[text]

    def read(self, channel: Channel) -> int:
        if channel.text != "in":
            raise DriverError(f"{channel.text} cannot be read")
        left, since, goal = Lags.way  # at once: another driver writes in a thread
        return round(left + min(1.0, (monotonic() - since) / self.TIME) * (goal - left))

    def write(self, channel: Channel, raw: int) -> None:
        channel.check(raw)
        if channel.text == "none":
            raise DriverError("there is no such output")
        if raw != Lags.way[-1]:
            Lags.way = self.read(self.CHANNELS["in"]), monotonic(), raw


class NeedsInitialise(Careful):
    """A channel can be used from when it was initialised until it is finalised, as umo does."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.ready: set[Place] = set()

    def initialize(self, channel: Place, default: int | None) -> None:
        self.ready.add(channel)
        super().initialize(channel, default)

    def finalize(self, channel: Place) -> None:
        self.must_be_ready((channel,))
        self.ready.discard(channel)

    def reset(self, channel: Place, default: int | None) -> None:
        self.must_be_ready((channel,))
        super().reset(channel, default)

    def read_many(self, channels: Sequence[Place], out: Any) -> None:
        self.must_be_ready(channels)
        super().read_many(channels, out)

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        self.must_be_ready(channels)
        super().write_raws(channels, raws)

    def must_be_ready(self, channels: Sequence[Place]) -> None:
        for channel in channels:
            if channel not in self.ready and channel.text not in ("io:40", "in:40"):
                raise DriverError(f"{channel.text} was not initialised")


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


class Told(Careful, KnowsAges):
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


class ToldSinceTheLastReading(Told):
    """A reading is as old as the call before it: it may have come at any time since."""

    last = 0.0
    before = 0.0

    def read_many(self, channels: Sequence[Place], out: Any) -> None:
        self.before, self.last = self.last, monotonic()
        self.kept = {}
        super().read_many(channels, out)

    def ages(self, channels: Sequence[Place]) -> Sequence[float]:
        return [monotonic() - self.before for _ in channels]


class TakesTurns(Careful):
    """It connects with its first call, and finds only then that another client has the device."""

    users: list[object] = []

    def open(self) -> None:
        self.is_open = True

    def connect(self) -> None:
        self.users[:] = self.users or [self]
        if self.users[0] is not self:
            raise DriverError("another client has the device")
        super().connect()

    def close(self) -> None:
        super().close()
        if self.users == [self]:
            self.users.clear()


class LooksByReading(Careful):
    """Its look reads an input in a call that waits a little."""

    def look(self) -> bool | None:
        timeout, self.timeout = self.timeout, 0.03
        try:
            self.read(self.channel("in:8"))
        finally:
            self.timeout = timeout
        return True


class ReadsByteByByte(Careful):
    """Each byte of an answer is received alone."""

    def receive(self, length: int) -> bytes:
        return b"".join(super(ReadsByteByByte, self).receive(1) for _ in range(length))


class LocksItself(Careful):
    """A lock serves all calls; it is free again after each."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.lock = threading.Lock()

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        if not self.lock.acquire(timeout=self.timeout):
            raise DeviceTimeout("another call is under way")
        try:
            return super().exchange(function, channels, raws)
        finally:
            self.lock.release()


class HasAWorker(Careful):
    """A thread of its own makes the exchanges; it ends with `close`."""

    worker: ThreadPoolExecutor | None = None

    def open(self) -> None:
        self.worker = ThreadPoolExecutor(1)
        super().open()

    def close(self) -> None:
        super().close()
        if self.worker is not None:
            self.worker.shutdown()
            self.worker = None

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        if self.worker is None:
            raise DriverError("it is not open")
        return self.worker.submit(super().exchange, function, channels, raws).result()


class ClosesAtExit(Careful):
    """The exit of the program closes it, if it is open."""

    def open(self) -> None:
        atexit.register(self.close)
        super().open()

    def close(self) -> None:
        atexit.unregister(self.close)
        super().close()


class ReadsInTwoParts(Careful):
    """A block is two requests with one deadline; the second is sent also if the device refused some of the first."""

    going_on = False

    def begin(self) -> None:
        if not self.going_on:
            super().begin()

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        half = (len(channels) + 1) // 2
        found = super().exchange(function, channels[:half], raws[:half])
        self.going_on = True
        try:
            return found + (super().exchange(function, channels[half:], raws[half:]) if channels[half:] else [])
        finally:
            self.going_on = False

"""A driver of the device that keeps every rule; the broken ones (broken.py) each change one function of it."""

from __future__ import annotations

import select
import socket
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

from conformance.device import ARM, CHECK, FAILED, HEADER, ITEM, PLACES, READ, WRITE, frame, size
from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.optional import HasWatchdog, Inspects, KnowsScale, Looks, PhysicalScale, Reports
from umo.errors import ChannelError, ChannelsFailed, DeviceTimeout, DriverError

HASTE = 0.025
"""s: the timeout of calls that are to time out."""
KINDS = {"out": (Direction.OUTPUT, 8, False), "io": (Direction.BOTH, 12, True), "in": (Direction.INPUT, 16, False)}


@dataclass(frozen=True)
class Place(Channel):
    """Its number in the device."""

    number: int = 0


class Careful(Driver[Place], Looks, HasWatchdog, KnowsScale, Inspects, Reports):
    """Channels out:N, io:N and in:N."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        self.host, self.port = host, port
        self.connection: socket.socket | None = None
        self.searched: socket.socket | None = None
        self.is_open = False
        self.number = 0
        self.deadline = self.latest = 0.0

    def channel(self, text: str) -> Place:
        kind, _, number = text.partition(":")
        if kind not in KINDS or not number.isdecimal():
            raise ChannelError(text, [f"{kind}:N" for kind in KINDS])
        return Place(text, *KINDS[kind], number=PLACES[kind] + int(number))

    def devices(self) -> Sequence[str]:
        return [f"device tcp {self.host}:{self.port}"]

    def open(self) -> None:
        self.is_open = True
        self.begin()
        self.connect()

    def close(self) -> None:
        self.is_open = False
        self.drop()

    def read(self, channel: Place) -> int:
        out = [0]
        self.read_many((channel,), out)  # type: ignore[arg-type]
        return out[0]

    def write(self, channel: Place, raw: int) -> None:
        self.write_raws((channel,), [raw])

    def read_many(self, channels: Sequence[Place], out: IntArray) -> None:
        answer = self.exchange(READ, channels, [0] * len(channels))
        for i, (status, raw) in enumerate(answer):
            if not status:
                out[i] = raw
        self.check(channels, answer)

    def write_many(self, channels: Sequence[Place], raws: IntArray) -> None:
        self.write_raws(channels, raws.tolist())

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        for channel, raw in zip(channels, raws, strict=True):
            if Direction.OUTPUT not in channel.direction:
                raise DriverError(f"{channel.text} is an input")
            if not channel.lowest <= raw <= channel.highest:
                raise DriverError(f"{raw} does not fit {channel.text}: {channel.lowest} to {channel.highest}")
        self.check(channels, self.exchange(WRITE, channels, raws))

    def look(self) -> bool | None:
        """A connection of its own, one request, and its answer in a later look."""
        if self.connection is not None and not select.select([self.connection], [], [], 0)[0]:
            return True
        if self.searched is None:
            self.drop()
            self.searched = socket.create_connection((self.host, self.port), 0.05)
            self.searched.sendall(frame(1, READ, [(40, 0)]))
            self.latest = monotonic() + self.timeout
        elif select.select([self.searched], [], [], 0)[0]:
            searched, self.searched = self.searched, None
            searched.setblocking(False)
            answered = len(searched.recv(100)) == size(1)
            searched.close()
            return answered
        elif monotonic() > self.latest:
            self.drop()
            return False
        return None

    def watchdog(self, seconds: float) -> None:
        self.check_watchdog(seconds)
        self.exchange(ARM, (self.channel("in:0"),), [round(1000 * seconds)])

    def check_watchdog(self, seconds: float) -> None:
        if not 0 <= seconds <= 60:
            raise DriverError("the watchdog takes 0 to 60 s")

    def physical_scale(self, channel: Place) -> PhysicalScale | None:
        return PhysicalScale(0.02, 0.0, "V")

    def inspect(self, channel: Place) -> str:
        return f"place {channel.number} has {self.read(channel)}"

    def report(self) -> Mapping[str, Any]:
        return {"requests": self.number}

    # One exchange ------------------------------------------------------------------------------------

    def begin(self) -> None:
        if not self.is_open:
            raise DriverError("it is not open")
        self.deadline = monotonic() + self.timeout

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        """The status and level of each channel."""
        self.begin()
        if not channels:
            return []
        self.number = self.number % 65535 + 1
        try:
            self.connect()
            self.send(frame(self.number, function, [(c.number, raw) for c, raw in zip(channels, raws, strict=True)]))
            return self.answer(function, len(channels))
        except OSError:
            self.drop()
            raise

    def connect(self) -> None:
        if self.connection is not None and select.select([self.connection], [], [], 0)[0]:
            self.drop()  # the end of the connection, or an answer that nobody waits for
        if self.connection is None:
            try:
                self.connection = socket.create_connection((self.host, self.port), self.left())
            except TimeoutError:
                raise DeviceTimeout("connecting timed out") from None
            self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def drop(self) -> None:
        if self.searched is not None:
            self.searched.close()
            self.searched = None
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    def left(self) -> float:
        if (left := self.deadline - monotonic()) <= 0:
            raise DeviceTimeout("timed out")
        return left

    def send(self, request: bytes) -> None:
        assert self.connection is not None
        self.connection.settimeout(self.left())
        self.connection.sendall(request)

    def answer(self, function: int, count: int) -> list[tuple[int, int]]:
        data = self.receive(size(count))
        self.verify(data, function, count)
        return [ITEM.unpack_from(data, HEADER.size + i * ITEM.size) for i in range(count)]

    def receive(self, length: int) -> bytes:
        assert self.connection is not None
        data = b""
        while len(data) < length:
            self.connection.settimeout(self.left())
            try:
                part = self.connection.recv(length - len(data))
            except TimeoutError:
                raise DeviceTimeout("timed out") from None
            if not part:
                raise DriverError("the device closed the connection")
            data += part
        return data

    def verify(self, data: bytes, function: int, count: int) -> None:
        if CHECK.unpack_from(data, len(data) - 2)[0] != zlib.crc32(data[:-2]) & 0xFFFF:
            raise DriverError("an answer with a wrong checksum")
        self.fits(*HEADER.unpack_from(data), function, count)

    def fits(self, number: int, answered: int, its_count: int, function: int, count: int) -> None:
        if (number, answered & ~FAILED, its_count) != (self.number, function, count):
            raise DriverError("an answer to another request")

    def check(self, channels: Sequence[Place], answer: list[tuple[int, int]]) -> None:
        failed = {c.text: f"status {status}" for c, (status, _) in zip(channels, answer, strict=True) if status}
        if failed:
            raise ChannelsFailed(failed)

"""Drivers that each break one rule: bugs as they are met in real drivers.

`BREAKS` says which rule the kit must find broken. More of them, in brief: mutants.txt.
"""

from __future__ import annotations

import select
import socket
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from time import monotonic
from typing import Any

from conformance.careful import Careful, Place
from conformance.device import READ, WRITE
from umo.drivers.contract import Direction, IntArray
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError


class KeyErrorForAnUnknownChannel(Careful):
    """An unknown channel raises what the look-up in a dict raises."""

    def channel(self, text: str) -> Place:
        if text.partition(":")[0] not in ("out", "io", "in"):
            raise KeyError(text)
        return super().channel(text)


class ConnectsWhenMade(Careful):
    """The constructor connects: `umo check` would access the device."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        with suppress(OSError):
            socket.create_connection((host, port)).close()


class ComesUpViaZero(Careful):
    """Initialise writes 0 first."""

    def initialize(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.write(channel, 0)
        super().initialize(channel, default)


class ResetsToZero(Careful):
    """Reset writes 0, whatever the default."""

    def reset(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.write(channel, 0)


class DoesNotResetAfterAFailure(Careful):
    """Reset does nothing without a connection, and a failed call has closed it."""

    def reset(self, channel: Place, default: int | None) -> None:
        if self.connection is not None:
            super().reset(channel, default)


class FinalisesAllChannels(Careful):
    """Finalise of one channel closes the connection of all."""

    def finalize(self, channel: Place) -> None:
        self.close()


class ReopensADeadSocket(Careful):
    """Close keeps the closed socket, and open takes it for a connection."""

    def close(self) -> None:
        self.is_open = False
        if self.connection is not None:
            self.connection.close()

    def connect(self) -> None:
        if self.connection is None or self.connection.fileno() >= 0:
            super().connect()


class OffByOne(Careful):
    """The upper end of a range counts as beyond it."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        for channel, raw in zip(channels, raws, strict=True):
            if raw >= channel.highest:
                raise DriverError(f"{raw} does not fit {channel.text}")
        super().write_raws(channels, raws)


class Clamps(Careful):
    """A level beyond the range is taken for its end."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        clamped = [max(c.lowest, min(raw, c.highest)) for c, raw in zip(channels, raws, strict=True)]
        super().write_raws(channels, clamped)


class Wraps(Careful):
    """A level beyond the range loses its upper bits."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        spans = [(c.lowest, 1 << c.bits) for c in channels]
        super().write_raws(channels, [(raw - low) % span + low for raw, (low, span) in zip(raws, spans, strict=True)])


class TakesWritesToInputs(Careful):
    """A write to an input is passed over in silence."""

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        if channels and channels[0].direction is Direction.INPUT:
            return
        super().write_raws(channels, raws)


class ReadsAFloat(Careful):
    """A reading is a float."""

    def read(self, channel: Place) -> int:
        return float(super().read(channel))  # type: ignore[return-value]


class SwapsTheOrder(Careful):
    """A block is sent in the order of its places, its levels in the order of the call."""

    def write_many(self, channels: Sequence[Place], raws: IntArray) -> None:
        super().write_many(sorted(channels, key=lambda channel: channel.number), raws)


class ReadsInItsOwnOrder(Careful):
    """A block is read in the order of its places."""

    def read_many(self, channels: Sequence[Place], out: IntArray) -> None:
        super().read_many(sorted(channels, key=lambda channel: channel.number), out)


class StopsAtTheFirstFailure(Careful):
    """A block ends with the first channel that fails; those behind it are not named."""

    def write_many(self, channels: Sequence[Place], raws: IntArray) -> None:
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            self.write(channel, raw)


class NamesAnotherChannel(Careful):
    """The error of a block names channels by their places."""

    def check(self, channels: Sequence[Place], answer: list[tuple[int, int]]) -> None:
        failed = {str(c.number): "refused" for c, (status, _) in zip(channels, answer, strict=True) if status}
        if failed:
            raise ChannelsFailed(failed)


class KeepsTheBuffer(Careful):
    """Levels that have not changed are not sent, and the last ones are kept as the caller's own array."""

    last: tuple[Sequence[Place], IntArray] | None = None

    def write_many(self, channels: Sequence[Place], raws: IntArray) -> None:
        if self.last is not None and self.last[0] == channels and (self.last[1] == raws).all():
            return
        super().write_many(channels, raws)
        self.last = channels, raws

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        self.last = None
        super().write_raws(channels, raws)


class WaitsForEver(Careful):
    """The socket has no timeout."""

    def left(self) -> float:
        return None  # type: ignore[return-value]


class TimesOutPerByte(Careful):
    """Each byte that comes in begins the timeout anew."""

    def receive(self, length: int) -> bytes:
        data = b""
        while len(data) < length:
            self.deadline = monotonic() + self.timeout
            data += super().receive(1)
        return data


class Retries(Careful):
    """A call that timed out is tried three times more, each for as long."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        for _ in range(3):
            try:
                return super().exchange(function, channels, raws)
            except TimeoutError:
                pass
        return super().exchange(function, channels, raws)


class HasATimeoutOfItsOwn(Careful):
    """`timeout` is cut to the one that it had when it was opened."""

    def open(self) -> None:
        self.first = self.timeout
        super().open()

    def left(self) -> float:
        return min(super().left(), self.first)


class TakesLateAnswers(Careful):
    """After a timeout it goes on with the connection; the number of an answer is not compared."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        kept = self.connection
        self.keeps = True
        try:
            return super().exchange(function, channels, raws)
        except TimeoutError:
            self.connection = self.connection or kept
            raise

    def connect(self) -> None:
        if self.connection is None:
            super().connect()

    def drop(self) -> None:
        if not isinstance(sys.exception(), TimeoutError):
            super().drop()

    def fits(self, number: int, answered: int, its_count: int, function: int, count: int) -> None:
        super().fits(self.number, answered, its_count, function, count)


class TakesOldAnswers(Careful):
    """The number of an answer is not compared."""

    def fits(self, number: int, answered: int, its_count: int, function: int, count: int) -> None:
        super().fits(self.number, answered, its_count, function, count)


class FillsUpShortAnswers(Careful):
    """What is missing when the connection ends counts as 0."""

    short = False

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
                break
            data += part
        self.short = len(data) < length
        return data.ljust(length, b"\0")

    def verify(self, data: bytes, function: int, count: int) -> None:
        if not self.short:
            super().verify(data, function, count)


class IgnoresTheChecksum(Careful):
    """The checksum of an answer is not compared."""

    def verify(self, data: bytes, function: int, count: int) -> None:
        from conformance.device import HEADER

        self.fits(*HEADER.unpack_from(data), function, count)


class IgnoresErrorAnswers(Careful):
    """The status of an answer is not looked at."""

    def check(self, channels: Sequence[Place], answer: list[tuple[int, int]]) -> None:
        pass


class GivesUp(Careful):
    """A connection that was refused once is not tried again."""

    dead = False

    def connect(self) -> None:
        if self.dead:
            raise DriverError("the device is not there")
        try:
            super().connect()
        except ConnectionRefusedError:
            self.dead = True
            raise


class SharesItsConnection(Careful):
    """All drivers of a device use one connection; the first that closes takes it from the others."""

    shared: dict[int, socket.socket | None] = {}

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        before = self.shared.get(port)
        super().__init__(host=host, port=port)
        self.connection = before

    @property  # type: ignore[override]
    def connection(self) -> socket.socket | None:
        return self.shared.get(self.port)

    @connection.setter
    def connection(self, connection: socket.socket | None) -> None:
        self.shared[self.port] = connection

    def connect(self) -> None:
        connection = self.connection
        if connection is None or connection.fileno() >= 0:
            super().connect()

    def close(self) -> None:
        self.is_open = False
        if self.connection is not None:
            self.connection.close()

    def open(self) -> None:
        if self.connection is not None and self.connection.fileno() < 0:
            self.connection = None
        super().open()


class LeaksSockets(Careful):
    """A lost connection is left open."""

    left_open: list[socket.socket] = []

    def drop(self) -> None:
        if self.connection is not None and self.is_open:
            self.left_open.append(self.connection)
            self.connection = None
        super().drop()


class LeaksThreads(Careful):
    """Each open starts a thread that close does not end."""

    end = threading.Event()

    def open(self) -> None:
        super().open()
        threading.Thread(target=self.end.wait, daemon=True).start()


class Grows(Careful):
    """Every call is noted in a list."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.notes: list[Any] = []

    def read_many(self, channels: Sequence[Place], out: IntArray) -> None:
        super().read_many(channels, out)
        self.notes.append(f"{READ} {WRITE} {monotonic()}")


class RaisesKeyErrors(Careful):
    """A status that is not in the table of statuses raises KeyError."""

    def check(self, channels: Sequence[Place], answer: list[tuple[int, int]]) -> None:
        for status, _ in answer:
            {0: "ok", 1: "busy"}[status]


class TakesAPartForTheWhole(Careful):
    """What comes in at once counts as the whole answer."""

    def receive(self, length: int) -> bytes:
        assert self.connection is not None
        self.connection.settimeout(self.left())
        try:
            data = self.connection.recv(length)
        except TimeoutError:
            raise DeviceTimeout("timed out") from None
        if len(data) < length:
            raise DriverError("the device closed the connection")
        return data


class ConnectsWithoutATimeout(Careful):
    """The timeout is set once there is a connection."""

    def connect(self) -> None:
        if self.connection is not None and select.select([self.connection], [], [], 0)[0]:
            self.drop()
        if self.connection is None:
            self.connection = socket.create_connection((self.host, self.port))


class WritesTheWholePort(Careful):
    """Outputs share a register: the driver sends all of it, from a copy that begins with 0."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.register: dict[Place, int] = {}

    def channel(self, text: str) -> Place:
        channel = super().channel(text)
        if text.startswith("out:"):
            self.register.setdefault(channel, 0)
        return channel

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        levels = self.register | dict(zip(channels, raws, strict=True))
        super().write_raws(list(levels), list(levels.values()))
        self.register |= {channel: levels[channel] for channel in self.register}


class SkipsWhatItFailedToWrite(Careful):
    """A level is noted before it is sent, and not sent again."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.last: dict[Place, int] = {}

    def initialize(self, channel: Place, default: int | None) -> None:
        self.last.pop(channel, None)
        super().initialize(channel, default)

    def reset(self, channel: Place, default: int | None) -> None:
        self.last.pop(channel, None)
        super().reset(channel, default)

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        new = {c: raw for c, raw in zip(channels, raws, strict=True) if self.last.get(c) != raw}
        self.last |= new
        try:
            super().write_raws(list(new), list(new.values()))
        except DriverError:  # of a lost connection it has not thought
            for channel in new:
                self.last.pop(channel)
            raise


class RemembersLevelsWhenReopened(Careful):
    """A level that is the last one is not sent; close does not forget it."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.last: dict[Place, int] = {}

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        new = {c: raw for c, raw in zip(channels, raws, strict=True) if self.last.get(c) != raw}
        try:
            super().write_raws(list(new), list(new.values()))
        except OSError:
            for channel in new:
                self.last.pop(channel, None)
            raise
        self.last |= new


class ResetsAllOutputs(Careful):
    """Reset of one output brings all of them to their defaults."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.defaults: dict[Place, int] = {}

    def initialize(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.defaults[channel] = default
        super().initialize(channel, default)

    def reset(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.write_raws(list(self.defaults), list(self.defaults.values()))


class TakesBlocksToInputs(Careful):
    """Directions are looked at in `write` alone."""

    def write_many(self, channels: Sequence[Place], raws: IntArray) -> None:
        outputs = [(c, raw) for c, raw in zip(channels, raws.tolist(), strict=True) if Direction.OUTPUT in c.direction]
        self.write_raws([c for c, _ in outputs], [raw for _, raw in outputs])


class SwitchesOffWhenFinalised(Careful):
    """Finalise of one output switches all off."""

    def finalize(self, channel: Place) -> None:
        if Direction.OUTPUT in channel.direction:
            self.write_raws([self.channel("out:0"), self.channel("out:1")], [0, 0])


class LeaksWhenItCannotConnect(Careful):
    """A socket that could not be connected is left open."""

    left_open: list[socket.socket] = []

    def connect(self) -> None:
        try:
            super().connect()
        except OSError:
            self.left_open.append(socket.socket())
            raise


class WaitsForGoodbye(Careful):
    """Close waits for the device to say goodbye."""

    def close(self) -> None:
        if self.connection is not None:
            with suppress(OSError):
                self.timeout *= 8
                self.read(self.channel("in:0"))
        super().close()


class ReadsItsOwnCopyOfOutputs(Careful):
    """What was written last is read, in place of the device's own level."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.copy: dict[Place, int] = {}

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        for channel in channels:
            self.copy.pop(channel, None)
        super().write_raws(channels, raws)
        self.copy |= dict(zip(channels, raws, strict=True))

    def read_many(self, channels: Sequence[Place], out: IntArray) -> None:
        super().read_many(channels, out)
        for i, channel in enumerate(channels):
            out[i] = self.copy.get(channel, out[i])


class PrintsItsFailures(Careful):
    """A call that fails prints why."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        try:
            return super().exchange(function, channels, raws)
        except OSError as error:
            print("failed:", error, file=sys.stderr)
            raise


class PulsesWhenItIsReset(Careful):
    """Reset writes the highest level first."""

    def reset(self, channel: Place, default: int | None) -> None:
        if default is not None:
            self.write(channel, channel.highest)
        super().reset(channel, default)


class TimesOutAsWhenItWasOpened(Careful):
    """`timeout` stays the one that it had when it was opened, and says so."""

    seconds, set = 1.0, 1.0

    @property  # type: ignore[override]
    def timeout(self) -> float:
        return self.seconds

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self.set = seconds

    def open(self) -> None:
        self.seconds = self.set
        super().open()


BREAKS: dict[type[Careful], str] = {
    KeyErrorForAnUnknownChannel: "channels",
    ConnectsWhenMade: "before open",
    ComesUpViaZero: "glitch",
    ResetsToZero: "reset",
    DoesNotResetAfterAFailure: "reset after failure",
    FinalisesAllChannels: "finalise",
    ReopensADeadSocket: "reopen",
    OffByOne: "range",
    Clamps: "one beyond",
    Wraps: "one beyond",
    TakesWritesToInputs: "directions",
    ReadsAFloat: "readings",
    SwapsTheOrder: "block write",
    ReadsInItsOwnOrder: "block read",
    StopsAtTheFirstFailure: "block failures",
    NamesAnotherChannel: "block failures",
    KeepsTheBuffer: "block buffers",
    WaitsForEver: "timeout",
    TimesOutPerByte: "timeout",
    Retries: "timeout",
    HasATimeoutOfItsOwn: "patience",
    TakesLateAnswers: "late answer",
    TakesOldAnswers: "old answer",
    FillsUpShortAnswers: "short answer",
    IgnoresTheChecksum: "garbled answer",
    IgnoresErrorAnswers: "error answer",
    GivesUp: "vanish",
    SharesItsConnection: "two clients",
    LeaksSockets: "descriptors",
    LeaksThreads: "descriptors",
    Grows: "memory",
    RaisesKeyErrors: "kind of errors",
    TakesAPartForTheWhole: "answer in pieces",
    ConnectsWithoutATimeout: "timeout",
    WaitsForGoodbye: "timeout",
    WritesTheWholePort: "two clients",
    SkipsWhatItFailedToWrite: "vanish",
    RemembersLevelsWhenReopened: "reopen",
    ResetsAllOutputs: "reset",
    SwitchesOffWhenFinalised: "finalise",
    TakesBlocksToInputs: "directions",
    LeaksWhenItCannotConnect: "descriptors",
    ReadsItsOwnCopyOfOutputs: "two clients",
    PrintsItsFailures: "process",
    PulsesWhenItIsReset: "glitch",
    TimesOutAsWhenItWasOpened: "timeout",
}

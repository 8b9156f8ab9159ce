"""Devices with odd protocols, and correct drivers of them: bytes without a frame, silence for what is unknown."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic

from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import ChannelError, DeviceTimeout, DriverError


@contextmanager
def serving(answer: Callable[[bytes], bytes]) -> Iterator[int]:
    """A device on loopback TCP: what it answers to what came in at once; nothing: silence. Its port."""
    clients: list[socket.socket] = []

    def serve(client: socket.socket) -> None:
        with client, suppress(OSError):
            while request := client.recv(4096):
                if reply := answer(request):
                    client.sendall(reply)

    def accept() -> None:
        with suppress(OSError):
            while True:
                client, _ = listener.accept()
                clients[:] = [each for each in clients if each.fileno() >= 0] + [client]
                threading.Thread(target=serve, args=(client,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        yield listener.getsockname()[1]
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()
        for client in clients:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)


class Plain(Driver):
    """An output and an input that reads it; whatever goes wrong drops the connection."""

    bits = 8
    others: tuple[str, ...] = ()
    """More inputs."""

    def __init__(self, *, port: int) -> None:
        self.port = port
        self.is_open = False
        self.connection: socket.socket | None = None

    def channel(self, text: str) -> Channel:
        if text not in ("out", "in", *self.others):
            raise ChannelError(text, ["out", "in"])
        return Channel(text, Direction.OUTPUT if text == "out" else Direction.INPUT, self.bits)

    def open(self) -> None:
        self.is_open = True
        self.connected(monotonic() + self.timeout)

    def close(self) -> None:
        self.is_open = False
        self.drop()

    def connected(self, deadline: float) -> socket.socket:
        if not self.is_open:
            raise DriverError("it is not open")
        if self.connection is None:
            self.connection = socket.create_connection(("127.0.0.1", self.port), max(1e-3, deadline - monotonic()))
            self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, True)
        return self.connection

    def drop(self) -> None:
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    def ask(self, request: bytes, whole: Callable[[bytes], bool] | None) -> bytes:
        """The answer once it is whole; without `whole` none is waited for."""
        deadline, answer = monotonic() + self.timeout, b""
        try:
            connection = self.connected(deadline)
            connection.sendall(request)
            while whole is not None and not whole(answer):
                connection.settimeout(max(1e-3, deadline - monotonic()))
                if monotonic() > deadline or len(answer) > 1000:
                    raise DeviceTimeout("timed out")
                part = connection.recv(64)
                if not part:
                    raise DriverError("the connection is closed")
                answer += part
        except TimeoutError:
            self.drop()
            raise DeviceTimeout("timed out") from None
        except OSError:
            self.drop()
            raise
        return answer

    def check(self, channel: Channel, raw: int) -> None:
        if channel.direction is Direction.INPUT or not channel.lowest <= raw <= channel.highest:
            raise DriverError(f"{channel.text} does not take {raw}")


class Bytes(Plain):
    """`r` is answered with `size` bytes, the value and nothing else; `w` and the value with one."""

    size = 1

    def read(self, channel: Channel) -> int:
        answer = self.ask(b"r", lambda data: len(data) >= self.size)
        if len(answer) != self.size:
            self.drop()
            raise DriverError("too many bytes")
        return int.from_bytes(answer, "big")

    def write(self, channel: Channel, raw: int) -> None:
        self.check(channel, raw)
        self.ask(b"w" + raw.to_bytes(self.size, "big"), lambda data: len(data) >= 1)


class TwoBytes(Bytes):
    bits, size = 16, 2


class Scpi(Plain):
    """Lines of text; what the device does not know it passes over in silence, and settings are not answered."""

    bits = 16
    others = ("unknown",)

    def read(self, channel: Channel) -> int:
        answer = self.ask(channel.text.encode() + b"?\n", lambda data: data.endswith(b"\n"))
        try:
            if not answer[:-1].isascii() or not answer[:-1].isdigit():
                raise ValueError
            value = int(answer)
        except ValueError:
            self.drop()
            raise DriverError(f"not a number: {answer!r}") from None
        if value > channel.highest:
            raise DriverError(f"{value} does not fit")
        return value

    def write(self, channel: Channel, raw: int) -> None:
        self.check(channel, raw)
        self.ask(f"out {raw}\n".encode(), None)


def of_bytes(size: int) -> Callable[[bytes], bytes]:
    """The device of Bytes."""
    kept = {"out": 0}

    def answer(request: bytes) -> bytes:
        if request[:1] == b"w":
            kept["out"] = int.from_bytes(request[1 : 1 + size], "big")
            return b"k"
        return kept["out"].to_bytes(size, "big")

    return answer


def scpi() -> Callable[[bytes], bytes]:
    """The device of Scpi."""
    kept = {"out": 0}

    def answer(request: bytes) -> bytes:
        found = b""
        for line in request.decode("ascii", "replace").splitlines():
            if line.startswith("out "):
                kept["out"] = int(line[4:])
            elif line == "in?":
                found += f"{kept['out']}\n".encode()
        return found

    return answer

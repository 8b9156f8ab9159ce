"""A SCPI supply behind socat; by hand: a socket, one request and one answer after the other, as a person would write it.
Joined: all queries in one line, by hand too."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import IO, Any

from tests.peers.text_devices import CannotRun, Supply, supply

from bench.drivers.case import Case, NotHere, cycle, split
from umo.drivers.text import Text

CHANNELS: dict[str, Any] = {"volt{n}": {"ask": ":CH{n}:VOLT?", "set": ":CH{n}:VOLT {:.3f}", "scale": 0.001}}


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    try:
        counted, other = stack.enter_context(supply()), stack.enter_context(supply())
    except CannotRun as error:
        raise NotHere(str(error)) from None
    for name, by in (("text, TCP", None), ("text, TCP, joined", ";")):
        run = _umo(counted, channels, by, stack)
        before = len(counted.lines())
        run()
        transfers = len(counted.lines()) - before
        stream = _connected(other, stack)
        yield Case(name, "socket", channels, run, _hand(stream, channels, by), transfers)


def _umo(device: Supply, channels: int, by: str | None, stack: ExitStack) -> Callable[[], None]:
    driver = Text(host="127.0.0.1", port=device.port, channels=CHANNELS, together=by, longest_request=4096)
    driver.timeout = 10.0
    stack.callback(driver.close)
    driver.open()
    inputs, outputs = split(channels)
    read = [driver.channel(f"volt{i}") for i in range(inputs)]
    written = [driver.channel(f"volt{i}") for i in range(inputs, channels)]
    return cycle(driver, read, written)


def _connected(device: Supply, stack: ExitStack) -> IO[bytes]:
    connection = stack.enter_context(socket.create_connection(("127.0.0.1", device.port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return stack.enter_context(connection.makefile("rwb", buffering=0))


def _hand(stream: IO[bytes], channels: int, by: str | None) -> Callable[[], None]:
    inputs, outputs = split(channels)

    def ask(request: str, answers: int) -> list[float]:
        stream.write(f"{request}\n".encode())
        values = [float(text) for text in _line(stream).split(";")]
        if len(values) != answers:
            raise RuntimeError(f"{answers} queries, {len(values)} answers")
        return values

    def run() -> None:
        queries = [f":CH{i}:VOLT?" for i in range(inputs)]
        settings = [f":CH{i}:VOLT {0.001:.3f}" for i in range(inputs, channels)]
        if by is None:
            for query in queries:
                ask(query, 1)
            for setting in settings:
                stream.write(f"{setting}\n".encode())
        else:
            ask(by.join(queries), inputs)
            stream.write(f"{by.join(settings)}\n".encode())

    return run


def _line(stream: IO[bytes]) -> str:
    data = b""
    while not data.endswith(b"\n"):
        data += stream.read(4096)
    return data.decode()

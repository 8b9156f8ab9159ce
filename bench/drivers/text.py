"""A line protocol over TCP, against a device in C; by hand: a socket, one request and one answer after the other, or
all queries of a cycle in one line."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

from bench.drivers.case import Case, NotHere, cycle, split
from tests.helpers.peers.text_devices import CannotRun, quick
from umo.drivers.text import Text

CHANNELS: dict[str, Any] = {
    "volt{n}": {"ask": ":CH{n}:VOLT?", "set": ":CH{n}:VOLT {:.3f}", "scale": 0.001},
    "count": {"ask": "COUNT?"},
}


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    try:
        ports = [stack.enter_context(quick()) for _ in range(4)]  # each serves one client at a time
    except CannotRun as error:
        raise NotHere(str(error)) from None
    for name, by, port, other in (("text, TCP", None, *ports[:2]), ("text, TCP, joined", ";", *ports[2:])):
        driver = Text(
            host="127.0.0.1", port=port, channels=CHANNELS, acknowledge="OK", together=by, longest_request=4096
        )
        driver.timeout = 10.0
        stack.callback(driver.close)
        driver.open()
        run, before = _umo(driver, channels), driver.read(driver.channel("count"))
        run()
        transfers = driver.read(driver.channel("count")) - before
        connection = stack.enter_context(socket.create_connection(("127.0.0.1", other), 10.0))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield Case(name, "socket", channels, run, _hand(connection, channels, by), transfers)


def _umo(driver: Text, channels: int) -> Callable[[], None]:
    inputs, _ = split(channels)
    numbered = [driver.channel(f"volt{i}") for i in range(channels)]
    return cycle(driver, numbered[:inputs], numbered[inputs:])


def _hand(connection: socket.socket, channels: int, by: str | None) -> Callable[[], None]:
    inputs, _ = split(channels)
    queries = [f":CH{i}:VOLT?" for i in range(inputs)]
    lines = queries if by is None else [by.join(queries)]

    def run() -> None:
        values: list[float] = []
        for line in lines:
            values += [float(text) for text in _asked(connection, line).split(";")]
        if len(values) != inputs:
            raise RuntimeError(f"{inputs} queries, {len(values)} answers")
        for i in range(inputs, channels):
            if (answer := _asked(connection, f":CH{i}:VOLT {0.001:.3f}")) != "OK":
                raise RuntimeError(answer)

    return run


def _asked(connection: socket.socket, line: str) -> str:
    connection.sendall(f"{line}\n".encode())
    data = connection.recv(4096)
    while not data.endswith(b"\n"):
        data += connection.recv(4096)
    return data.decode().rstrip("\n")

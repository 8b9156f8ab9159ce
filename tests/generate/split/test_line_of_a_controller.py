"""Who is the host of a controller's program: the first that comes keeps the line, and others are told why not."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic

import pytest

from helpers.generating import needs_a_compiler
from helpers.split_parts import RunningController, controller_of
from umo.drivers.streams import Host
from umo.errors import DriverError
from umo.generate.split.link_bodies import FrameKind, hello, request, welcome_of
from umo.generate.split.link_frames import FrameReader, framed
from umo.generate.split.link_stop import stop_controller

pytestmark = [
    needs_a_compiler,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the kernel tells the user on Linux only"),
]
LIMIT = 20.0
"""s"""
REFUSED = bytes([FrameKind.REFUSED])


class Greeter:
    """A host that says one thing and takes the answers."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), LIMIT)
        self._reader = FrameReader(1 << 16)

    def said(self, body: bytes) -> bytes:
        """The answer; empty: the controller has closed the line."""
        self.socket.sendall(framed(body))
        while data := self.socket.recv(4096):
            for answer in self._reader.take(data):
                return answer
        return b""


@contextmanager
def greeter(controller: RunningController) -> Iterator[Greeter]:
    found = Greeter(controller.port)
    try:
        yield found
    finally:
        found.socket.close()


def stopped(controller: RunningController, retry: float) -> None:
    stop_controller(Host("127.0.0.1", controller.port).dial(), "drive", monotonic() + LIMIT, retry)


@pytest.mark.full
def test_the_first_host_keeps_the_line_as_long_as_it_talks_and_the_second_is_told(
    controller: RunningController,
) -> None:
    with greeter(controller) as first:
        assert welcome_of(first.said(hello(1))) is not None
        for number in range(2, 8):
            with greeter(controller) as second:
                assert second.said(hello(100 + number)) == REFUSED + b"\x01"
                assert second.socket.recv(1) == b""
            assert welcome_of(first.said(hello(number))) is not None


def test_when_the_first_has_gone_the_next_has_the_line_at_once(controller: RunningController) -> None:
    for number in range(1, 5):
        with greeter(controller) as each:
            assert welcome_of(each.said(hello(number))) is not None


def test_a_host_that_is_silent_loses_the_line_to_one_that_asks_again(controller: RunningController) -> None:
    with greeter(controller) as first:
        assert welcome_of(first.said(hello(1))) is not None
        stopped(controller, 0.05)  # refused at first
        with greeter(controller) as third:
            assert welcome_of(third.said(hello(3))) is not None
        assert first.socket.recv(1) == b""


def test_a_host_that_talks_cannot_be_stopped_by_another(controller: RunningController) -> None:
    with greeter(controller) as first:
        session = welcome_of(first.said(hello(1)))
        assert session is not None
        with greeter(controller) as second:
            assert second.said(request(FrameKind.STOP, session.session, 1, ())) == REFUSED + b"\x01"


def test_a_process_of_another_user_is_refused(controller: RunningController) -> None:
    if os.getuid() != 0:
        pytest.skip("only root can be another user")
    code = f"""
import encodings.idna, os, socket, sys
os.setuid(65534)
s = socket.create_connection(("127.0.0.1", {controller.port}), {LIMIT})
s.sendall(bytes.fromhex({framed(hello(1)).hex()!r}))
data = b""
while more := s.recv(4096):
    data += more
sys.stdout.write(data.hex())
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT, check=True)
    assert [*FrameReader(100).take(bytes.fromhex(told.stdout))] == [REFUSED + b"\x02"]
    with greeter(controller) as own:
        assert welcome_of(own.said(hello(2))) is not None


@contextmanager
def full_pipe() -> Iterator[int]:
    """The end for writing of a pipe that nobody reads, and that has no room."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        with suppress(BlockingIOError):
            while True:
                os.write(writing, b"x" * 4096)
        os.set_blocking(writing, True)
        yield writing
    finally:
        os.close(reading)
        os.close(writing)


def test_refusals_hold_nothing_up_where_nobody_reads_standard_error(program: Path) -> None:
    with full_pipe() as errors, controller_of(program, stderr=errors) as controller, greeter(controller) as first:
        assert welcome_of(first.said(hello(1))) is not None
        for number in range(2, 6):
            with greeter(controller) as second:
                assert second.said(hello(100 + number)) == REFUSED + b"\x01"
            assert welcome_of(first.said(hello(number))) is not None


def test_a_standard_error_that_is_closed_ends_nothing(program: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with controller_of(program, stderr=writing) as controller, greeter(controller) as first:
        os.close(writing)
        for number in range(1, 4):
            assert welcome_of(first.said(hello(number))) is not None
            with greeter(controller) as second:
                assert second.said(hello(100 + number)) == REFUSED + b"\x01"


def test_refusals_are_counted_in_lines(program: Path) -> None:
    reading, writing = os.pipe()
    with open(reading) as told, controller_of(program, stderr=writing) as controller, greeter(controller) as first:
        os.close(writing)
        assert welcome_of(first.said(hello(1))) is not None
        for number in range(2, 7):
            with greeter(controller) as second:
                assert second.said(hello(number)) == REFUSED + b"\x01"
        counted = 0
        while counted < 5:  # a line in a second
            line = re.fullmatch(r"connections refused: (\d+), the last: there is a host\n", told.readline())
            assert line is not None
            counted += int(line[1])
        assert counted == 5


def test_a_connection_that_sends_without_end_is_closed_after_one_read(controller: RunningController) -> None:
    with greeter(controller) as first:
        assert welcome_of(first.said(hello(1))) is not None
        os.kill(controller.pid, signal.SIGSTOP)
        first.socket.sendall(framed(hello(2)))  # it is not silent, however long the controller stands
        with greeter(controller) as flood:
            flood.socket.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    flood.socket.send(b"x" * (1 << 16))
            os.kill(controller.pid, signal.SIGCONT)
            flood.socket.settimeout(LIMIT)
            more = 0
            with suppress(ConnectionError):
                while more < 1 << 26:
                    more += flood.socket.send(b"x" * (1 << 16))
        assert more < 1 << 18
        assert welcome_of(first.said(hello(3))) is not None


def test_the_driver_says_who_has_the_controller(controller: RunningController) -> None:
    with greeter(controller) as first:
        assert welcome_of(first.said(hello(1))) is not None
        with pytest.raises(DriverError, match="the controller drive refuses: the controller has another host"):
            stopped(controller, 2 * LIMIT)

"""The taps: what the driver gets of what the device answered, over TCP and over a serial line."""

from __future__ import annotations

import errno
import os
import select
import socket
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from conformance.device import READ, Device, frame
from helpers.waiting import until
from umo.drivers.streams import Serial
from umo.testing.conformance import PtyTap, Tap, TcpTap

PATIENT, HASTY = 5.0, 0.05
Ask = Callable[[bytes], bytes]


class Line:
    """A driver's end of a line, and what a plain client does with it."""

    def __init__(self, dial: Callable[[], int]) -> None:
        self.dial = dial
        self.descriptor = dial()

    def ask(self, request: bytes, timeout: float = PATIENT) -> bytes:
        """The answer; nothing after the timeout or at the end of the connection."""
        os.write(self.descriptor, request)
        return self.take(timeout)

    def take(self, timeout: float = PATIENT) -> bytes:
        return os.read(self.descriptor, 100) if select.select([self.descriptor], [], [], timeout)[0] else b""

    def again(self) -> None:
        os.close(self.descriptor)
        self.descriptor = self.dial()


def echo(descriptor: int) -> None:
    """A device that answers each request with the request in capitals."""
    try:
        while data := os.read(descriptor, 100):
            os.write(descriptor, data.upper())
    except OSError:
        pass


def serve(listener: socket.socket) -> None:
    while True:
        try:
            client, _ = listener.accept()
        except OSError:
            return
        threading.Thread(target=_echo_socket, args=(client,), daemon=True).start()


def _echo_socket(client: socket.socket) -> None:
    with client:
        echo(client.fileno())


@pytest.fixture(params=["tcp", "serial"])
def tapped(request: pytest.FixtureRequest) -> Iterator[tuple[Tap, Line]]:
    with ExitStack() as stack:
        if request.param == "tcp":
            listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            threading.Thread(target=serve, args=(listener,), daemon=True).start()
            tap: Tap = stack.enter_context(TcpTap(*listener.getsockname()))
            line = Line(lambda: socket.create_connection((tap.host, tap.port), PATIENT).detach())  # type: ignore[attr-defined]
        else:
            device, path = os.openpty()
            tty.setraw(path)
            echoing = threading.Thread(target=echo, args=(device,), daemon=True)
            echoing.start()
            stack.callback(os.close, device)  # last: its number may be used again, and the thread would echo there
            stack.callback(echoing.join)
            stack.callback(os.close, path)
            tap = stack.enter_context(PtyTap(os.ttyname(path)))
            line = Line(lambda: os.open(tap.serial, os.O_RDWR | os.O_NOCTTY))  # type: ignore[attr-defined]
        yield tap, line
        os.close(line.descriptor)


def test_everything_passes_a_tap_and_is_remembered(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    assert [line.ask(b"one"), line.ask(b"two"), line.ask(b"three")] == [b"ONE", b"TWO", b"THREE"]
    assert list(tap.exchanges) == [(b"one", b"ONE"), (b"two", b"TWO")]
    assert tap.spoiled == 0


def test_a_silent_device_answers_nothing_then_and_later(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.silent():
        assert line.ask(b"one", HASTY) == b""
        until(lambda: tap.spoiled == 1)  # a busy computer may be later
    assert line.ask(b"two") == b"TWO"


def test_an_answer_is_changed(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.spoiling(lambda answer: answer[:-1] + b"?"):
        assert line.ask(b"one") == b"ON?"
    assert line.ask(b"two") == b"TWO"


def test_a_late_answer_comes_after_the_block(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.late():
        assert line.ask(b"one", HASTY) == b""
    assert line.take() == b"ONE"


def test_a_late_answer_comes_with_the_next_one(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.late(behind=True):
        assert line.ask(b"one", HASTY) == b""
    assert line.take(HASTY) == b""
    assert line.ask(b"two") == b"ONETWO"


def test_endless_bytes_come_in_place_of_an_answer(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.endless():
        found = line.ask(b"one")
        while len(found) < 5:
            found += line.take()
    assert found == b"\xff" * len(found)


def test_a_device_that_is_gone_takes_no_connection_until_it_is_back(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    assert line.ask(b"one") == b"ONE"
    with tap.gone():
        with pytest.raises(OSError) as caught:
            line.dial()
        assert caught.value.errno in (errno.ECONNREFUSED, errno.ENOENT)
        with pytest.raises(OSError) as caught:  # the end of the connection
            while line.take():
                pass
            raise OSError(errno.EIO, "the end")
        assert caught.value.errno == errno.EIO
    line.again()
    assert line.ask(b"two") == b"TWO"


def test_a_connection_is_dropped_and_can_be_made_again(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    assert line.ask(b"one") == b"ONE"
    tap.drop()
    line.again()
    assert line.ask(b"two") == b"TWO"


def test_the_connection_ends_after_a_changed_answer(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.spoiling(lambda answer: answer[:1], hangup=True):
        try:
            found = line.ask(b"one")
        except OSError:
            found = b""
    assert found == b"O" or (found == b"" and not tap.ordered)  # a terminal that is hung up drops what it holds
    line.again()
    assert line.ask(b"two") == b"TWO"


def test_a_connection_may_be_reset_in_place_of_an_answer() -> None:
    with Device() as device, TcpTap(device.host, device.port) as tap:
        line = socket.create_connection((tap.host, tap.port), PATIENT)
        with line, tap.spoiling(lambda answer: b"", reset=True):
            line.sendall(frame(1, READ, [(40, 0)]))
            with pytest.raises(ConnectionResetError):
                line.recv(100)


def test_healing_ends_whatever_is_spoiled(tapped: tuple[Tap, Line]) -> None:
    tap, line = tapped
    with tap.silent():
        tap.heal()
        line.again()
        assert line.ask(b"one") == b"ONE"


def test_a_tap_whose_device_is_not_there_ends_the_connection() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = listener.getsockname()
    with TcpTap(*address) as tap, socket.create_connection((tap.host, tap.port), PATIENT) as client:
        assert client.recv(1) == b""


def test_the_settings_of_a_serial_line_are_passed_on_each_time_it_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    device, path = os.openpty()
    seen: list[list[int]] = []
    set_modes = termios.tcsetattr

    def spied(descriptor: int, when: int, modes: Any) -> None:
        if os.ttyname(descriptor) == os.ttyname(path):  # a pseudo terminal does not keep what a device would
            seen.append(modes)
        set_modes(descriptor, when, modes)

    try:
        with PtyTap(os.ttyname(path), parity="even", data_bits=7) as tap:
            monkeypatch.setattr(termios, "tcsetattr", spied)
            for baudrate in (9600, 19200):
                line = Serial(tap.serial, baudrate, "even", data_bits=7, stop_bits=2).dial()(time.monotonic() + PATIENT)
                line.send(b"one", time.monotonic() + PATIENT)
                assert select.select([device], [], [], PATIENT)[0] and os.read(device, 100)
                line.close()
    finally:
        os.close(device)
        os.close(path)
    assert [modes[4] for modes in seen] == [termios.B9600, termios.B19200]
    shape = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB
    assert [modes[2] & shape for modes in seen] == [termios.CS7 | termios.PARENB | termios.CSTOPB] * 2


def test_of_a_device_that_never_pauses_an_answer_ends_all_the_same() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        end = threading.Event()

        def tell() -> None:
            client, _ = listener.accept()
            with client:
                while not end.wait(0.0002):
                    client.sendall(b".")

        teller = threading.Thread(target=tell)
        teller.start()
        with TcpTap(*listener.getsockname()) as tap:
            line = Line(lambda: socket.create_connection((tap.host, tap.port)).detach())
            try:
                assert line.take().startswith(b".")  # nobody has asked
                with tap.spoiling(lambda answer: b"changed"):
                    until(lambda: b"changed" in line.take())
            finally:
                end.set()
                teller.join()
                os.close(line.descriptor)


def test_what_has_passed_is_not_delivered_once_more_with_a_late_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener, TcpTap(*listener.getsockname()) as tap:
        line = Line(lambda: socket.create_connection((tap.host, tap.port)).detach())
        client, _ = listener.accept()
        with client:
            client.sendall(b"passed")
            assert line.take() == b"passed"
            with tap.late():
                client.sendall(b"late")
                until(lambda: any(each.answer or each.held for each in tap._open))
            assert line.take() == b"late"
        os.close(line.descriptor)

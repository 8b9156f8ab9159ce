"""The two ways to a device that speaks in lines: a TCP connection, and a serial line through pyserial."""

from __future__ import annotations

import os
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from time import monotonic, sleep
from typing import Any

from umo.drivers._device_file import opening
from umo.errors import DeviceTimeout, DriverError

_BUSY = 0.02
"""s between two attempts to open a serial line that another process still holds."""
_PARITY = {"none": "N", "even": "E", "odd": "O", "mark": "M", "space": "S"}


class Hangup(DriverError):
    """The device has closed the connection, or the serial line is gone."""


class Port:
    """An open file of bytes, not blocking. `owner` closes it."""

    def __init__(self, owner: Any) -> None:
        self._owner = owner
        self._fd: int = owner.fileno()
        self._in, self._out = select.poll(), select.poll()
        self._in.register(self._fd, select.POLLIN)
        self._out.register(self._fd, select.POLLOUT)

    def close(self) -> None:
        with suppress(Exception):  # an unplugged line: termios.error
            self._owner.close()

    def receive(self, seconds: float) -> bytes:
        """What has come in, at most 4096 bytes; waits for the first byte. b"" if the time is over."""
        if not self._in.poll(max(seconds, 0.0) * 1000):
            return b""
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise Hangup(plain(error)) from None
        if not data:
            raise Hangup("the device closed the connection")
        return data

    def send(self, data: bytes, seconds: float) -> bool:
        """False if the device did not take all of it in the time."""
        deadline = 0.0
        while True:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                pass
            except OSError as error:
                raise Hangup(plain(error)) from None
            if not data:
                return True
            deadline = deadline or monotonic() + seconds
            if not self._out.poll(max(deadline - monotonic(), 0.0) * 1000):
                return False


Dial = Callable[[float], Port]
"""Opens a port by a deadline, in s of `monotonic`: DeviceTimeout or DriverError."""


class TcpDial:
    """A TCP connection. A host name is resolved here, so make this in `open`."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except OSError as error:
            raise DriverError(f"{host}:{port}: {plain(error)}") from None
        except UnicodeError:
            raise DriverError(f"{host!r} is not the name of a host") from None

    def __call__(self, deadline: float) -> Port:
        failed = OSError("no address")
        for family, kind, protocol, _, address in self._addresses:
            connection = socket.socket(family, kind, protocol)
            try:
                connection.settimeout(max(deadline - monotonic(), 1e-3))
                connection.connect(address)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connection.setblocking(False)
                return Port(connection)
            except TimeoutError:
                connection.close()
                raise DeviceTimeout("connecting: timed out") from None
            except OSError as error:
                connection.close()
                failed = error
        raise DriverError(f"connecting: {plain(failed)}")


@dataclass(frozen=True)
class SerialDial:
    """A serial line, locked for this process (flock). DTR stays as it is when the line is closed, so an Arduino is not
    reset by every reconnection."""

    path: str
    baudrate: int
    data_bits: int
    parity: str
    stop_bits: float
    flow: str
    dtr: bool

    def __call__(self, deadline: float) -> Port:
        with opening(self.path):
            while True:
                try:
                    return Port(self._open())
                except BlockingIOError:  # perhaps by a process of umo that is being ended
                    if monotonic() + _BUSY >= deadline:
                        raise
                    sleep(_BUSY)

    def _open(self) -> Any:
        serial: Any = import_module("serial")  # it has no types
        line = serial.Serial(
            baudrate=self.baudrate,
            bytesize=self.data_bits,
            parity=_PARITY[self.parity],
            stopbits=self.stop_bits,
            rtscts=self.flow == "rtscts",
            xonxoff=self.flow == "xonxoff",
            timeout=0,
            exclusive=True,
        )
        line.port, line.dtr = self.path, self.dtr
        try:
            line.open()
        except (serial.SerialException, ValueError) as error:
            raise _reason(self.path, error) from None
        _keep_dtr(line.fileno())
        return _SerialLine(line)


class _SerialLine:
    """pyserial's line; closing it does not wait until what is unsent has gone out, which may take 30 s."""

    def __init__(self, line: Any) -> None:
        self._line = line
        self.fileno = line.fileno

    def close(self) -> None:
        try:
            self._line.reset_output_buffer()
        finally:
            self._line.close()


def _reason(path: str, error: Exception) -> OSError:
    """pyserial's exception as the operating system's."""
    number = getattr(error, "errno", None)
    if number is not None:
        return OSError(number, os.strerror(number))
    return DriverError(f"{path} cannot be used as a serial line: {error}")


def _keep_dtr(fd: int) -> None:
    import termios

    attributes = termios.tcgetattr(fd)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def plain(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]

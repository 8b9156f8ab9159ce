"""A serial line's device file through pyserial, without waiting beyond a deadline."""

from __future__ import annotations

import errno
import os
import select
from time import monotonic, sleep
from typing import Any

import serial
from serial.rs485 import RS485Settings

from umo.drivers._device_file import opening
from umo.drivers.modbus.answer import Lost, TimedOut
from umo.drivers.modbus.place import PARITIES, Serial
from umo.errors import DriverError

_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL
_BUSY = 0.02
"""s between two attempts to open a line that another process, perhaps one of umo that is being ended, still holds."""


class Gone(Lost):
    """The line itself has failed: it was unplugged, or the other end of a pseudo-terminal is closed."""


class SerialPort:
    """An open line, locked for this process (flock)."""

    def __init__(self, place: Serial, deadline: float) -> None:
        """Open it. DriverError in one line, as `opening` words it."""
        self._port = _opened(place, deadline)
        self._file: int = self._port.fileno()
        self._input, self._output = select.poll(), select.poll()
        self._input.register(self._file, select.POLLIN)
        self._output.register(self._file, select.POLLOUT)

    def close(self) -> None:
        try:
            self._port.close()
        except OSError:  # it was unplugged
            self._port.fd = None

    def receive(self, deadline: float) -> bytes:
        """What has come in, after waiting for the first byte; TimedOut at the deadline."""
        while not self._input.poll(_milliseconds(deadline)):
            if monotonic() >= deadline:
                raise TimedOut
        return self.waiting()

    def waiting(self) -> bytes:
        """What has come in so far."""
        try:
            data = os.read(self._file, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise Gone(error.strerror or str(error)) from None
        if not data and any(flags & _GONE for _, flags in self._input.poll(0)):
            raise Gone("the serial line is gone")
        return data

    def send(self, data: bytes, deadline: float) -> None:
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:
                if not self._output.poll(_milliseconds(deadline)) and monotonic() >= deadline:
                    raise TimedOut from None
            except OSError as error:
                raise Gone(error.strerror or str(error)) from None


def _milliseconds(deadline: float) -> float:
    return max(deadline - monotonic(), 0.0) * 1000 + 0.5  # poll() cuts fractions off


def _opened(place: Serial, deadline: float) -> Any:
    with opening(place.path):
        while True:
            try:
                return _open(place)
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EBUSY) or monotonic() + _BUSY >= deadline:
                    raise
                sleep(_BUSY)


def _is_pseudo(path: str) -> bool:
    """A pseudo-terminal has no parity, and refuses it from the second time on."""
    return os.path.realpath(path).startswith("/dev/pts/")


def _open(place: Serial) -> Any:
    import termios

    try:
        port: Any = serial.Serial(  # type: ignore[attr-defined, no-untyped-call]
            place.path,
            place.baudrate,
            parity="N" if _is_pseudo(place.path) else PARITIES[place.parity],
            stopbits=place.stop_bits,
            timeout=0,
            exclusive=True,
        )
    except (serial.SerialException, termios.error, ValueError) as error:
        number = getattr(error, "errno", None)
        if number is not None:
            raise OSError(number, os.strerror(number)) from None
        raise DriverError(f"{place.path} cannot be used as a serial line at {place}: {error}") from None
    if place.rs485:
        try:
            port.rs485_mode = RS485Settings()  # type: ignore[no-untyped-call]
        except (OSError, ValueError, NotImplementedError, termios.error):
            port.close()
            text = "its kernel driver does not switch the direction of RS-485; leave out rs485 = true"
            raise DriverError(f"{place.path}: {text}, if the adapter switches it by itself") from None
    return port

"""The device file of a serial line, opened through pyserial, locked for this process (flock)."""

from __future__ import annotations

import errno
import io
import os
import termios
from contextlib import suppress
from importlib import import_module
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from umo.drivers._device_file import opening
from umo.drivers.streams.stream import Stream
from umo.errors import DriverError

if TYPE_CHECKING:
    from umo.drivers.streams.place import Serial

_BUSY = 0.02
"""s between two attempts to open a line that another process, perhaps one of umo that is ending, still holds."""


def opened(place: Serial, deadline: float) -> Stream:
    """The open line. DriverError in one line, as `opening` words it."""
    with opening(place.path):
        while True:
            try:
                return Stream(_open(place), "the serial line is gone")
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EBUSY) or monotonic() + _BUSY >= deadline:
                    raise
                sleep(_BUSY)


class _File(io.FileIO):
    def close(self) -> None:
        """Unsent bytes are dropped: the kernel would wait for them for up to 30 s."""
        with suppress(ValueError, termios.error):  # closed already; unplugged
            termios.tcflush(self.fileno(), termios.TCOFLUSH)
        super().close()


def _open(place: Serial) -> _File:
    serial: Any = import_module("serial")  # it has no types
    pseudo = _is_pseudo(place.path)
    line = serial.Serial(
        baudrate=place.baudrate,
        bytesize=8 if pseudo else place.data_bits,
        parity="N" if pseudo else place.parity[0].upper(),
        stopbits=place.stop_bits,
        rtscts=place.flow == "rtscts",
        xonxoff=place.flow == "xonxoff",
        timeout=0,
        exclusive=True,
    )
    line.port, line.dtr = place.path, place.dtr
    try:
        line.open()
        if place.rs485:
            _switch_rs485(line, place)
        _set_modes(line.fileno())
        return _File(os.dup(line.fileno()), "r+b")
    except (serial.SerialException, termios.error, ValueError) as error:
        number = getattr(error, "errno", None)
        if number is not None:
            raise OSError(number, os.strerror(number)) from None
        raise DriverError(f"{place.path} cannot be used as a serial line at {place}: {error}") from None
    finally:
        line.close()


def _is_pseudo(path: str) -> bool:
    """A pseudo-terminal has 8 bits and no parity, and refuses anything else from the second time on."""
    return os.path.realpath(path).startswith("/dev/pts/")


def _switch_rs485(line: Any, place: Serial) -> None:
    try:
        line.rs485_mode = import_module("serial.rs485").RS485Settings()
    except (OSError, ValueError, NotImplementedError, termios.error):
        text = "its kernel driver does not switch the direction of RS-485; leave out rs485 = true"
        raise DriverError(f"{place.path}: {text}, if the adapter switches it by itself") from None


def _set_modes(fd: int) -> None:
    """DTR stays as it is when the line is closed, so a reconnection does not reset an Arduino. With VMIN, reading no
    byte means that the line is gone, as on TCP."""
    modes = termios.tcgetattr(fd)
    modes[2] &= ~termios.HUPCL
    modes[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, modes)

"""A serial line and its settings. The device file is opened through pyserial and locked for this process (flock)."""

from __future__ import annotations

import errno
import io
import os
import termios
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from time import monotonic, sleep
from typing import Any, Literal, get_args

from umo.drivers._device_file import opening
from umo.drivers._library import library
from umo.drivers.option_checks import one_of, within
from umo.drivers.streams.stream import Dial, Stream
from umo.errors import DriverError

Parity = Literal["none", "even", "odd", "mark", "space"]
Flow = Literal["none", "rtscts", "xonxoff"]
_RETRY_INTERVAL = 0.02
"""Time in s after which umo tries again to open a line that another process still holds, such as a process of umo that
is ending."""


@dataclass(frozen=True)
class Serial:
    """A serial line."""

    path: str
    baudrate: int
    parity: Parity
    data_bits: int = 8
    stop_bits: int = 1
    flow: Flow = "none"
    dtr: bool = True
    rs485: bool = False
    echo: bool = False
    """True if the line repeats sent data, for example because an RS-485 adapter receives the data that it sends. The
    driver `modbus` uses this."""

    def __post_init__(self) -> None:
        within("baudrate", self.baudrate, 50, 4_000_000)
        one_of("data_bits", self.data_bits, (5, 6, 7, 8))
        one_of("parity", self.parity, get_args(Parity))
        one_of("stop_bits", self.stop_bits, (1, 2))
        one_of("flow", self.flow, get_args(Flow))

    def devices(self) -> Sequence[str]:
        """Return the device file itself, even if the option names a link to it."""
        return [f"serial {os.path.realpath(self.path)}"]

    def prepared(self) -> bool:
        """Import pyserial. Return False if it is missing."""
        return library("serial.rs485", "serial") is not None

    def dial(self) -> Dial:
        return SerialDial(self)

    @property
    def character(self) -> float:
        """Time in s that one character takes: start bit, data bits, parity and stop bits."""
        return (1 + self.data_bits + (self.parity != "none") + self.stop_bits) / self.baudrate

    def __str__(self) -> str:
        shape = f"{self.data_bits}{self.parity[0].upper()}{self.stop_bits}"
        return f"{self.baudrate} baud {shape}{', RS-485' * self.rs485}{', echo' * self.echo}"


class SerialDial:
    """An object that opens a serial line."""

    def __init__(self, place: Serial) -> None:
        self._place = place

    def __call__(self, deadline: float) -> Stream:
        return opened(self._place, deadline)

    def without_waiting(self, deadline: float) -> Iterator[Stream | None]:
        """Yield the open line; opening a line never waits."""
        yield opened(self._place, 0.0)


def opened(place: Serial, deadline: float) -> Stream:
    """Open the line. Raises DriverError with a text in one line."""
    with opening(place.path):
        while True:
            try:
                return Stream(_open(place), "the serial line is gone")
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EBUSY) or monotonic() + _RETRY_INTERVAL >= deadline:
                    raise
                sleep(_RETRY_INTERVAL)


class _File(io.FileIO):
    def close(self) -> None:
        """Close the line. Unsent bytes are dropped, because the kernel would wait for them for up to 30 s."""
        with suppress(ValueError, termios.error):  # closed already; unplugged
            termios.tcflush(self.fileno(), termios.TCOFLUSH)
        super().close()


def _open(place: Serial) -> _File:
    serial: Any = import_module("serial")  # it has no types
    # A pseudo-terminal has 8 bits and no parity, and refuses anything else from the second time on.
    pseudo = os.path.realpath(place.path).startswith("/dev/pts/")
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


def _switch_rs485(line: Any, place: Serial) -> None:
    try:
        line.rs485_mode = import_module("serial.rs485").RS485Settings()
    except (OSError, ValueError, NotImplementedError, termios.error):
        text = "its kernel driver does not switch the direction of RS-485; leave out rs485 = true"
        raise DriverError(f"{place.path}: {text}, if the adapter switches it by itself") from None


def _set_modes(fd: int) -> None:
    """Set the modes of the open line. DTR does not change when the line is closed, so a reconnection does not reset an
    Arduino. With VMIN, reading no byte means that the line is gone, as on TCP."""
    modes = termios.tcgetattr(fd)
    modes[2] &= ~termios.HUPCL
    modes[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, modes)

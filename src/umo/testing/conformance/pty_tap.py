"""A tap for devices on a serial line, on Linux and macOS."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from umo.drivers.streams.line import Parity
from umo.testing.conformance.closed_twice import out_of_the_way
from umo.testing.conformance.relay import Tapped
from umo.testing.conformance.taps import Tap

CMSPAR = 0o10_000_000_000
"""The flag for the parities "mark" and "space" on Linux. The module termios has no name for it."""


class PtyTap(Tap):
    """A pseudo terminal in front of a device file. `serial` is its path. The driver's settings of the line (baud rate,
    stop bits, flow control) are passed on. Parity and data bits are arguments of the tap, because a pseudo terminal
    does not keep them. When the line ends, as if an adapter were unplugged, a new pseudo terminal appears at the same
    path."""

    ordered = False

    def __init__(self, device: str, *, parity: Parity = "none", data_bits: int = 8) -> None:
        """Raises ValueError for a parity or a number of data bits that no line has."""
        super().__init__()
        self._path, self._shape = device, _shape(parity, data_bits)
        self._folder = tempfile.TemporaryDirectory(prefix="umo-tap-")
        self.serial = str(Path(self._folder.name) / "line")
        self._terminal = -1
        self._away = True
        self._settings: list[Any] = []

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        self._folder.cleanup()

    def _appear(self) -> None:
        import tty

        device = os.open(self._path, os.O_RDWR | os.O_NOCTTY)
        if os.isatty(device):
            tty.setraw(device)
        driver, terminal = os.openpty()
        self._terminal = out_of_the_way(terminal)  # kept open, so that the line does not end with each driver
        tty.setraw(self._terminal)
        os.symlink(os.ttyname(self._terminal), self.serial)
        self._away, self._settings = False, []
        self._add(driver, device)

    def _vanish(self) -> None:
        self._away = True
        with suppress(FileNotFoundError):
            os.unlink(self.serial)
        if self._terminal >= 0:
            os.close(self._terminal)
            self._terminal = -1

    def _close(self, tapped: Tapped) -> None:
        super()._close(tapped)
        if not self._away and not self._open:
            self._vanish()
            with suppress(OSError):  # the device is not there any more
                self._appear()

    def _mirror(self, tapped: Tapped) -> None:
        import termios

        settings = termios.tcgetattr(self._terminal)
        settings[2] = settings[2] & ~_shape("mark", 8) | self._shape  # these two have all the bits
        if settings != self._settings and os.isatty(tapped.device):
            with suppress(termios.error):
                termios.tcsetattr(tapped.device, termios.TCSANOW, settings)
            self._settings = settings


def _shape(parity: Parity, data_bits: int) -> int:
    """Return parity and data bits as control modes of a terminal."""
    import termios

    sizes = {5: termios.CS5, 6: termios.CS6, 7: termios.CS7, 8: termios.CS8}
    parities = {
        "none": 0,
        "even": termios.PARENB,
        "odd": termios.PARENB | termios.PARODD,
        "space": termios.PARENB | CMSPAR,
        "mark": termios.PARENB | termios.PARODD | CMSPAR,
    }
    if parity not in parities or data_bits not in sizes:
        raise ValueError(f"a line has no parity {parity!r} with {data_bits!r} data bits")
    return parities[parity] | sizes[data_bits]

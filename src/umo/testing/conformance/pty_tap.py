"""A tap for devices on a serial line, on Linux and macOS."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from umo.testing.conformance.taps import Tap
from umo.testing.conformance.traffic import Tapped


class PtyTap(Tap):
    """A pseudo terminal at `serial`, a path, in front of a device file. The driver's settings of the line (baud rate,
    parity) are passed on. When the line ends, as an adapter that is taken out, a new one appears at the same path."""

    ordered = False

    def __init__(self, device: str) -> None:
        super().__init__()
        self._path = device
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
        driver, self._terminal = os.openpty()  # kept open, so that the line does not end with each driver
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
        if settings != self._settings and os.isatty(tapped.device):
            with suppress(termios.error):
                termios.tcsetattr(tapped.device, termios.TCSANOW, settings)
            self._settings = settings

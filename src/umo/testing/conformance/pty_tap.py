"""A tap for devices on a serial line, on Linux and macOS."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from umo.testing.conformance.taps import Tap, Tapped


class PtyTap(Tap):
    """A pseudo terminal at `serial`, a path, in front of the device file. The driver's settings of the line (baud rate,
    parity) are passed on. The path stays the same when the device was gone and returns."""

    ordered = False

    def __init__(self, device: str) -> None:
        super().__init__()
        self._path = device
        self._folder = tempfile.TemporaryDirectory(prefix="umo-tap-")
        self.serial = str(Path(self._folder.name) / "line")
        self._driver_side = -1
        self._settings: list[Any] = []

    def _appear(self) -> None:
        """The terminal stays open here too, so that it does not end with each driver."""
        import tty

        self._end_terminal()
        master, self._driver_side = os.openpty()
        tty.setraw(self._driver_side)
        with suppress(FileNotFoundError):
            os.unlink(self.serial)
        os.symlink(os.ttyname(self._driver_side), self.serial)
        device = os.open(self._path, os.O_RDWR | os.O_NOCTTY)
        if os.isatty(device):
            tty.setraw(device)
        self._settings = []
        self._add(master, device)

    def _vanish(self) -> None:
        with suppress(FileNotFoundError):
            os.unlink(self.serial)
        self._end_terminal()

    def drop(self) -> None:
        """The adapter is taken out and put in again."""
        with self._lock:
            super().drop()
            if os.path.lexists(self.serial) and not self._end:
                self._appear()

    def _mirror(self, connection: Tapped) -> None:
        import termios

        settings = termios.tcgetattr(self._driver_side)
        if settings != self._settings and os.isatty(connection.device):
            with suppress(termios.error):
                termios.tcsetattr(connection.device, termios.TCSANOW, settings)
            self._settings = settings

    def _end_terminal(self) -> None:
        if self._driver_side >= 0:
            os.close(self._driver_side)
            self._driver_side = -1

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        self._folder.cleanup()

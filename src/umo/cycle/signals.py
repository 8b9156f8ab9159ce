"""SIGINT and SIGTERM set a flag that is read between periods; they never raise inside a driver call."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopFlag:
    """`requested` becomes true at the first signal; further ones change nothing, so resetting is not interrupted."""

    def __init__(self) -> None:
        self.requested = False
        self.signal: int | None = None
        self._before: dict[int, Any] = {}

    def install(self) -> None:
        """Python delivers signals to the main thread alone; elsewhere the flag is only set by `request`."""
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._caught) for number in SIGNALS}

    def restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def request(self) -> None:
        self.requested = True

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or number
        self.requested = True

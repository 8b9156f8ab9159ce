"""What a process of the bench has found, in a file that can be read while the process goes on, or after its death."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PAUSE = 1.0
"""Time in s from one report to the next."""


class ReportFile:
    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0.0
        self.ends = False
        """Whether SIGTERM has come."""
        signal.signal(signal.SIGTERM, self._end)

    def _end(self, *_: object) -> None:
        self.ends = True

    def write(self, found: Callable[[], Any], *, now: bool = False) -> None:
        """Write it if it is time to."""
        if now or time.monotonic() - self._at >= PAUSE:
            self._at = time.monotonic()
            beside = self._path.with_suffix(".new")
            beside.write_text(json.dumps(found()))
            os.replace(beside, self._path)


def read(path: Path) -> Any:
    """The last report; None: there is none yet."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        return None

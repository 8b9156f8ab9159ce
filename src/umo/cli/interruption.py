"""Signals after the end of a run: they may cut short what takes long, and change nothing else."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from umo.cycle.stopping import SIGNALS


class Interruptions:
    """Signals that would end this process are passed over in the block, but once in one of `allowed` they raise
    KeyboardInterrupt."""

    def __init__(self) -> None:
        self._open = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._interrupt) for number in SIGNALS}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self._open:
            self._open = False
            raise KeyboardInterrupt

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """A block that Ctrl-C ends."""
        self._open = True
        try:
            yield
        finally:
            self._open = False

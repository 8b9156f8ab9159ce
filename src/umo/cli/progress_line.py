"""The progress display of a run.

It is drawn from within the loop, as the loop's process holds no other thread, so it has to be
cheap: a line of plain text takes about 3 us, a picture of rich's live display 320 us and now and then 1.3 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console

from umo.cycle import Frame
from umo.text import printable

INTERVAL = 0.1
"""Seconds of wall-clock time between two pictures."""
BAR = 24


class Shown:
    """An observer that keeps one line up to date on a terminal; elsewhere it writes a line for every new text."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._file = console.file
        self._terminal = console.is_terminal
        self._clock = clock
        self._next = 0.0
        self._text = ""
        self._width = max(20, console.width - 1)

    def __enter__(self) -> Shown:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal:
            self._write("\r\x1b[2K")

    def __call__(self, frame: Frame) -> None:
        if self._terminal:
            if (now := self._clock()) >= self._next:
                self._next = now + INTERVAL
                self._write(f"\r\x1b[2K{self._line(frame)[: self._width]}")
        elif (text := frame.progress.text) and text != self._text:
            self._text = text
            self._write(f"{frame.time:8.3f} s  {printable(text)}\n")

    def _line(self, frame: Frame) -> str:
        progress = frame.progress
        text = printable(progress.text) or "running"
        if not progress.total:
            return f"{frame.time:8.1f} s  {text}"
        filled = int(BAR * progress.share)
        return f"{frame.time:8.1f} s  {'━' * filled}{'╌' * (BAR - filled)}  {text}"

    def _write(self, text: str) -> None:
        self._file.write(text)
        self._file.flush()

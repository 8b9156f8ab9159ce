"""The progress display of a run.

It is drawn from within the loop, because the loop's process has no other thread. So drawing must be quick: a line of
plain text takes about 3 us, but an update of rich's live display takes 320 us, and occasionally 1.3 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from rich.console import Console

from umo.cycle.frame import Frame
from umo.system.streams import CLEAR_LINE
from umo.text import printable, with_time

PICTURE_PAUSE = 0.1
"""Wall-clock time in s between two updates of the display."""
BAR_WIDTH = 24


class OneLine:
    """A line that is kept up to date on a terminal. If the output is not a terminal, a line is printed for every new
    text."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._file = console.file
        self._terminal = console.is_terminal
        self._clock = clock
        self._next = 0.0
        self._text = ""
        self._width = max(20, console.width - 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal:
            self._write(CLEAR_LINE)

    def show(self, seconds: float, text: str, share: float | None) -> None:
        """Show the time, a bar for the completed share, and a text."""
        if self._is_due(text):
            self._draw(seconds, text, share)

    def note(self, seconds: float, text: str) -> None:
        """Print a line that stays, with a time."""
        self._write(f"{CLEAR_LINE if self._terminal else ''}{with_time(seconds, printable(text))}\n")

    def _is_due(self, text: str) -> bool:
        return self._clock() >= self._next if self._terminal else bool(text) and text != self._text

    def _draw(self, seconds: float, text: str, share: float | None) -> None:
        if self._terminal:
            self._next = self._clock() + PICTURE_PAUSE
            self._write(f"{CLEAR_LINE}{self._line(seconds, printable(text) or 'running', share)[: self._width]}")
        else:
            self._text = text
            self.note(seconds, text)

    def _line(self, seconds: float, text: str, share: float | None) -> str:
        if share is None:
            return f"{seconds:8.1f} s  {text}"
        filled = int(BAR_WIDTH * share)
        return f"{seconds:8.1f} s  {'━' * filled}{'╌' * (BAR_WIDTH - filled)}  {text}"

    def _write(self, text: str) -> None:
        self._file.write(text)
        self._file.flush()


class RunProgressLine(OneLine):
    def __call__(self, frame: Frame) -> None:
        progress = frame.progress
        if self._is_due(progress.text):
            self._draw(frame.time, progress.text, progress.share if progress.total else None)

"""stdout and stderr that cannot end a run: if the reader ends, the disk is full or a stream is closed, text is dropped.

Python would raise BrokenPipeError or OSError from any print, also from one in control code. Here the text is dropped
without an exception.
"""

from __future__ import annotations

import io
import logging
import os
import sys
from contextlib import suppress
from typing import TextIO

CLEAR_LINE = "\r\x1b[2K"
"""Text that clears the line of a terminal: that of a run's progress may stand there."""


class _Descriptor(io.FileIO):
    """A descriptor that accepts all text and drops what it cannot write."""

    def write(self, data: object) -> int:
        size = memoryview(data).nbytes  # type: ignore[arg-type]
        try:
            written = super().write(data)  # type: ignore[arg-type]
        except OSError:
            return size
        return size if written is None else written  # None: it would block


def keep_open() -> None:
    """Make stdout and stderr of this process so. A descriptor from 0 to 2 that is closed leads to nowhere from now on:
    else the next file or connection opened would get its number, and what is printed."""
    with suppress(OSError):
        while (file := os.open(os.devnull, os.O_RDWR)) <= 2:
            os.set_inheritable(file, True)
        os.close(file)
    sys.stdout = _steady(1, sys.stdout)
    sys.stderr = _steady(2, sys.stderr)


def say_without_waiting(text: str) -> None:
    """A line on stderr if it is taken at once: nothing waits for a stopped terminal or a pipe that nobody reads."""
    with suppress(OSError):
        flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY
        file = os.open("/proc/self/fd/2", flags)  # opened again: O_NONBLOCK must not change the stream of others
        try:
            begin = "\n" if os.isatty(file) else ""  # the line of a run's progress, or a prompt, may stand there
            os.write(file, f"{begin}{text}\n".encode(errors="backslashreplace"))
        finally:
            os.close(file)


def log_on_lines() -> None:
    """Log messages that no handler takes begin on a line of their own: the line of a run's progress may stand there."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setLevel(logging.WARNING)
    handler.setFormatter(logging.Formatter(f"{CLEAR_LINE}%(message)s" if sys.stderr.isatty() else None))
    logging.lastResort = handler


def _steady(number: int, before: TextIO | None) -> TextIO:
    with suppress(OSError, ValueError, AttributeError):
        before.flush()  # type: ignore[union-attr]
    raw = _Descriptor(number, "w", closefd=False)
    encoding = "utf-8" if before is None else before.encoding
    lines = any(getattr(before, name, False) for name in ("line_buffering", "write_through"))
    # a name that is not UTF-8 is shown with its bytes, not refused
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=lines)

"""stdout and stderr that can neither end a run nor hold it up.

If the reader ends, the disk is full or a stream is closed, Python would raise BrokenPipeError or OSError from any
print, also from one in control code. Here the text is dropped without an exception. Where a loop keeps its periods in
real time, no write waits either: what a full pipe, a stopped terminal or a slow journal does not take is kept in
bounded memory, and dropped and counted beyond that.
"""

from __future__ import annotations

import io
import logging
import os
import select
import socket
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, TextIO

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


MAX_WAITING = 1 << 18
"""Number of bytes that wait for a slow reader at most."""
late: set[_Unwaiting] = set()
"""The streams of this process in which text waits."""
MAX_LINE = 3000
"""Number of bytes of a line of the log at most: a pipe that takes anything takes so much at once (PIPE_BUF is 4096)."""


class _Unwaiting(_Descriptor):
    """A descriptor that accepts all text and never waits. `lost` counts the lines that were dropped."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self.lost = 0
        self._waiting = bytearray()
        self._send, self._let_go = _sender(number)

    def write(self, data: object) -> int:
        text = bytes(memoryview(data))  # type: ignore[arg-type]
        self.send_waiting()
        if self.lost or len(self._waiting) + len(text) > MAX_WAITING:
            self.lost += text.count(b"\n") or 1
        else:
            self._waiting += text
            self.send_waiting()
        if self._waiting:
            late.add(self)
        return len(text)

    def close(self) -> None:
        if not self.closed:
            late.discard(self)
            self._let_go()
        super().close()

    def send_waiting(self) -> None:
        """Send what the reader takes now; then the number of the lines that were lost, if any were."""
        self._send_some()
        if self.lost and not self._waiting:
            self._waiting += f"\numo: {lost_lines(self.lost)}\n".encode()
            self.lost = 0
            self._send_some()
        if not self._waiting:
            late.discard(self)

    def _send_some(self) -> None:
        while self._waiting:
            try:
                taken = self._send(bytes(self._waiting[: select.PIPE_BUF]))
            except BlockingIOError:
                return
            except OSError:  # nobody reads it any more
                self._waiting.clear()
                return
            del self._waiting[:taken]


def lost_lines(count: int) -> str:
    """The sentence that so many lines were dropped."""
    return f"{count:,} line{'s were' if count != 1 else ' was'} lost: what reads them did not take them in time"


def _sender(number: int) -> tuple[Callable[[bytes], int], Callable[[], None]]:
    """A function that writes bytes to a descriptor and never waits, and one that gives up what that needs. The first
    raises BlockingIOError where it would have to wait. O_NONBLOCK must not change the stream of others, so a pipe or
    terminal is opened again."""
    with suppress(OSError):
        kind = os.fstat(number).st_mode
        if stat.S_ISSOCK(kind):
            there = socket.socket(fileno=os.dup(number))
            return lambda data: there.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL), there.close
        if not (stat.S_ISFIFO(kind) or os.isatty(number)):
            return partial(os.write, number), lambda: None
        flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
        file = os.open(f"/proc/self/fd/{number}", flags)
        return partial(os.write, file), partial(os.close, file)

    def write_if_ready(data: bytes) -> int:
        if not is_ready(number):
            raise BlockingIOError
        return os.write(number, data)

    return write_if_ready, lambda: None


def is_ready(number: int) -> bool:
    """Whether a descriptor takes some bytes at once."""
    poll = select.poll()
    poll.register(number, select.POLLOUT)
    return bool(poll.poll(0))


def never_wait() -> None:
    """Let stdout and stderr of this process drop what is not taken in time, for a loop in real time."""
    for name, number in (("stdout", 1), ("stderr", 2)):
        before = getattr(sys, name)
        setattr(sys, name, _wrapped(_Unwaiting(number), before))
    if isinstance(logging.lastResort, logging.StreamHandler):
        logging.lastResort.stream = sys.stderr


def send_waiting() -> int:
    """After `never_wait`: send what waits, as far as it is taken now; the number of lines that were lost and could not
    be told."""
    return sum(_send_waiting(stream) for stream in (sys.stdout, sys.stderr))


def _send_waiting(stream: Any) -> int:
    raw = _raw(stream)
    if raw is None:
        return 0
    with suppress(OSError, ValueError):
        stream.flush()
    raw.send_waiting()
    return raw.lost + raw._waiting.count(b"\n")


def _raw(stream: Any) -> _Unwaiting | None:
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    return raw if isinstance(raw, _Unwaiting) else None


_unlogged = 0
"""Number of lines of the log that were dropped since the last one that was taken."""


def log_without_waiting(log: logging.Logger, line: str) -> None:
    """Log a warning, unless it would have to wait for a handler's stream: then it is dropped, and the next one that is
    taken tells their number."""
    global _unlogged
    if any(_would_wait(getattr(handler, "stream", None)) for handler in _handlers(log)):
        _unlogged += 1
        return
    if _unlogged:
        lost, _unlogged = _unlogged, 0
        log.warning("%s", lost_lines(lost))
    text = line.encode(errors="backslashreplace")
    log.warning("%s", line if len(text) <= MAX_LINE else f"{text[:MAX_LINE].decode(errors='ignore')}...")


def _handlers(log: logging.Logger) -> list[logging.Handler]:
    """Those that get its records."""
    found: list[logging.Handler] = []
    each: logging.Logger | None = log
    while each is not None:
        found += each.handlers
        each = each.parent if each.propagate else None
    return found or [each for each in [logging.lastResort] if each is not None]


def _would_wait(stream: Any) -> bool:
    """Whether a line written to a stream may have to wait: that of a descriptor that takes nothing now."""
    if stream is None or _raw(stream) is not None:
        return False
    try:
        return not is_ready(stream.fileno())
    except (OSError, ValueError, AttributeError, TypeError):  # it has no descriptor, or is closed
        return False


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
    return _wrapped(_Descriptor(number, "w", closefd=False), before)


def _wrapped(raw: _Descriptor, before: TextIO | None) -> TextIO:
    encoding = "utf-8" if before is None else before.encoding
    lines = any(getattr(before, name, False) for name in ("line_buffering", "write_through"))
    # a name that is not UTF-8 is shown with its bytes, not refused
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=lines)

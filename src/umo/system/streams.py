"""Protection of a run against stdout and stderr, which must neither end nor delay it.

If the reader ends, the disk is full or a stream is closed, Python would raise BrokenPipeError or OSError from any
print, even from a print in control code. With this module the text is dropped without an exception.

Only commands that hold no machine wait without a limit for a full pipe, a stopped terminal or a slow journal, because
the reader may be a pager. A loop in real time and a guardian never wait: text that was not accepted is kept in limited
memory; text that exceeds this memory is dropped, and the dropped lines are counted. Every other process that holds a
machine or serves other processes waits for a limited time.
"""

from __future__ import annotations

import io
import logging
import os
import select
import socket
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from math import inf
from time import monotonic, sleep
from typing import Any, TextIO

from umo.text import with_time

CLEAR_LINE = "\r\x1b[2K"
"""The text that clears the line of a terminal, because the line may show the progress of a run."""


MAX_WAITING = 1 << 18
"""Largest number of bytes that wait for a slow reader."""
READER_TIMEOUT = 10.0
"""The time in s for which a command that holds a machine waits for a reader that accepts nothing, once for each
stream."""
RETRY_PAUSE = 0.001
"""The time in s until the next attempt if a stream was ready but accepted nothing."""
CLOCK = "machine_clock"
"""The attribute of a log record with the time of its event, as text."""
MAX_LINE = 3000
"""Largest number of bytes of a line of the log: a pipe accepts a line of at most this size either completely or not at
all (PIPE_BUF is 4096)."""


class _Stream(io.FileIO):
    """A descriptor that accepts all text, and drops text that it cannot write. `lost` counts the lines that were
    dropped because the reader did not accept them in time."""

    def __init__(self, number: int, patience: float = inf) -> None:
        super().__init__(number, "w", closefd=False)
        self.patience = patience
        """Time in s for which a write waits for a reader that accepts nothing. After that the rest of the text stays in
        memory, and no write waits until the reader accepts something. 0: no write waits; inf: every write waits."""
        self.lost = 0
        self._waiting = bytearray()
        self._is_stalled = False
        """True if the reader has accepted nothing for `patience` s."""
        self._sender: tuple[Callable[[bytes], int], Callable[[], None]] | None = None

    def set_patience(self, seconds: float) -> None:
        """Set `patience`. The next write waits again, even if the reader accepted nothing during an earlier write."""
        self.patience, self._is_stalled = seconds, False

    def write(self, data: object) -> int:
        text = memoryview(data).cast("B")  # type: ignore[arg-type]
        if self.patience == inf and not self._waiting:
            try:
                written = super().write(text)
            except OSError:
                return len(text)
            return len(text) if written is None else written  # None: it would block
        for begin in range(0, len(text), MAX_WAITING):
            self._write_part(bytes(text[begin : begin + MAX_WAITING]))
        return len(text)

    def close(self) -> None:
        if not self.closed:
            late.discard(self)
            if self._sender is not None:
                self._sender[1]()
        super().close()

    def send_waiting(self) -> None:
        """Send the text that the reader accepts now or in time, and then the number of lost lines, if any were lost."""
        self._send_in_time()
        if self.lost and not self._waiting:
            self._waiting += f"\numo: {lost_lines(self.lost)}\n".encode()
            self.lost = 0
            self._send_some()
        if not self._waiting:
            late.discard(self)

    def forget_waiting(self) -> None:
        """Discard waiting text in a forked process: the other process sends it."""
        self._waiting.clear()
        self.lost = 0

    def _write_part(self, text: bytes) -> None:
        self.send_waiting()
        if self.lost or len(self._waiting) + len(text) > MAX_WAITING:
            self.lost += text.count(b"\n") or 1
        else:
            self._waiting += text
            self.send_waiting()
        if self._waiting:
            late.add(self)

    def _send_in_time(self) -> None:
        """Send text until all is sent, or the reader has accepted nothing for `patience` s."""
        until = monotonic() + self.patience
        while self._send_some() and not self._is_stalled:
            left, before = until - monotonic(), len(self._waiting)
            if left <= 0:
                self._is_stalled = True
            elif is_ready(self.fileno(), left):
                if self._send_some() == before:
                    sleep(RETRY_PAUSE)
                else:
                    until = monotonic() + self.patience

    def _send_some(self) -> int:
        """Send the text that is accepted immediately. Return the number of bytes that are left."""
        if self._sender is None:
            self._sender = _sender(self.fileno())
        while self._waiting:
            try:
                taken = self._sender[0](bytes(self._waiting[: select.PIPE_BUF]))
            except BlockingIOError:
                break
            except OSError:  # nobody reads it any more
                self._waiting.clear()
                break
            del self._waiting[:taken]
            self._is_stalled &= not taken
        return len(self._waiting)


late: set[_Stream] = set()
"""The streams of this process in which text waits."""


def lost_lines(count: int) -> str:
    """Return the sentence which reports that this number of lines was dropped."""
    return f"{count:,} line{'s were' if count != 1 else ' was'} lost: their reader did not accept them in time"


def _sender(number: int) -> tuple[Callable[[bytes], int], Callable[[], None]]:
    """Return a function that writes bytes to a descriptor without waiting, and a function that closes the resources of
    the first one. The first function raises BlockingIOError if it would have to wait. A pipe or terminal is opened
    again, so that O_NONBLOCK does not affect other processes."""
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


def is_ready(number: int, timeout: float = 0.0) -> bool:
    """Return True if a descriptor accepts some bytes immediately, or within a time in s."""
    poll = select.poll()
    poll.register(number, select.POLLOUT)
    return bool(poll.poll(None if timeout == inf else timeout * 1e3))


def never_wait() -> None:
    """Let stdout and stderr of this process drop text that is not accepted in time. Use this for a loop in real time
    and for a guardian."""
    if _raw(sys.stdout) is None or _raw(sys.stderr) is None:
        keep_open()
        log_on_lines()
    limit_waits(0.0)


def limit_waits(patience: float | None = None) -> None:
    """Let writes to stdout and stderr wait this time in s (None: `READER_TIMEOUT`) for a reader that accepts nothing,
    if `keep_open` has made these streams. Use this for processes that run a machine or serve other processes."""
    for stream in (sys.stdout, sys.stderr):
        if (raw := _raw(stream)) is not None:
            with suppress(OSError, ValueError):
                stream.flush()
            raw.set_patience(READER_TIMEOUT if patience is None else patience)


@contextmanager
def without_waiting() -> Iterator[None]:
    """Return a context in which no write waits for its reader. Text that was not accepted is sent after the context,
    within the time that was set before."""
    before = [(raw, raw.patience) for raw in map(_raw, (sys.stdout, sys.stderr)) if raw is not None]
    limit_waits(0.0)
    try:
        yield
    finally:
        for raw, patience in before:
            raw.set_patience(patience)
        send_waiting()


def send_waiting() -> int:
    """Send the waiting text that is accepted now or in time. Return the number of lines that were lost without a
    notice."""
    return sum(_send_waiting(stream) for stream in (sys.stdout, sys.stderr))


def _send_waiting(stream: Any) -> int:
    raw = _raw(stream)
    if raw is None:
        return 0
    with suppress(OSError, ValueError):
        stream.flush()
    raw.send_waiting()
    return raw.lost + raw._waiting.count(b"\n")


def _raw(stream: Any) -> _Stream | None:
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    return raw if isinstance(raw, _Stream) else None


def _forget_waiting() -> None:
    for stream in tuple(late):
        stream.forget_waiting()
    late.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_waiting)

_unlogged = 0
"""Number of lines of the log that were dropped since the last one that was taken."""


def log_without_waiting(log: logging.Logger, line: str, seconds: float | None = None) -> None:
    """Log a warning, unless this would have to wait for a handler's stream. In this case the warning is dropped, and
    the next accepted warning contains the number of dropped warnings. `seconds`: the time on the machine's clock, with
    which the line begins on umo's own terminal (`log_on_lines`)."""
    global _unlogged
    if any(_would_wait(getattr(handler, "stream", None)) for handler in _handlers(log)):
        _unlogged += 1
        return
    if _unlogged:
        lost, _unlogged = _unlogged, 0
        log.warning("%s", lost_lines(lost))
    text = line.encode(errors="backslashreplace")
    line = line if len(text) <= MAX_LINE else f"{text[:MAX_LINE].decode(errors='ignore')}..."
    log.warning("%s", line, extra={} if seconds is None else {CLOCK: with_time(seconds, "")})


def _handlers(log: logging.Logger) -> list[logging.Handler]:
    """Return the handlers that get the records of a log."""
    found: list[logging.Handler] = []
    each: logging.Logger | None = log
    while each is not None:
        found += each.handlers
        each = each.parent if each.propagate else None
    return found or [each for each in [logging.lastResort] if each is not None]


def _would_wait(stream: Any) -> bool:
    """Return True if a line written to a stream might have to wait, because its descriptor accepts nothing now."""
    if stream is None or ((raw := _raw(stream)) is not None and raw.patience < inf):
        return False
    try:
        return not is_ready(stream.fileno())
    except (OSError, ValueError, AttributeError, TypeError):  # it has no descriptor, or is closed
        return False


def keep_open() -> None:
    """Keep stdout and stderr of this process open. A closed descriptor from 0 to 2 is opened on /dev/null, because
    otherwise the next file or connection would get its number, and then the printed text."""
    with suppress(OSError):
        while (file := os.open(os.devnull, os.O_RDWR)) <= 2:
            os.set_inheritable(file, True)
        os.close(file)
    sys.stdout = _steady(1, sys.stdout)
    sys.stderr = _steady(2, sys.stderr)


def say_without_waiting(text: str) -> None:
    """Write a line to stderr if it is accepted immediately. Nothing waits for a stopped terminal or a pipe without a
    reader."""
    with suppress(OSError):
        send, let_go = _sender(2)
        try:
            begin = "\n" if os.isatty(2) else ""  # the line of a run's progress, or a prompt, may stand there
            send(f"{begin}{text}\n".encode(errors="backslashreplace"))
        finally:
            let_go()


def log_on_lines() -> None:
    """Make log messages that no handler takes begin on a new line, because the current line may show the progress of a
    run; a message about an event begins with the time of the event."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setLevel(logging.WARNING)
    begin = CLEAR_LINE if sys.stderr.isatty() else ""
    handler.setFormatter(logging.Formatter(f"{begin}%({CLOCK})s%(message)s", defaults={CLOCK: ""}))
    logging.lastResort = handler


def log_tracebacks() -> None:
    """Let the log of umo have tracebacks of errors that do not end the run: its messages of the level DEBUG."""
    logging.getLogger("umo").setLevel(logging.DEBUG)
    if logging.lastResort is not None:
        logging.lastResort.setLevel(logging.DEBUG)


def _steady(number: int, before: TextIO | None) -> TextIO:
    with suppress(OSError, ValueError, AttributeError):
        before.flush()  # type: ignore[union-attr]
    return _wrapped(_Stream(number), before)


def _wrapped(raw: _Stream, before: TextIO | None) -> TextIO:
    encoding = "utf-8" if before is None else before.encoding
    lines = any(getattr(before, name, False) for name in ("line_buffering", "write_through"))
    # a name that is not UTF-8 is shown with its bytes, not refused
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=lines)

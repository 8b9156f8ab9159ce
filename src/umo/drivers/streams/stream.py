"""A stream of bytes to a device, which never blocks beyond a deadline. Deadlines are in s of `monotonic`."""

from __future__ import annotations

import os
import select
from collections.abc import Iterator
from contextlib import suppress
from io import FileIO
from socket import socket
from time import monotonic
from typing import Protocol

from umo.drivers.unreached import NotReached
from umo.text import reason_of

_MAX_RECEIVED = 4096
"""Largest number of bytes that are received at once."""


class Lost(NotReached):
    """The connection can no longer be used; the text gives the reason."""


class Gone(Lost):
    """The device has closed the connection, or the serial line has failed: it was unplugged."""


class TimedOut(Lost):
    """The deadline has passed; the text describes what arrived instead of the answer, if anything."""


class Stream:
    """An open connection or serial line that does not block."""

    def __init__(self, file: socket | FileIO, end: str) -> None:
        """`end`: the text of Gone when the stream ends."""
        self._file, self._end = file, end
        self._fd = file.fileno()
        self._in, self._out = select.poll(), select.poll()
        self._in.register(self._fd, select.POLLIN)
        self._out.register(self._fd, select.POLLOUT)

    def close(self) -> None:
        with suppress(OSError):  # it was unplugged
            self._file.close()

    def idle(self) -> bool:
        """Return True if no data have arrived, and the stream has not ended."""
        return not self._in.poll(0)

    def waiting(self) -> bytes:
        """Return the bytes received so far, at most 4096. Raises Gone."""
        try:
            data = os.read(self._fd, _MAX_RECEIVED)
        except OSError as error:
            return _nothing(error)
        if not data:
            raise Gone(self._end)
        return data

    def receive(self, deadline: float) -> bytes:
        """Wait for the first byte, and return the received bytes, at most 4096. Raises TimedOut or Gone."""
        left = deadline - monotonic()
        if left <= 0 or not self._in.poll(left * 1000):
            raise TimedOut
        return self.waiting()

    def give(self, data: bytes) -> int:
        """Send as much as the stream takes without waiting. Return the number of bytes. Raises Gone."""
        try:
            return os.write(self._fd, data)
        except OSError as error:
            return len(_nothing(error))

    def send(self, data: bytes, deadline: float) -> None:
        """Send all bytes. Raises TimedOut or Gone."""
        while True:
            try:
                sent = os.write(self._fd, data)
            except OSError as error:
                sent = len(_nothing(error))
            if sent == len(data):
                return
            data = data[sent:]
            left = deadline - monotonic()
            if left <= 0 or not self._out.poll(left * 1000):
                raise TimedOut


def _nothing(error: OSError) -> bytes:
    """Return no bytes if the stream is not ready. Any other error is Gone."""
    if isinstance(error, BlockingIOError):
        return b""
    raise Gone(reason_of(error)) from None


class Dial(Protocol):
    """An object that opens streams to one device. It raises Lost or DriverError."""

    def __call__(self, deadline: float) -> Stream:
        """Open a stream by the deadline."""

    def without_waiting(self, deadline: float) -> Iterator[Stream | None]:
        """Yield None repeatedly while the stream is being opened, until the deadline; then the open stream."""

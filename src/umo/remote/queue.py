"""The queue of commands: a file in shared memory, beside the frames of a run. Hands write to it, the machine reads it.

The machine reads with `pread` and does not map this file: whatever another process does to it, even cutting it short,
is at worst a command that is dropped. Hands take turns by a lock of the file, which the machine does not take.

Layout, little-endian: `HEADER`; at `HEAD` the number of commands written so far; from `FIRST` on `SLOTS` commands of
`SLOT` bytes each: CRC-32 of all that follows, size of the text, number of the command (from 1), text (JSON, UTF-8).

The machine reads the file only if the bell is not the number of commands that it has taken, and every `ANYWAY` s. The
bell is a number among the live numbers of the frames, which the machine has mapped. A hand writes a command, then the
head, then the bell. A wrong bell makes a command late by `ANYWAY`, or costs a look at the file in each period.
"""

from __future__ import annotations

import json
import os
import struct
import threading
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from umo.cycle.hands import HandCommand
from umo.errors import CommandRefused, FramesError
from umo.frames import Reader
from umo.frames.folder import QUEUE
from umo.frames.layout import BELL
from umo.system import folders
from umo.text import text_of

try:
    import fcntl
except ImportError:  # not on this platform: no machine runs in another process there
    fcntl = None  # type: ignore[assignment]

MAGIC, VERSION = b"umohands", 1
HEADER = struct.Struct("<8sII")
HEAD, FIRST = 32, 64
SLOTS, SLOT = 64, 1024
ENTRY = struct.Struct("<IIQ")
LONGEST = SLOT - ENTRY.size
"""Bytes of a command's text."""
DROPS = 4
"""The most entries that are dropped at one look."""
ANYWAY = 0.1
"""s after which the machine reads the file whatever the bell says."""
PATIENCE = 1.0
"""s that a hand waits for room in the queue, and for its turn."""
PAUSE = 0.002


class Receiver:
    """The machine's end. It makes the file, which only this user can open.

    `bell` is that of the ring of frames. `period` is the time between two looks in s; 0: every look reads the file.
    """

    def __init__(self, path: Path, bell: Sequence[int], period: float = 0.0) -> None:
        self.path = path
        self._bell = bell
        self._every = max(1, round(ANYWAY / period)) if period else 1
        self._looks = 0
        self.taken = 0
        self.dropped = 0
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
        try:
            self._file = os.open(path, flags, 0o600)
            os.pwrite(self._file, HEADER.pack(MAGIC, VERSION, SLOTS).ljust(FIRST + SLOTS * SLOT, b"\0"), 0)
        except OSError as error:
            raise FramesError(f"no queue for commands: {path}: {error.strerror}") from None
        self._seen = bytes(8)
        self._head = 0

    def take(self) -> HandCommand | None:
        """The next command; None if there is none. Whatever is not a command is counted and dropped."""
        self._looks += 1
        if self._bell[0] == self.taken and self._looks % self._every:
            return None
        head = os.pread(self._file, 8, HEAD)
        if head == self._seen and self.taken == self._head:
            return None
        if head != self._seen and not self._is_plausible(head):
            return None
        for _ in range(min(self._head - self.taken, DROPS)):
            command = self._next()
            if command is not None:
                return command
            self.dropped += 1
        return None

    def _is_plausible(self, head: bytes) -> bool:
        """Whether so many commands can have come in; if not, all of them are dropped."""
        self._seen = head
        number = int.from_bytes(head, "little") if len(head) == 8 else -1
        if self.taken <= number <= self.taken + SLOTS:
            self._head = number
            return True
        self.dropped += 1
        if 0 <= number < 1 << 62:
            self.taken = self._head = number
        return False

    def _next(self) -> HandCommand | None:
        at = FIRST + self.taken % SLOTS * SLOT
        self.taken += 1
        try:
            slot = os.pread(self._file, SLOT, at)
            checksum, size, number = ENTRY.unpack_from(slot)
            text = slot[ENTRY.size : ENTRY.size + size]
            if size > LONGEST or number != self.taken or checksum != _checksum(size, number, text):
                return None
            return HandCommand.parse(number, text)
        except (ValueError, TypeError, AttributeError, RecursionError, OverflowError, OSError, struct.error):
            return None

    def close(self) -> None:
        """Close and remove the file."""
        with suppress(OSError):
            self.path.unlink()
        os.close(self._file)


class Sender:
    """The hands' end: writes commands to the machine of a reader."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._alone = threading.Lock()  # threads of this process share the lock of the file
        path = reader.path.with_suffix(QUEUE)
        try:
            self._file = folders.open_own(path, write=True)
        except OSError as error:
            why = "it takes no commands" if isinstance(error, FileNotFoundError) else error.strerror
            raise FramesError(f"{reader.about['station']}: {why}") from None
        try:
            if os.pread(self._file, HEADER.size, 0) != HEADER.pack(MAGIC, VERSION, SLOTS):
                raise FramesError(f"{path} is not a queue of this version")
            self._frames = folders.open_own(reader.path, write=True)
        except (FramesError, OSError) as error:
            os.close(self._file)
            raise FramesError(text_of(error)) from None

    def send(self, command: dict[str, Any]) -> int:
        """Its number. CommandRefused if the queue stays full: the machine does not take commands, or too many come."""
        text = json.dumps(command).encode()
        if len(text) > LONGEST:
            raise CommandRefused(f"a command of {len(text)} bytes is too long; the most are {LONGEST}")
        until = time.monotonic() + PATIENCE
        while True:
            with self._alone, self._turn(until):
                head = int.from_bytes(os.pread(self._file, 8, HEAD), "little")
                if head - self._reader.taken < SLOTS:
                    self._put(head, text)
                    return head + 1
            if time.monotonic() > until:
                raise CommandRefused("the queue of commands is full: the machine does not take them")
            time.sleep(PAUSE)

    def _put(self, head: int, text: bytes) -> None:
        number = head + 1
        entry = ENTRY.pack(_checksum(len(text), number, text), len(text), number) + text
        os.pwrite(self._file, entry, FIRST + head % SLOTS * SLOT)
        os.pwrite(self._file, number.to_bytes(8, "little"), HEAD)
        os.pwrite(self._frames, number.to_bytes(8, "little"), BELL)

    @contextmanager
    def _turn(self, until: float) -> Iterator[None]:
        """Alone among the hands. The lock of one that dies ends with it."""
        while True:
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > until:
                    raise CommandRefused("another hand does not let go of the queue of commands") from None
                time.sleep(PAUSE)
        try:
            yield
        finally:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    def close(self) -> None:
        os.close(self._frames)
        os.close(self._file)


def _checksum(size: int, number: int, text: bytes) -> int:
    return zlib.crc32(text, zlib.crc32(struct.pack("<IQ", size, number)))

"""The queue of commands in the cells (`umo.process.frames.client_memory`): clients write it, the machine reads it.

A lock, which the machine does not take, lets one client write at a time. Each of the `SLOTS` commands has these
little-endian fields: CRC-32 of the following fields, size of the text, number of the command (from 1), text (JSON,
UTF-8). `HEAD` is the number of commands written so far; the machine corrects an impossible number.
"""

from __future__ import annotations

import json
import os
import struct
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError
from umo.operation.commands.client_commands import ClientCommand
from umo.process.frames import Reader
from umo.process.frames.client_memory import QUEUE, SLOT, SLOTS, ClientMemory

try:
    import fcntl
except ImportError:  # not on this platform: no machine runs in another process there
    fcntl = None  # type: ignore[assignment]

ENTRY = struct.Struct("<IIQ")
MAX_COMMAND_BYTES = SLOT - ENTRY.size
"""Largest size of a command's text, in bytes."""
MAX_DROPS = 4
"""The largest number of entries that are dropped in one look."""
SEND_TIMEOUT = 1.0
"""The time in s for which a client waits for room in the queue, and for the lock."""
SEND_PAUSE = 0.002


class Receiver:
    """The machine's end of the queue."""

    def __init__(self, cells: ClientMemory) -> None:
        self._head, self._memory = cells.head, cells.memory
        self.taken = 0
        self.dropped = 0
        self._doubted = 0
        """The last command that was incomplete when it was read."""

    def get(self) -> ClientCommand | None:
        """Return the next command, or None if there is none. Anything that is not a command is counted and dropped."""
        head = self._head[0]
        if head == self.taken:
            return None
        if not self.taken < head <= self.taken + SLOTS:  # so many cannot have come in
            self.dropped += 1
            self._head[0] = self.taken
            return None
        for _ in range(min(head - self.taken, MAX_DROPS)):
            number = self.taken + 1
            text = self._text(number)
            if text is None and self._doubted != number:  # some processors show the head before the rest: look again
                self._doubted = number
                return None
            self.taken = number
            if text is not None and (command := _parsed(number, text)) is not None:
                return command
            self.dropped += 1
        return None

    def _text(self, number: int) -> bytes | None:
        """Return the text of this command; None if it is incomplete."""
        at = QUEUE + (number - 1) % SLOTS * SLOT
        return command_in(bytes(self._memory[at : at + SLOT]), number)  # a copy: others may write there at any time


def command_in(slot: bytes, number: int) -> bytes | None:
    """Return the text of the command with this number in a slot of the queue; None if it is missing or incomplete."""
    checksum, size, found = ENTRY.unpack_from(slot)
    text = slot[ENTRY.size : ENTRY.size + size]
    whole = size <= MAX_COMMAND_BYTES and found == number and checksum == _checksum(size, number, text)
    return text if whole else None


class Sender:
    """A client's end of the queue."""

    def __init__(self, reader: Reader, cells: ClientMemory) -> None:
        self._reader = reader
        self._head, self._memory = cells.head, cells.memory
        self._alone = threading.Lock()  # threads of this process share the lock of the file
        assert reader.ends is not None
        try:  # opened anew: a lock belongs to whoever has opened the file, and all clients were given one and the same
            self._file = os.open(f"/proc/self/fd/{reader.ends.cells}", os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise FramesError(
                f"{reader.about['station']}: the queue for commands cannot be opened: {error.strerror}"
            ) from None

    def send(self, command: dict[str, Any]) -> int:
        """Send a command and return its number. Raises CommandRefused if the queue stays full, or if the machine would
        drop the command without an answer."""
        text = json.dumps(command).encode()
        if _parsed(0, text) is None:
            raise CommandRefused(f"{command.get('do')} {command.get('path')}: it is not a valid command")
        if len(text) > MAX_COMMAND_BYTES:
            raise CommandRefused(f"a command of {len(text)} bytes is too long; the most are {MAX_COMMAND_BYTES}")
        until = time.monotonic() + SEND_TIMEOUT
        while True:
            with self._alone, self._turn(until):
                head = max(self._head[0], self._reader.taken)
                if head - self._reader.taken < SLOTS:
                    self._put(head, text)
                    return head + 1
            if time.monotonic() > until:
                if self._reader.state is Stage.ENDED:
                    raise FramesError(f"{self._reader.about['station']} has ended")
                raise CommandRefused("the queue of commands is full: the machine does not take commands from it")
            time.sleep(SEND_PAUSE)

    def _put(self, head: int, text: bytes) -> None:
        number, at = head + 1, QUEUE + head % SLOTS * SLOT
        entry = ENTRY.pack(_checksum(len(text), number, text), len(text), number) + text
        self._memory[at : at + len(entry)] = entry
        self._head[0] = number

    @contextmanager
    def _turn(self, until: float) -> Iterator[None]:
        """Return a context in which no other client uses the queue. If a client dies, its lock is released."""
        while True:
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > until:
                    raise CommandRefused("another client has locked the queue of commands") from None
                time.sleep(SEND_PAUSE)
        try:
            yield
        finally:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    def close(self) -> None:
        os.close(self._file)


def _parsed(number: int, text: bytes) -> ClientCommand | None:
    """Return the command in a text, or None if it has none."""
    try:
        return ClientCommand.parse(number, text)
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        return None


def _checksum(size: int, number: int, text: bytes) -> int:
    return zlib.crc32(text, zlib.crc32(struct.pack("<IQ", size, number)))

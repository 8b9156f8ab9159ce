"""The units of a serial line (Modbus over Serial Line V1.02, RTU).

A frame has no number, so a late answer looks like the answer to the next request of the same kind. Therefore a unit
whose answer did not come in time is not asked for the same function again for its `recovery` time. Bytes received
during this time are discarded. The late answer itself ends the time early, and so does a damaged answer that can be
recognised (`has_come`), because nothing else will come then. Other functions and other units continue: an answer names
unit and function, so a late answer cannot be taken for an answer to them. Functions 5, 6 and 22 continue, too, because
their answers repeat address and value. When the line is opened, the recovery time starts for every unit, because
another process that has ended may have asked the unit.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic, sleep
from typing import ClassVar

from umo.drivers.modbus.answer import answer_size
from umo.drivers.modbus.rtu_frame import CHECKSUM_SIZE, answer_end, has_come, is_answer
from umo.drivers.streams import Gone, Lost, Serial, Stream, TimedOut
from umo.errors import DriverError

_MAX_STRAY = 256
"""Stray bytes that are kept."""
_MAX_DISCARDS = 16
"""Reads of up to 4 KiB after which a line that does not fall silent is left."""
_UNMISTAKABLE = (5, 6, 22)
"""Functions whose answer repeats what was written. A late answer to an earlier request then has another address or
value, or confirms that the same value was written."""


UnitFunction = tuple[int, int]


@dataclass(frozen=True)
class PendingAnswer:
    """An answer that may still arrive: `request` was given up at the time `since`. Without a request, it is an answer
    to another process."""

    request: bytes
    since: float


class SerialLine:
    """A serial line of this process, which the drivers of its units share. The line is open while one of these drivers
    is open."""

    _lines: ClassVar[dict[tuple[int, str], SerialLine]] = {}

    def __init__(self, place: Serial, key: tuple[int, str]) -> None:
        self.place = place
        self._dial = place.dial()
        self._silence = silence(place)
        self._key = key
        self._users = 0
        self._port: Stream | None = None
        self.opened_at = 0.0
        self._owed: dict[UnitFunction, PendingAnswer | None] = {}
        """The pending answer of each unit that was asked since the line was opened, or None if none is pending."""
        self._last_byte_at = 0.0
        self._stray = b""
        """The bytes that have arrived since the last request was sent."""
        self._last_asked: UnitFunction | None = None
        """The unit and the function of the last request."""
        self._echo = b""
        """The bytes of the last request that the line has still to repeat."""

    @classmethod
    def join(cls, place: Serial) -> SerialLine:
        """Return the line of this device file. A child process has separate lines."""
        key = (os.getpid(), os.path.realpath(place.path))
        line = cls._lines.setdefault(key, cls(place, key))
        if str(line.place) != str(place):
            raise DriverError(f"{place.path} is open at {line.place} for another unit, and here it is {place}")
        line._users += 1
        return line

    def leave(self) -> None:
        self._users -= 1
        if not self._users:
            self.close()
            self._lines.pop(self._key, None)

    @property
    def is_shared(self) -> bool:
        """True if several units are on the line."""
        return self._users > 1

    @property
    def is_silent(self) -> bool:
        """True if nothing was sent for 3.5 characters."""
        return monotonic() >= self._last_byte_at + self._silence

    @property
    def port(self) -> Stream:
        if self._port is None:
            raise Gone("the serial line is closed")
        return self._port

    def open(self, deadline: float) -> None:
        """Open the line if it is not open, or has failed since. Raises DriverError if opening fails."""
        if self._port is None:
            self._port = self._dial(deadline)
            self.opened_at = self._last_byte_at = monotonic()
            self._owed.clear()
            self._last_asked, self._echo = None, b""

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
        self._port = None

    def owed(self, asked: UnitFunction) -> PendingAnswer | None:
        """Return a pending answer that could be taken for the answer to this function if the unit were asked now."""
        if asked[1] in _UNMISTAKABLE:
            return None
        return self._owed.get(asked, PendingAnswer(b"", self.opened_at))

    def settle(self, asked: UnitFunction) -> None:
        """Record that no answer is pending any more: it has arrived, or its time is over."""
        self._owed[asked] = None

    def exchange(self, frame: bytes, deadline: float) -> bytes:
        """Send a frame, and return unit, function and data of its answer."""
        self._wait_for_silence(deadline)
        request, asked = frame[:-CHECKSUM_SIZE], (frame[0], frame[1])
        try:
            self._send(frame, deadline)
            answer = self._answer(request, deadline)
        except BaseException:
            self._owed[asked] = PendingAnswer(request, monotonic())
            self._consider(b"")
            raise
        self.settle(asked)
        return answer

    def ask(self, frame: bytes) -> None:
        """Send a frame, and note that its answer is pending."""
        self._send(frame, 0.0)
        self._owed[frame[0], frame[1]] = PendingAnswer(frame[:-CHECKSUM_SIZE], monotonic())

    def _send(self, frame: bytes, deadline: float) -> None:
        self._last_byte_at = monotonic() + len(frame) * self.place.character  # it is on its way for so long
        self._last_asked, self._stray = (frame[0], frame[1]), b""
        self.port.send(frame, deadline)
        self._echo = frame if self.place.echo else b""

    def _without_echo(self, data: bytes) -> bytes:
        """Return the data without the echo of the request. Raises Lost if there is no echo, or another sender has sent,
        too."""
        size = min(len(data), len(self._echo))
        repeated, self._echo = self._echo[:size], self._echo[size:]
        if data[:size] != repeated:
            self._echo = b""
            raise Lost("the line does not repeat the request; echo = false, if no adapter does")
        return data[size:]

    def discard(self) -> None:
        """Discard received data that answer no request. A late answer is no longer expected."""
        for _ in range(_MAX_DISCARDS):
            data = self.port.waiting()
            if not data:
                return
            self._last_byte_at = monotonic()
            with suppress(Lost):
                data = self._without_echo(data)
            self._consider(data)

    def _consider(self, data: bytes) -> None:
        """Check whether received bytes are a pending answer. If so, that answer is no longer pending."""
        self._stray = (self._stray + data)[-_MAX_STRAY:]
        for asked, owed in self._owed.items():
            came = has_come if asked == self._last_asked else is_answer
            if owed is not None and owed.request and came(owed.request, self._stray):
                self._owed[asked] = None

    def _wait_for_silence(self, deadline: float) -> None:
        """Wait until nothing was sent for 3.5 characters."""
        self.discard()
        while (pause := self._last_byte_at + self._silence - monotonic()) > 0:
            if monotonic() + pause > deadline:
                raise TimedOut("the line was not silent")
            sleep(pause)
            self.discard()

    def _answer(self, request: bytes, deadline: float) -> bytes:
        data = b""
        while True:
            answered = self._answered(request, data)
            end = answer_end(answered, data) if len(data) > 1 else 0
            if not end:
                data += self._receive(request, data, deadline)
            elif answered is not request:
                self.settle((data[0], data[1] & 0x7F))
                data = data[end:]
            elif len(data) > end:
                raise Lost(f"an answer of {len(data)} bytes in place of {end}")
            else:
                return data[:-CHECKSUM_SIZE]

    def _answered(self, request: bytes, data: bytes) -> bytes:
        """Return the request to which the data is an answer: this request, or an earlier one whose answer is late."""
        if len(data) > 1 and (data[0], data[1] & 0x7F) != (request[0], request[1]):
            owed = self._owed.get((data[0], data[1] & 0x7F))
            return request if owed is None else owed.request
        return request

    def _receive(self, request: bytes, data: bytes, deadline: float) -> bytes:
        try:
            more = self.port.receive(deadline)
        except TimedOut:
            size = answer_size(request) + CHECKSUM_SIZE
            raise TimedOut(f"{len(data)} of {size} bytes of an answer came" if data else "") from None
        self._last_byte_at = monotonic()
        more = self._without_echo(more)
        self._stray += more
        return more


def silence(place: Serial) -> float:
    """Return the time in s between two frames: 3.5 characters, or 1.75 ms above 19200 baud (Modbus over Serial Line,
    2.5.1.1)."""
    return 3.5 * place.character if place.baudrate <= 19200 else 1.75e-3

"""A connection to a Modbus TCP device. The fields of a frame are transaction, protocol (0), length of the following
fields, unit, function, data (Modbus Messaging on TCP/IP Implementation Guide V1.0b).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from time import monotonic, sleep

from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU

from umo.drivers.modbus.answer import GATEWAY_EXCEPTIONS, Recovering, check
from umo.drivers.streams import Gone, Host, Look, Lost, Stream, TimedOut
from umo.duration import duration

_HEADER = struct.Struct(">HHH")
_MIN_LENGTH, _MAX_LENGTH = 2, 254  # what may follow the header: unit, function and up to 252 bytes of data


class Tcp:
    """A connection of one driver. After Lost, `failed` closes it."""

    def __init__(self, place: Host, answers_as: int | None, boot_time: float) -> None:
        self._answers_as, self._boot_time = answers_as, boot_time
        self._starts_until = 0.0
        """Time at which the device takes requests on this connection."""
        self.framer = FramerSocket(DecodePDU(False))
        self._dial = place.dial()
        self._look = Look(self._dial)
        self._deadline = 0.0
        self._stream: Stream | None = None
        self._transaction = 0
        self._data = b""

    def begin(self, deadline: float) -> bool:
        """Connect if needed, and discard leftover data. All calls until the next `begin` end by this deadline. Return
        True if the connection is new."""
        self._deadline = deadline
        # Data is an answer that nobody waits for; the end of the stream is seen in the same way.
        if self._stream is not None and not self._data and self._stream.idle():
            return False
        self.close()
        self._stream = self._dial(deadline)
        self._data, self._starts_until = b"", monotonic() + self._boot_time
        return True

    def recover(self, deadline: float) -> None:
        """Wait until the device accepts requests; a new connection needs no other recovery."""
        if (wait := min(self._starts_until, deadline) - monotonic()) > 0:
            sleep(wait)

    def look(self, request: ModbusPDU, seconds: float) -> bool | None:
        """Return whether the device answers this request, on a new connection and without waiting; None if this is not
        known yet. Raises Lost or DriverError."""
        if self._stream is not None and not self._data and self._stream.idle():
            return True  # it answered the last request: any failure would have closed the connection
        if not self._look.under_way:
            self.close()
            frame = self._frame(request)
            self._look.begin(frame, partial(self._is_answer, frame), seconds + self._boot_time, self._starter())
        self._stream, self._data = self._look.found(), b""
        return None if self._stream is None else True

    def _starter(self) -> Callable[[Stream], bool]:
        """Return a function that tests whether the device accepts requests on a new connection."""
        connected_at: list[float] = []

        def is_ready(stream: Stream) -> bool:
            connected_at[:] = connected_at or [monotonic()]
            return monotonic() >= connected_at[0] + self._boot_time

        return is_ready

    def _is_answer(self, frame: bytes, data: bytes) -> bool:
        """Return True if the data is the whole answer to this frame, which may be an exception answer. Raises Lost for
        the answer to another request, and if a gateway does not reach the unit."""
        if not (end := frame_end(data)):
            return False
        answer = data[_HEADER.size : end]
        if data[:2] != frame[:2] or len(data) > end:
            raise Lost("the answer to another request")
        self._check(frame, answer)
        if answer[1] & 0x80 and answer[2] in GATEWAY_EXCEPTIONS:
            raise Lost("the gateway does not reach the unit")
        return True

    def close(self) -> None:
        self._look.stop()
        if self._stream is not None:
            self._stream.close()
        self._stream = None

    def failed(self, error: Lost) -> None:
        """Close the connection, so that a late answer is lost. If no request was sent, the connection stays open."""
        if not isinstance(error, Recovering):
            self.close()

    def exchange(self, request: ModbusPDU) -> bytes:
        """Send the request. Return unit, function and data of its answer, which may be an exception answer."""
        if self._stream is None:
            raise Gone("the connection is closed")
        if self._boot_time and self._starts_until > monotonic():
            if self._starts_until > self._deadline:
                raise Recovering(
                    f"the device takes requests again in {duration(round(self._starts_until - monotonic(), 3))}"
                )
            self.recover(self._deadline)
        frame = self._frame(request)
        self._stream.send(frame, self._deadline)
        answer = self._answer(self._stream)
        self._check(frame, answer)
        return answer

    def _frame(self, request: ModbusPDU) -> bytes:
        self._transaction = request.transaction_id = self._transaction % 65535 + 1
        return self.framer.buildFrame(request)

    def _check(self, frame: bytes, answer: bytes) -> None:
        asked = frame[_HEADER.size :]
        check(asked if self._answers_as is None else bytes([self._answers_as, *asked[1:]]), answer)

    def _answer(self, stream: Stream) -> bytes:
        """Return the contents of the frame with this transaction's number. Earlier answers are skipped."""
        passed_over = ""
        while True:
            while not (end := frame_end(self._data)):
                try:
                    self._data += stream.receive(self._deadline)
                except TimedOut:
                    raise TimedOut(passed_over) from None
            frame, self._data = self._data[:end], self._data[end:]
            given = int.from_bytes(frame[:2], "big")
            if given == self._transaction:
                return frame[_HEADER.size :]
            wrong = f"an answer to transaction {given} in place of {self._transaction}"
            if not 0 < given < self._transaction:
                raise Lost(wrong)
            passed_over = f"{wrong}, and no other answer came"


def frame_end(data: bytes) -> int:
    """Return the end of the first frame of the data; 0 while the frame is incomplete. Raises Lost if the data is not
    Modbus."""
    if len(data) < _HEADER.size:
        return 0
    _, protocol, length = _HEADER.unpack_from(data)
    if protocol or not _MIN_LENGTH <= length <= _MAX_LENGTH:
        raise Lost("the received data is not Modbus")
    end = _HEADER.size + length
    return end if len(data) >= end else 0

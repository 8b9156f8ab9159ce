"""The frames of a serial line: unit, function, data, check sum (Modbus over Serial Line V1.02). The functions are pure
and use no line."""

from __future__ import annotations

from operator import eq

from pymodbus.framer import FramerRTU

from umo.drivers.modbus.answer import EXCEPTION_SIZE, answer_size, answer_starts, check, check_start
from umo.drivers.streams import Lost

CHECKSUM_SIZE = 2


def answer_end(request: bytes, data: bytes) -> int:
    """Return the end of the answer with which the data begins; 0 while the answer is incomplete. Raises Lost if the
    data does not begin with an answer to the request. The request is without its check sum."""
    check_start(request, data[:EXCEPTION_SIZE])
    if len(data) < EXCEPTION_SIZE:
        return 0
    size = EXCEPTION_SIZE if data[1] & 0x80 else answer_size(request)
    if len(data) < size + CHECKSUM_SIZE:
        return 0
    if not _is_intact(data[: size + CHECKSUM_SIZE]):
        raise Lost("an answer with a wrong check sum")
    check(request, data[:size])
    return size + CHECKSUM_SIZE


def is_answer(request: bytes, data: bytes) -> bool:
    """Return True if the data is the answer to the request and nothing else."""
    return 0 < _end(request, data) == len(data)


def has_come(request: bytes, data: bytes) -> bool:
    """Return True if the bytes received since the request are its answer, damaged on the line, so that no other answer
    will come. There are three such cases. The bytes contain the answer among other bytes. They begin like the answer,
    with the right unit, function and third byte. Or they are as many as the answer has, and two of these three bytes
    are right. An intact frame that is not the answer comes from another unit, or answers another request."""
    if any(_end(request, data[at:]) for at in range(len(data))):
        return True
    for start in answer_starts(request):
        size = CHECKSUM_SIZE + (answer_size(request) if len(start) > 2 else EXCEPTION_SIZE)
        right = sum(map(eq, data, start))
        if (right == 3 or (right == 2 and len(data) == size)) and not _is_intact(data[:size]):
            return True
    return False


def _end(request: bytes, data: bytes) -> int:
    """Return the end of the answer (`answer_end`); 0 also if the data begins with anything else."""
    try:
        return answer_end(request, data)
    except Lost:
        return 0


def _is_intact(frame: bytes) -> bool:
    """True if the check sum at its end is right."""
    return bool(FramerRTU.check_CRC(frame[:-CHECKSUM_SIZE], int.from_bytes(frame[-CHECKSUM_SIZE:], "big")))

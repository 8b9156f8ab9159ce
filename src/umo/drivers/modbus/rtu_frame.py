"""Frames of a serial line: unit, function, data, check sum (Modbus over Serial Line V1.02): pure functions, no line."""

from __future__ import annotations

from pymodbus.framer import FramerRTU

from umo.drivers.modbus.answer import EXCEPTION_SIZE, answer_size, check, check_start
from umo.drivers.streams import Lost

SUM = 2
"""Bytes of the check sum."""


def answer_end(request: bytes, data: bytes) -> int:
    """Where the answer to the request ends that the data begins with; 0 while it is incomplete. Lost if the data begins
    with anything else. The request is without its check sum."""
    check_start(request, data[:EXCEPTION_SIZE])
    if len(data) < EXCEPTION_SIZE:
        return 0
    size = EXCEPTION_SIZE if data[1] & 0x80 else answer_size(request)
    if len(data) < size + SUM:
        return 0
    if not FramerRTU.check_CRC(data[:size], int.from_bytes(data[size : size + SUM], "big")):
        raise Lost("an answer with a wrong check sum")
    check(request, data[:size])
    return size + SUM


def is_answer(request: bytes, data: bytes) -> bool:
    """Whether the data is the answer to the request and nothing else."""
    try:
        return answer_end(request, data) == len(data)
    except Lost:
        return False

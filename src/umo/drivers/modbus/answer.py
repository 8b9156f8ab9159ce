"""Functions that check the answer to a request and extract its values. They are pure and use no line.

pymodbus does not check lengths and confirmations; values for a machine need these checks. Here, requests and answers
consist of unit, function and data, which TCP and serial lines have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import unpack_from

from umo.drivers.streams import Lost
from umo.errors import DriverError

EXCEPTION_SIZE = 3
MASK_WRITE, READ_WRITE = 22, 23
GATEWAY_EXCEPTIONS = (10, 11)
"""Exceptions with which a gateway answers for a unit that it cannot reach."""


class Recovering(Lost):
    """The unit must not be asked yet; the text gives the reason."""


class Refused(DriverError):
    """The device answered with an exception, or this request was not sent. Other requests may succeed."""


def answer_size(request: bytes) -> int:
    """Return the number of bytes of the normal answer to a request."""
    return 3 + _data_size(request) if _reads(request) else 8 if request[1] == MASK_WRITE else 6


def check(request: bytes, answer: bytes) -> None:
    """Check an answer. Raises Lost unless the answer fits the request in every respect. An exception answer is
    accepted."""
    check_start(request, answer)
    if answer[1] & 0x80:
        _check_length("an exception answer", answer, EXCEPTION_SIZE)
    elif _reads(request):
        _check_length("an answer", answer, answer_size(request))
    else:
        _check_echo(request, answer)


def cells_of(answer: bytes) -> Sequence[int]:
    """Return the cells of a checked answer: registers, or bits including those that fill the last byte."""
    if answer[1] <= 2:
        return [byte >> bit & 1 for byte in answer[3:] for bit in range(8)]
    return unpack_from(f">{answer[2] // 2}H", answer, 3)


def check_start(request: bytes, answer: bytes) -> None:
    """Check the beginning of an answer. Raises Lost if the answer belongs to another request."""
    unit, function = request[0], request[1]
    if answer and answer[0] != unit:
        raise Lost(f"an answer of unit {answer[0]} in place of {unit}")
    if len(answer) > 1 and answer[1] not in (function, function | 0x80):
        raise Lost(f"an answer to function {answer[1] & 0x7F} in place of {function}")
    if len(answer) > 2 and answer[1] == function and _reads(request) and answer[2] != _data_size(request):
        raise Lost(f"a byte count of {answer[2]} in place of {_data_size(request)}")


def answer_starts(request: bytes) -> tuple[bytes, bytes]:
    """Return the first bytes of the answer to a request, and of an exception answer to it."""
    third = _data_size(request) if _reads(request) else request[2]
    return bytes([*request[:2], third]), bytes([request[0], request[1] | 0x80])


def _reads(request: bytes) -> bool:
    return request[1] <= 4 or request[1] == READ_WRITE


def _data_size(request: bytes) -> int:
    count = _word(request, 4)
    return (count + 7) // 8 if request[1] <= 2 else 2 * count


def _check_echo(request: bytes, answer: bytes) -> None:
    """Check the echo of a write. For one cell, or for masks, it repeats address and values as they were sent; for
    several cells it contains the address and the number of cells."""
    size = answer_size(request)
    _check_length("an answer", answer, size)
    if answer[1:] != request[1:size]:
        raise Lost(f"the answer confirms {_confirmed(answer)} in place of {_confirmed(request)}")


def _confirmed(frame: bytes) -> str:
    if frame[1] == MASK_WRITE:
        return f"address {_word(frame, 2)}, masks {_word(frame, 4):#x} and {_word(frame, 6):#x}"
    kind = "value" if frame[1] < 15 else "count"
    return f"address {_word(frame, 2)}, {kind} {_word(frame, 4):#x}"


def _check_length(what: str, answer: bytes, length: int) -> None:
    if len(answer) != length:
        raise Lost(f"{what} of {len(answer) - 1} bytes in place of {length - 1}")


def _word(data: bytes, place: int) -> int:
    return data[place] << 8 | data[place + 1]

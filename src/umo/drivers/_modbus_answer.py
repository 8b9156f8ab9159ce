"""Finds and checks the answer to a request in the received bytes: pure functions, no socket.

pymodbus does not check lengths and confirmations; values for a machine need these checks.
Requests and answers are whole frames: transaction, protocol (0), length of what follows, unit, function, data.
"""

from __future__ import annotations

import struct

from umo.errors import DriverError

BODY = 7
"""Where a frame's function and data begin."""
_HEADER = struct.Struct(">HHH")
_START = struct.Struct(">HHHBB")  # up to the function
_REQUEST = struct.Struct(">HHHBBHH")  # and the address, and the value or number of cells: every request has them
_SHORTEST, _LONGEST = 2, 254  # what may follow the header: unit, function and up to 252 bytes of data


class Lost(Exception):
    """The connection is of no more use; says why."""


class TimedOut(Lost):
    """The deadline has passed; says what came in place of the answer, if anything did."""


class Refused(DriverError):
    """The device answered by an exception: it is alive, and its other channels may be well."""


def frame_end(data: bytes) -> int:
    """Where the first frame of the data ends, 0 while it is incomplete; Lost if the data is not Modbus."""
    if len(data) < _HEADER.size:
        return 0
    _, protocol, length = _HEADER.unpack_from(data)
    if protocol or not _SHORTEST <= length <= _LONGEST:
        raise Lost("the received data is not Modbus")
    end = _HEADER.size + length
    return end if len(data) >= end else 0


def answers(request: bytes, answer: bytes) -> bool:
    """Whether the frame fits the request in everything; an exception answer does. False for an answer to a request
    before this one, which may be passed over; Lost for anything else."""
    transaction, _, _, unit, function, _, count = _REQUEST.unpack_from(request)
    given, _, _, its_unit, its_function = _START.unpack_from(answer)
    if given != transaction:
        if 0 < given < transaction:
            return False
        raise Lost(wrong_transaction(request, answer))
    if its_unit != unit:
        raise Lost(f"an answer of unit {its_unit} in place of {unit}")
    if its_function == function | 0x80:
        _check_length("an exception answer", answer, 2)
    elif its_function != function:
        raise Lost(f"an answer to function {its_function & 0x7F} in place of {function}")
    elif function <= 4:
        _check_data(answer, (count + 7) // 8 if function <= 2 else 2 * count)
    else:
        _check_echo(request, answer)
    return True


def wrong_transaction(request: bytes, answer: bytes) -> str:
    return f"an answer to transaction {_word(answer, 0)} in place of {_word(request, 0)}"


def _check_data(answer: bytes, size: int) -> None:
    """The byte count and as many bytes."""
    if len(answer) > BODY + 1 and answer[BODY + 1] != size:
        raise Lost(f"a byte count of {answer[BODY + 1]} in place of {size}")
    _check_length("an answer", answer, 2 + size)


def _check_echo(request: bytes, answer: bytes) -> None:
    """One cell's address and value come back as they were sent, of many the address and their number."""
    _check_length("an answer", answer, 5)
    if answer[BODY:] != request[BODY : BODY + 5]:
        raise Lost(f"the answer confirms {_confirmed(answer)} in place of {_confirmed(request)}")


def _confirmed(frame: bytes) -> str:
    kind = "value" if frame[BODY] < 15 else "count"
    return f"address {_word(frame, BODY + 1)}, {kind} {_word(frame, BODY + 3):#x}"


def _check_length(what: str, answer: bytes, length: int) -> None:
    if len(answer) != BODY + length:
        raise Lost(f"{what} of {len(answer) - BODY} bytes in place of {length}")


def _word(data: bytes, place: int) -> int:
    return data[place] << 8 | data[place + 1]

"""What of a device's bytes is the answer to a request, and nothing but that: pure functions, no socket.

pymodbus takes lengths and confirmations as they come; a value that moves a machine is looked at more closely.
Requests and answers are whole frames: transaction, protocol (0), length of what follows, unit, function, data.
"""

from __future__ import annotations

from umo.errors import DriverError

_HEADER = 6
_UNIT, _FUNCTION = 6, 7
_SHORTEST, _LONGEST = 2, 254  # what may follow the header: unit, function and up to 252 bytes of data


class Lost(Exception):
    """The connection is of no more use; says why. Not a TimeoutError, as pymodbus swallows those."""


class TimedOut(Lost):
    """The deadline has passed; says what came in place of the answer, if anything did."""


class Refused(DriverError):
    """The device answered by an exception: it is alive, and its other channels may be well."""


def frame_end(data: bytes) -> int:
    """Where the first frame of the data ends, 0 while it is not whole; Lost if these are no frames."""
    if len(data) < _HEADER:
        return 0
    length = _word(data, 4)
    if data[2] or data[3] or not _SHORTEST <= length <= _LONGEST:
        raise Lost("what came is not Modbus")
    end = _HEADER + length
    return end if len(data) >= end else 0


def answers(request: bytes, answer: bytes) -> bool:
    """Whether the frame fits the request in everything; an exception answer does. False for an answer to a request
    before this one, which may be passed over; Lost for anything else."""
    if answer[:2] != request[:2]:
        if 0 < _word(answer, 0) < _word(request, 0):
            return False
        raise Lost(wrong_transaction(request, answer))
    if answer[_UNIT] != request[_UNIT]:
        raise Lost(f"an answer of unit {answer[_UNIT]} in place of {request[_UNIT]}")
    _check(request[_FUNCTION:], answer[_FUNCTION:])
    return True


def wrong_transaction(request: bytes, answer: bytes) -> str:
    return f"an answer to transaction {_word(answer, 0)} in place of {_word(request, 0)}"


def _check(asked: bytes, said: bytes) -> None:
    """Both from their function on."""
    function = asked[0]
    if said[0] == function | 0x80:
        _check_length("an exception answer", len(said), 2)
    elif said[0] != function:
        raise Lost(f"an answer to function {said[0] & 0x7F} in place of {function}")
    elif function <= 4:
        _check_data(said, _word(asked, 3), bitwise=function <= 2)
    else:
        _check_echo(asked, said)


def _check_data(said: bytes, count: int, *, bitwise: bool) -> None:
    size = (count + 7) // 8 if bitwise else 2 * count
    if len(said) > 1 and said[1] != size:
        raise Lost(f"a byte count of {said[1]} in place of {size}")
    _check_length("an answer", len(said), 2 + size)


def _check_echo(asked: bytes, said: bytes) -> None:
    """One cell's address and value come back as they were sent, of many the address and their number."""
    _check_length("an answer", len(said), 5)
    if said != asked[:5]:
        raise Lost(f"the answer confirms {_confirmed(said)} in place of {_confirmed(asked)}")


def _confirmed(data: bytes) -> str:
    return f"address {_word(data, 1)}, {'value' if data[0] < 15 else 'count'} {_word(data, 3):#x}"


def _check_length(what: str, length: int, wanted: int) -> None:
    if length != wanted:
        raise Lost(f"{what} of {length} bytes in place of {wanted}")


def _word(data: bytes, place: int) -> int:
    return data[place] << 8 | data[place + 1]

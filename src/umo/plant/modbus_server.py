"""The device's side of Modbus TCP, reduced to the needs of a controller box. The server of pymodbus is not used for
three reasons. Its tables cannot refuse an address next to a mapped coil. It takes 70 us more for each request, and a
period has four requests. And a box should not consist of the same parts as the driver that is tested with it.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Sequence
from typing import Protocol

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4

_READS = {1: ("coil", 2000), 2: ("discrete", 2000), 3: ("holding", 125), 4: ("input", 125)}
_HEADER = struct.Struct(">HHHB")  # transaction, protocol (0), length of what follows, unit
_MAX_LENGTH = 254
_ON, _OFF = 0xFF00, 0x0000


class ExceptionAnswer(Exception):
    """The exception with which a request is answered."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class RegisterCells(Protocol):
    """The four tables of registers. Both methods raise ExceptionAnswer; a refused write has changed nothing."""

    def read(self, table: str, address: int, count: int) -> list[int]: ...

    def write(self, table: str, address: int, values: Sequence[int]) -> None: ...


def answer(request: bytes, cells: RegisterCells) -> bytes:
    """Return the answer to a request; both are without a header. `request` has at least a function code."""
    function, body = request[0], request[1:]
    try:
        return bytes([function & 0x7F]) + _answer(function, body, cells)
    except ExceptionAnswer as refused:
        return bytes([function | 0x80, refused.code])


def _answer(function: int, body: bytes, cells: RegisterCells) -> bytes:
    if function in _READS:
        return _read(function, body, cells)
    if function in (5, 6):
        return _write_one(function, body, cells)
    if function in (15, 16):
        return _write_many(function, body, cells)
    if function == 22:
        return _mask_write(body, cells)
    if function == 23:
        return _read_write(body, cells)
    raise ExceptionAnswer(ILLEGAL_FUNCTION)


def _read(function: int, body: bytes, cells: RegisterCells) -> bytes:
    table, most = _READS[function]
    address, count = _two_words(body)
    if not 1 <= count <= most:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    values = cells.read(table, address, count)
    packed = _pack_bits(values) if function < 3 else struct.pack(f">{count}H", *values)
    return bytes([len(packed)]) + packed


def _write_one(function: int, body: bytes, cells: RegisterCells) -> bytes:
    address, value = _two_words(body)
    if function == 6:
        cells.write("holding", address, [value])
    elif value in (_ON, _OFF):
        cells.write("coil", address, [int(value == _ON)])
    else:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    return body


def _write_many(function: int, body: bytes, cells: RegisterCells) -> bytes:
    address, count = _two_words(body[:4])
    packed = body[5:]
    table, most, size = ("coil", 1968, (count + 7) // 8) if function == 15 else ("holding", 123, 2 * count)
    if not 1 <= count <= most or body[4:5] != bytes([size]) or len(packed) != size:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    if function == 15:
        whole = int.from_bytes(packed, "little")
        values = [whole >> i & 1 for i in range(count)]
    else:
        values = list(struct.unpack(f">{count}H", packed))
    cells.write(table, address, values)
    return body[:4]


def _mask_write(body: bytes, cells: RegisterCells) -> bytes:
    """Write the bits of a register that the first mask does not keep."""
    if len(body) != 6:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    address, keep, bits = struct.unpack(">HHH", body)
    (word,) = cells.read("holding", address, 1)
    cells.write("holding", address, [word & keep | bits & ~keep & 0xFFFF])
    return body


def _read_write(body: bytes, cells: RegisterCells) -> bytes:
    """Write registers, then read registers. If either is refused, nothing has changed."""
    from_, count = _two_words(body[:4])
    to, written = _two_words(body[4:8])
    size, packed = 2 * written, body[9:]
    if not (1 <= count <= 125 and 1 <= written <= 121) or body[8:9] != bytes([size]) or len(packed) != size:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    cells.read("holding", from_, count)
    cells.write("holding", to, struct.unpack(f">{written}H", packed))
    return bytes([2 * count]) + struct.pack(f">{count}H", *cells.read("holding", from_, count))


def _two_words(body: bytes) -> tuple[int, int]:
    if len(body) != 4:
        raise ExceptionAnswer(ILLEGAL_VALUE)
    return body[0] << 8 | body[1], body[2] << 8 | body[3]


def _pack_bits(values: Sequence[int]) -> bytes:
    packed = sum(value << i for i, value in enumerate(values))
    return packed.to_bytes((len(values) + 7) // 8, "little")


class Connection(asyncio.Protocol):
    """The connection of one client. `handle` answers the requests, regardless of the unit; `peers` has the open
    connections. Each turn of the event loop answers one request, so that a client that floods the box does not block
    other clients. While requests wait, or the client does not read its answers, no further data are read, so that the
    amount of buffered data is limited.
    """

    def __init__(self, handle: Callable[[bytes], bytes], peers: set[asyncio.Transport]) -> None:
        self._handle = handle
        self._peers = peers
        self._buffer = bytearray()
        self._transport: asyncio.Transport | None = None
        self._next_turn: asyncio.Handle | None = None
        self._clogged = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._peers.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport is not None:
            self._peers.discard(self._transport)

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        self._turn()

    def pause_writing(self) -> None:
        self._clogged = True

    def resume_writing(self) -> None:
        self._clogged = False
        self._come_back()

    def _come_back(self) -> None:
        if self._next_turn is None:
            self._next_turn = asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        self._next_turn = None
        transport = self._transport
        if transport is None or transport.is_closing() or self._clogged:
            return
        answered = self._answer_one(transport)
        if answered and (self._buffer or self._clogged):
            transport.pause_reading()
            self._come_back()
        else:
            transport.resume_reading()

    def _answer_one(self, transport: asyncio.Transport) -> bool:
        """Answer the first request. Return False while the request is incomplete."""
        buffer = self._buffer
        if len(buffer) < _HEADER.size:
            return False
        transaction, protocol, length, unit = _HEADER.unpack_from(buffer)
        if protocol != 0 or not 2 <= length <= _MAX_LENGTH:
            transport.close()  # not Modbus, or out of step: there is no way back into step
            return False
        end = _HEADER.size - 1 + length
        if len(buffer) < end:
            return False
        reply = self._handle(bytes(buffer[_HEADER.size : end]))
        del buffer[:end]
        transport.write(_HEADER.pack(transaction, 0, len(reply) + 1, unit) + reply)
        return True

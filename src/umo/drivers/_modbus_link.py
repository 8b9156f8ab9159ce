"""One connection to one Modbus TCP device, through pymodbus; imported only when a device is opened.

pymodbus builds and takes apart the frames and matches transaction numbers. What it does with time is not
what a sampling period needs (a timeout for each wait, of which one call may have several), so the
methods that touch the socket are replaced here: everything in a call ends by one deadline.
"""

from __future__ import annotations

import logging
import math
import select
import socket
import struct
from collections.abc import Sequence
from time import monotonic
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from umo.drivers._modbus_plan import COIL, DISCRETE, HOLDING, INPUT, Request
from umo.errors import DriverError

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target failed to respond",
}
READ_FUNCTION = {COIL: 1, DISCRETE: 2, HOLDING: 3, INPUT: 4}
WRITE_ONE = {COIL: 5, HOLDING: 6}
WRITE_MANY = {COIL: 15, HOLDING: 16}


class _Lost(Exception):
    """The connection is of no more use; says why. Not a TimeoutError, as pymodbus swallows those."""


_FAILED = (_Lost, ModbusException, ValueError, IndexError, struct.error)
"""All that a request may raise: some versions of pymodbus let their decoders' own errors through."""


class _Client(ModbusTcpClient):
    """pymodbus's client with one deadline in place of a timeout for each wait."""

    def __init__(self, host: str, port: int) -> None:
        # No retries, and no time limit of pymodbus's own: the deadline below is the only one.
        super().__init__(host, port=port, retries=0, timeout=math.inf)
        self.deadline = 0.0
        self._addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        self._idle = select.poll()

    def left(self) -> float:
        """Seconds until the deadline."""
        left = self.deadline - monotonic()
        if left <= 0:
            raise _Lost("timed out")
        return left

    def connect(self) -> bool:
        if self.socket is None:
            self.socket = self._dial()
            self._idle = select.poll()
            self._idle.register(self.socket, select.POLLIN)
        return True

    def close(self) -> None:
        if self.socket is not None:
            self.socket.close()
        self.socket = None

    def clean(self) -> bool:
        """Nothing has come in unasked: neither the device's goodbye nor an answer nobody waits for."""
        return not self._idle.poll(0)

    def _dial(self) -> socket.socket:
        error = OSError("no address")
        for family, kind, protocol, _, address in self._addresses:
            connection = socket.socket(family, kind, protocol)
            try:
                connection.settimeout(self.left())
                connection.connect(address)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            except TimeoutError:
                connection.close()
                raise _Lost("timed out") from None
            except OSError as failed:
                connection.close()
                error = failed
            else:
                return connection
        raise _Lost(_plain(error))

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        assert self.socket is not None
        try:
            self.socket.settimeout(self.left())
            self.socket.sendall(request)
        except TimeoutError:
            raise _Lost("timed out") from None
        except OSError as error:
            raise _Lost(_plain(error)) from None
        return len(request)

    def recv(self, size: int | None) -> bytes:
        assert self.socket is not None
        try:
            self.socket.settimeout(self.left())
            data = self.socket.recv(4096)
        except TimeoutError:
            raise _Lost("timed out") from None
        except OSError as error:
            raise _Lost(_plain(error)) from None
        if not data:
            raise _Lost("the device closed the connection")
        return data


class Link:
    """The connection to one unit; after any failure but an exception answer it is closed, and the next
    call opens it again. So an answer that comes late finds nobody: it is never taken for a later one."""

    def __init__(self, host: str, port: int, unit: int) -> None:
        _be_quiet()
        self._unit = unit
        self._name = f"Modbus {host}:{port} unit {unit}"
        self._timeout = 0.0
        try:
            client = _Client(host, port)
        except OSError as error:
            raise DriverError(f"{self._name}: {_plain(error)}") from None
        except UnicodeError:
            raise DriverError(f"{self._name}: not the name of a host") from None
        self._client = client
        self._readers = {
            COIL: client.read_coils,
            DISCRETE: client.read_discrete_inputs,
            HOLDING: client.read_holding_registers,
            INPUT: client.read_input_registers,
        }

    def begin(self, timeout: float) -> None:
        """Begin one call of the driver: connected, nothing left over, all of it to end within `timeout` s."""
        client = self._client
        client.deadline = monotonic() + timeout
        self._timeout = timeout
        if client.socket is not None and not client.clean():
            client.close()
        try:
            client.connect()
        except _Lost as lost:
            raise self._failed("connecting", str(lost)) from None

    def close(self) -> None:
        self._client.close()

    def read(self, request: Request) -> Sequence[int]:
        """The cells of the answer, as many as were asked for."""
        try:
            answer = self._readers[request.table](request.address, count=request.count, device_id=self._unit)
        except _FAILED as error:
            raise self._broken(request, f"reading {request.what}", error) from None
        self._check(answer, READ_FUNCTION[request.table], f"reading {request.what}")
        bitwise = request.table is COIL or request.table is DISCRETE
        cells = answer.bits if bitwise else answer.registers
        if len(cells) != ((request.count + 7) // 8 * 8 if bitwise else request.count):
            raise self._unfit(f"reading {request.what}", f"a short answer ({len(cells)} of {request.count})")
        return cells

    def write(self, request: Request, cells: list[int]) -> None:
        """Write; the device must confirm what it was sent."""
        what = f"writing {request.what}"
        function = (WRITE_ONE if request.count == 1 else WRITE_MANY)[request.table]
        try:
            answer = self._write(function, request.address, cells)
        except _FAILED as error:
            raise self._broken(request, what, error) from None
        self._check(answer, function, what)
        taken = {5: answer.bits, 6: answer.registers}.get(function, answer.count)
        if answer.address != request.address or taken != (cells if request.count == 1 else request.count):
            raise self._unfit(what, f"the answer confirms something else (address {answer.address}, {taken})")

    def _write(self, function: int, address: int, cells: list[int]) -> ModbusPDU:
        client, unit = self._client, self._unit
        if function == 5:
            return client.write_coil(address, bool(cells[0]), device_id=unit)
        if function == 6:
            return client.write_register(address, cells[0], device_id=unit)
        if function == 15:
            return client.write_coils(address, [bool(cell) for cell in cells], device_id=unit)
        return client.write_registers(address, cells, device_id=unit)

    def _check(self, answer: ModbusPDU, function: int, what: str) -> None:
        if answer.function_code == function:
            return
        if answer.function_code == function | 0x80:
            code = answer.exception_code
            raise self._failed(what, f"exception {code}, {EXCEPTIONS.get(code, 'of an unknown kind')}")
        raise self._unfit(what, f"an answer to function {answer.function_code & 0x7F} in place of {function}")

    def _broken(self, request: Request, what: str, error: Exception) -> DriverError:
        return self._unfit(what, str(error) if isinstance(error, _Lost) else "a short or malformed answer")

    def _unfit(self, what: str, why: str) -> DriverError:
        """A failure after which the connection cannot be trusted."""
        self._client.close()
        return self._failed(what, why)

    def _failed(self, what: str, why: str) -> DriverError:
        if why == "timed out":
            why = f"timed out ({self._timeout * 1000:g} ms)"
        return DriverError(f"{self._name}: {what}: {why}")


def _plain(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def _be_quiet() -> None:
    """pymodbus logs each failure, formatted, inside the period; a level that the user set is left alone."""
    logger = logging.getLogger("pymodbus")
    if logger.level == logging.NOTSET:
        logger.setLevel(logging.CRITICAL)

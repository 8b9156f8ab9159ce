"""One connection to one Modbus TCP device, through pymodbus; imported only when a device is opened.

pymodbus builds the requests and decodes the answers. What lies between is here: its own transactions wait for a
time each, of which one call may have several, and pass over what is wrong. Here everything in a call ends by one
deadline, and nothing is decoded that does not answer the request in everything.
"""

from __future__ import annotations

import logging
import select
import socket
from collections.abc import Sequence
from time import monotonic

from pymodbus.client import ModbusTcpClient
from pymodbus.pdu import ModbusPDU

from umo.drivers._modbus_answer import BODY, Lost, Refused, TimedOut, answers, frame_end, wrong_transaction
from umo.drivers._modbus_plan import COIL, DISCRETE, HOLDING, INPUT, Request
from umo.errors import DeviceTimeout, DriverError

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


class _Client(ModbusTcpClient):
    """pymodbus's client over a connection of our own; every method but `close` raises Lost."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port=port)
        self.deadline = 0.0
        self._addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        self._idle = select.poll()
        self._transaction = 0
        self._data = b""

    def left(self) -> float:
        """Seconds until the deadline."""
        left = self.deadline - monotonic()
        if left <= 0:
            raise TimedOut
        return left

    def connect(self) -> bool:
        if self.socket is None:
            self.socket = self._dial()
            self._idle = select.poll()
            self._idle.register(self.socket, select.POLLIN)
            self._data = b""
        return True

    def close(self) -> None:
        if self.socket is not None:
            self.socket.close()
        self.socket = None

    def clean(self) -> bool:
        """Nothing has come in unasked: neither the device's goodbye nor an answer nobody waits for."""
        return not self._data and not self._idle.poll(0)

    def _dial(self) -> socket.socket:
        error = OSError("no address")
        for family, kind, protocol, _, address in self._addresses:
            connection = socket.socket(family, kind, protocol)
            try:
                connection.settimeout(self.left())
                connection.connect(address)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            except (TimeoutError, TimedOut):
                connection.close()
                raise TimedOut from None
            except OSError as failed:
                connection.close()
                error = failed
            else:
                return connection
        raise Lost(_plain(error))

    def execute(self, no_response_expected: bool, request: ModbusPDU) -> ModbusPDU:
        """Send the request; its answer, which may be an exception answer."""
        self._transaction = request.transaction_id = self._transaction % 65535 + 1
        frame = self.framer.buildFrame(request)
        self._send(frame)
        answer = self.framer.decoder.decode(self._answer(frame)[BODY:])
        if answer is None:
            raise Lost("a malformed answer")
        return answer

    def _send(self, frame: bytes) -> None:
        assert self.socket is not None
        try:
            self.socket.settimeout(self.left())
            self.socket.sendall(frame)
        except TimeoutError:
            raise TimedOut from None
        except OSError as error:
            raise Lost(_plain(error)) from None

    def _answer(self, request: bytes) -> bytes:
        """The frame that answers the request; one that answers an earlier request is passed over."""
        passed_over = ""
        while True:
            while not (end := frame_end(self._data)):
                self._data += self._take(passed_over)
            frame, self._data = self._data[:end], self._data[end:]
            if answers(request, frame):
                return frame
            passed_over = wrong_transaction(request, frame)

    def _take(self, passed_over: str) -> bytes:
        assert self.socket is not None
        try:
            self.socket.settimeout(self.left())
            data = self.socket.recv(4096)
        except (TimeoutError, TimedOut):
            raise TimedOut(passed_over) from None
        except OSError as error:
            raise Lost(_plain(error)) from None
        if not data:
            raise Lost("the device closed the connection")
        return data


class Link:
    """The connection to one unit; after any failure but an exception answer it is closed, and the next
    call opens it again. So an answer that comes late finds nobody: it is never taken for a later one."""

    def __init__(self, host: str, port: int, unit: int) -> None:
        _be_quiet()
        self._unit = unit
        self._name = f"unit {unit}"
        self._timeout = 0.0
        try:
            client = _Client(host, port)
        except OSError as error:
            raise DriverError(f"{host}:{port}: {_plain(error)}") from None
        except UnicodeError:
            raise DriverError(f"{host!r} is not the name of a host") from None
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
        except Lost as lost:
            raise self._broken("connecting", lost) from None

    def close(self) -> None:
        self._client.close()

    def read(self, request: Request) -> Sequence[int]:
        """The cells of the answer, at least as many as were asked for."""
        try:
            answer = self._readers[request.table](request.address, count=request.count, device_id=self._unit)
        except Lost as error:
            raise self._broken(f"reading {request.what}", error) from None
        if answer.isError():
            raise self._refused(f"reading {request.what}", answer.exception_code)
        return answer.bits or answer.registers

    def write(self, request: Request, cells: list[int]) -> None:
        """Write; the device must confirm what it was sent."""
        try:
            answer = self._write(request, cells)
        except Lost as error:
            raise self._broken(f"writing {request.what}", error) from None
        if answer.isError():
            raise self._refused(f"writing {request.what}", answer.exception_code)

    def _write(self, request: Request, cells: list[int]) -> ModbusPDU:
        """By function 5 or 6, by 15 or 16 where there is more than one cell."""
        client, unit, address = self._client, self._unit, request.address
        if request.table is COIL:
            bits = [bool(cell) for cell in cells]
            if request.count == 1:
                return client.write_coil(address, bits[0], device_id=unit)
            return client.write_coils(address, bits, device_id=unit)
        if request.count == 1:
            return client.write_register(address, cells[0], device_id=unit)
        return client.write_registers(address, cells, device_id=unit)

    def _refused(self, what: str, code: int) -> DriverError:
        """An exception answer; the connection stays as it is."""
        return Refused(f"{self._name}: {what}: exception {code}, {EXCEPTIONS.get(code, 'of an unknown kind')}")

    def _broken(self, what: str, error: Lost) -> DriverError:
        """A failure after which the connection cannot be trusted."""
        self._client.close()
        if not isinstance(error, TimedOut):
            return DriverError(f"{self._name}: {what}: {error}")
        limit, instead = f"{self._timeout * 1000:g} ms", str(error)
        why = f"{instead}, and no other within {limit}" if instead else f"timed out ({limit})"
        return DeviceTimeout(f"{self._name}: {what}: {why}")


def _plain(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def _be_quiet() -> None:
    """pymodbus logs each failure, formatted, inside the period; a level that the user set is left alone."""
    logger = logging.getLogger("pymodbus")
    if logger.level == logging.NOTSET:
        logger.setLevel(logging.CRITICAL)

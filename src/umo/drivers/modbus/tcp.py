"""A connection to a Modbus TCP device. Frames: transaction, protocol (0), length of what follows, unit, function, data
(Modbus Messaging on TCP/IP Implementation Guide V1.0b).
"""

from __future__ import annotations

import select
import socket
import struct
from time import monotonic

from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU

from umo.drivers.modbus.answer import Lost, TimedOut, check
from umo.drivers.modbus.place import Host
from umo.errors import DriverError

_HEADER = struct.Struct(">HHH")
_SHORTEST, _LONGEST = 2, 254  # what may follow the header: unit, function and up to 252 bytes of data


class Tcp:
    """A connection of one driver. Every method but `close` raises Lost, after which it is to be closed."""

    def __init__(self, place: Host) -> None:
        self.framer = FramerSocket(DecodePDU(False))
        self.deadline = 0.0
        self._addresses = _resolved(place)
        self._socket: socket.socket | None = None
        self._idle = select.poll()
        self._transaction = 0
        self._data = b""

    def begin(self, deadline: float) -> bool:
        """Connected, nothing left over; everything until the next `begin` ends by this time. True if the connection is
        a new one."""
        self.deadline = deadline
        if self._socket is not None and not self._clean():
            self.close()
        if self._socket is not None:
            return False
        self._socket = self._dial()
        self._idle = select.poll()
        self._idle.register(self._socket, select.POLLIN)
        self._data = b""
        return True

    def recover(self, deadline: float) -> None:
        """A new connection has nothing to recover from."""

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def open(self, deadline: float) -> None:
        self.begin(deadline)

    def failed(self, error: Lost) -> None:
        """What comes late finds nobody: it is never taken for a later answer."""
        self.close()

    def exchange(self, request: ModbusPDU) -> bytes:
        """Send the request; unit, function and data of its answer, which may be an exception answer."""
        self._transaction = request.transaction_id = self._transaction % 65535 + 1
        frame = self.framer.buildFrame(request)
        self._send(frame)
        answer = self._answer()
        check(frame[_HEADER.size :], answer)
        return answer

    def _clean(self) -> bool:
        """Nothing has come in unasked: neither the device's goodbye nor an answer nobody waits for."""
        return not self._data and not self._idle.poll(0)

    def _left(self) -> float:
        """Seconds until the deadline."""
        left = self.deadline - monotonic()
        if left <= 0:
            raise TimedOut
        return left

    def _dial(self) -> socket.socket:
        error = OSError("no address")
        for family, kind, protocol, _, address in self._addresses:
            connection = socket.socket(family, kind, protocol)
            try:
                connection.settimeout(self._left())
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

    def _send(self, frame: bytes) -> None:
        assert self._socket is not None
        try:
            self._socket.settimeout(self._left())
            self._socket.sendall(frame)
        except TimeoutError:
            raise TimedOut from None
        except OSError as error:
            raise Lost(_plain(error)) from None

    def _answer(self) -> bytes:
        """What follows the header of the frame with this transaction's number; those before it are passed over."""
        passed_over = ""
        while True:
            while not (end := frame_end(self._data)):
                self._data += self._take(passed_over)
            frame, self._data = self._data[:end], self._data[end:]
            given = int.from_bytes(frame[:2], "big")
            if given == self._transaction:
                return frame[_HEADER.size :]
            wrong = f"an answer to transaction {given} in place of {self._transaction}"
            if not 0 < given < self._transaction:
                raise Lost(wrong)
            passed_over = f"{wrong}, and no other"

    def _take(self, passed_over: str) -> bytes:
        assert self._socket is not None
        try:
            self._socket.settimeout(self._left())
            data = self._socket.recv(4096)
        except (TimeoutError, TimedOut):
            raise TimedOut(passed_over) from None
        except OSError as error:
            raise Lost(_plain(error)) from None
        if not data:
            raise Lost("the device closed the connection")
        return data


def frame_end(data: bytes) -> int:
    """Where the first frame of the data ends, 0 while it is incomplete; Lost if the data is not Modbus."""
    if len(data) < _HEADER.size:
        return 0
    _, protocol, length = _HEADER.unpack_from(data)
    if protocol or not _SHORTEST <= length <= _LONGEST:
        raise Lost("the received data is not Modbus")
    end = _HEADER.size + length
    return end if len(data) >= end else 0


def _resolved(place: Host) -> list[tuple[socket.AddressFamily, socket.SocketKind, int, str, tuple[object, ...]]]:
    try:
        return socket.getaddrinfo(place.host, place.port, type=socket.SOCK_STREAM)  # type: ignore[return-value]
    except OSError as error:
        raise DriverError(f"{place.host}:{place.port}: {_plain(error)}") from None
    except UnicodeError:
        raise DriverError(f"{place.host!r} is not the name of a host") from None


def _plain(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]

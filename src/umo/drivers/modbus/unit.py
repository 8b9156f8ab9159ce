"""The requests to one unit, through pymodbus. This module is imported only when a driver is made.

pymodbus builds the requests. umo sends and receives (tcp.py, rtu.py): in pymodbus each transaction has a timeout,
although a call may need several transactions, and wrong answers are skipped. Here all requests of a call share one
deadline, and an answer counts only if it fits its request in every part (answer.py). Then the values of the answer are
at known places, and no decoder is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import monotonic, sleep
from typing import TypeVar

from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.pdu import ModbusPDU

from umo.drivers.modbus.answer import Recovering, Refused, cells_of
from umo.drivers.modbus.channel import COIL, DISCRETE, HOLDING, INPUT, Table
from umo.drivers.modbus.plan import Request
from umo.drivers.modbus.rtu import Rtu
from umo.drivers.modbus.tcp import Tcp
from umo.drivers.streams import Host, Lost, Place, TimedOut
from umo.duration import duration
from umo.errors import DeviceTimeout, DriverError

T = TypeVar("T")
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


class _Client(ModbusClientMixin[bytes]):
    """The requests of pymodbus, sent over a transport of umo. Every method returns unit, function and data of the
    answer, which may be an exception answer. Every method may raise Lost."""

    def __init__(self, transport: Tcp | Rtu, pause: float) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._transport, self._pause, self._free_at = transport, pause, 0.0
        self.deadline = 0.0
        """The time at which the call of the driver ends."""

    def execute(self, no_response_expected: bool, request: ModbusPDU) -> bytes:
        now = monotonic()
        if (wait := self._free_at - now) > 0:
            if now + wait > self.deadline:
                raise Recovering(f"the device takes the next request in {duration(round(wait, 3))}")
            sleep(wait)
        is_sent = True
        try:
            return self._transport.exchange(request)
        except Recovering:
            is_sent = False
            raise
        finally:
            if self._pause and is_sent:
                self._free_at = monotonic() + self._pause


class _Requests(ModbusClientMixin[ModbusPDU]):
    """The requests of pymodbus, which are built but not sent."""

    def execute(self, no_response_expected: bool, request: ModbusPDU) -> ModbusPDU:
        return request


@dataclass(frozen=True)
class UnitRules:
    """The requirements of a unit: options of the driver, times in s."""

    recovery: float
    answers_as: int | None
    pause: float
    boot_time: float
    write_multiple: bool


class Unit:
    """One unit. After any failure except an exception answer, the transport ensures that a late answer is never taken
    for the answer to a later request."""

    def __init__(self, place: Place, unit: int, rules: UnitRules) -> None:
        self._unit = unit
        self._name = f"unit {unit}"
        self._timeout = 0.0
        self._write_multiple = rules.write_multiple
        self._transport = (
            Tcp(place, rules.answers_as, rules.boot_time)
            if isinstance(place, Host)
            else Rtu(place, unit, rules.recovery)
        )
        self._client = _Client(self._transport, rules.pause)
        self._readers = _readers_of(self._client)
        self._requests = _readers_of(_Requests())  # type: ignore[no-untyped-call]

    def look(self, table: Table, address: int, count: int, timeout: float) -> bool | None:
        """Look, without waiting, whether the unit answers a request for these cells, also by an exception. Return True
        if it does, None while this is not known yet. Raises DriverError if it does not answer within `timeout` s."""
        request = self._requests[table](address, count=count, device_id=self._unit)
        self._timeout = timeout
        return self._connecting(lambda deadline: self._transport.look(request, timeout), timeout)

    def recover(self, timeout: float) -> None:
        """Wait until no answer to an earlier user of the line can come any more, for at most `timeout` s."""
        self._connecting(self._transport.recover, timeout)

    def begin(self, timeout: float) -> bool:
        """Begin one call of the driver, which must end within `timeout` s: connect if needed, and discard leftover
        data. Return True if the connection is new, so that the device may have been switched off."""
        self._timeout, self._client.deadline = timeout, monotonic() + timeout
        return self._connecting(self._transport.begin, timeout)

    def _connecting(self, call: Callable[[float], T], timeout: float) -> T:
        try:
            return call(monotonic() + timeout)
        except Lost as lost:
            raise self._broken("connecting", lost) from None

    def close(self) -> None:
        self._transport.close()

    def read(self, request: Request) -> Sequence[int]:
        """Return the cells of the answer, at least as many as requested."""
        read, unit = self._readers[request.table], self._unit
        send = partial(read, request.address, count=request.count, device_id=unit)
        return cells_of(self._answer("reading", request, send))

    def write(self, request: Request, cells: list[int]) -> None:
        """Write the cells; the device must confirm them."""
        self._answer("writing", request, lambda: self._write(request, cells))

    def write_and_read(self, request: Request, cells: list[int]) -> Sequence[int]:
        """Write registers by function 23 and return their contents afterwards."""
        address, count, ask = request.address, request.count, self._client.readwrite_registers
        send = partial(ask, read_address=address, read_count=count, write_address=address, values=cells)
        return cells_of(self._answer("writing", request, partial(send, device_id=self._unit)))

    def mask_write(self, request: Request, cells: list[int]) -> None:
        """Write the bits of the request's single register by function 22."""
        send = partial(self._client.mask_write_register, address=request.address, device_id=self._unit)
        others = ~request.masks[0] & 0xFFFF
        self._answer("writing bits of", request, lambda: send(and_mask=others, or_mask=cells[0]))

    def _answer(self, doing: str, request: Request, send: Callable[[], bytes]) -> bytes:
        """Return the answer to a request that the device has carried out. Raises DriverError otherwise."""
        try:
            answer = send()
        except Lost as error:
            raise self._broken(f"{doing} {request.what}", error) from None
        if answer[1] & 0x80:  # the connection stays as it is
            code = answer[2]
            what = f"exception {code}, {EXCEPTIONS.get(code, 'of an unknown kind')}"
            raise Refused(f"{self._name}: {doing} {request.what}: {what}")
        return answer

    def _write(self, request: Request, cells: list[int]) -> bytes:
        """Write by function 5 or 6; by 15 or 16 for more than one cell, or if the unit requires it."""
        client, unit, address = self._client, self._unit, request.address
        single = request.count == 1 and not self._write_multiple
        if request.table is COIL:
            bits = [bool(cell) for cell in cells]
            if single:
                return client.write_coil(address, bits[0], device_id=unit)
            return client.write_coils(address, bits, device_id=unit)
        if single:
            return client.write_register(address, cells[0], device_id=unit)
        return client.write_registers(address, cells, device_id=unit)

    def _broken(self, what: str, error: Lost) -> DriverError:
        """Return the error for a failure after which the connection cannot be trusted."""
        self._transport.failed(error)
        if isinstance(error, Recovering):
            return Refused(f"{self._name}: {what}: recovering: {error}")
        if not isinstance(error, TimedOut):
            return DriverError(f"{self._name}: {what}: {error}")
        limit = duration(self._timeout)
        why = f"{error} within {limit}" if str(error) else f"timed out ({limit})"
        return DeviceTimeout(f"{self._name}: {what}: {why}")


def _readers_of(client: ModbusClientMixin[T]) -> dict[Table, Callable[..., T]]:
    return {
        COIL: client.read_coils,
        DISCRETE: client.read_discrete_inputs,
        HOLDING: client.read_holding_registers,
        INPUT: client.read_input_registers,
    }

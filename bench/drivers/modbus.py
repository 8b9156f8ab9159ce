"""Modbus, on TCP and on a serial line, against a device on libmodbus; by hand: pymodbus's own client, one call for each
block of registers. The serial line is a pseudo-terminal: bytes take no time, the silence between frames does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from bench.drivers.case import Case, NotHere, cycle, split
from tests.helpers.peers.modbus_device import Missing, Peer, device
from umo.drivers.modbus import Modbus


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    try:
        yield _case("modbus, TCP", channels, stack, "", _tcp)
        yield _case("modbus, serial", channels, stack, "rtu", _line)
    except Missing as error:
        raise NotHere(str(error)) from None


Ways = Callable[[Peer], tuple[Modbus, Any]]
"""A driver and pymodbus's client for a device."""


def _case(name: str, channels: int, stack: ExitStack, place: str, ways: Ways) -> Case:
    counted = stack.enter_context(device(place or 0))
    _opened(ways(counted)[0], channels, stack)()
    transfers = len(counted.requests())
    driver, _ = ways(stack.enter_context(device(f"quiet-{place}")))
    _, client = ways(stack.enter_context(device(f"quiet-{place}")))
    client.connect()
    stack.callback(client.close)
    return Case(name, "pymodbus", channels, _opened(driver, channels, stack), _hand(client, channels), transfers)


def _tcp(peer: Peer) -> tuple[Modbus, Any]:
    return Modbus(port=peer.port), ModbusTcpClient("127.0.0.1", port=peer.port)


def _line(peer: Peer) -> tuple[Modbus, Any]:
    driver = Modbus(serial=peer.path, baudrate=115200, parity="none", recovery="1 ms")
    return driver, ModbusSerialClient(peer.path, baudrate=115200)


def _opened(driver: Modbus, channels: int, stack: ExitStack) -> Callable[[], None]:
    driver.open()
    stack.callback(driver.close)
    return _cycle(driver, channels)


def _cycle(driver: Modbus, channels: int) -> Callable[[], None]:
    inputs, outputs = split(channels)
    read, written = (
        [driver.channel(f"{table}:{i}") for i in range(n)] for table, n in (("input", inputs), ("holding", outputs))
    )
    return cycle(driver, read, written)


def _hand(client: Any, channels: int) -> Callable[[], None]:
    inputs, outputs = split(channels)

    def run() -> None:
        answer = client.read_input_registers(0, count=inputs)
        if answer.isError() or len(answer.registers) != inputs:
            raise RuntimeError(str(answer))
        answer = client.write_register(0, 1) if outputs == 1 else client.write_registers(0, [1] * outputs)
        if answer.isError():
            raise RuntimeError(str(answer))

    return run

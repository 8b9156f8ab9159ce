"""Modbus TCP against a device on libmodbus; by hand: pymodbus's own client, one call for each block of registers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

from pymodbus.client import ModbusTcpClient
from tests.peers.modbus_device import Missing, device

from bench.drivers.case import Case, NotHere, cycle, split
from umo.drivers.modbus import Modbus


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    try:
        counted = stack.enter_context(device())
    except Missing as error:
        raise NotHere(str(error)) from None
    _tcp(channels, counted.port, stack)()
    transfers = len(counted.requests())
    port = stack.enter_context(device("quiet")).port
    client = ModbusTcpClient("127.0.0.1", port=port)
    client.connect()
    stack.callback(client.close)
    yield Case("modbus, TCP", "pymodbus", channels, _tcp(channels, port, stack), _hand(client, channels), transfers)


def _tcp(channels: int, port: int, stack: ExitStack) -> Callable[[], None]:
    driver = Modbus(port=port)
    stack.callback(driver.close)
    driver.open()
    return _cycle(driver, channels)


def _cycle(driver: Modbus, channels: int) -> Callable[[], None]:
    inputs, outputs = split(channels)
    read, written = (
        [driver.channel(f"{table}:{i}") for i in range(n)] for table, n in (("input", inputs), ("holding", outputs))
    )
    return cycle(driver, read, written)


def _hand(client: ModbusTcpClient, channels: int) -> Callable[[], None]:
    inputs, outputs = split(channels)

    def run() -> None:
        answer = client.read_input_registers(0, count=inputs)
        if answer.isError() or len(answer.registers) != inputs:
            raise RuntimeError(str(answer))
        answer = client.write_register(0, 1) if outputs == 1 else client.write_registers(0, [1] * outputs)
        if answer.isError():
            raise RuntimeError(str(answer))

    return run

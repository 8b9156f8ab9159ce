"""An independent Modbus server (pymodbus's) that notes when each output last came to its default.

`python -m bench.box_server FILE`: prints its port; FILE holds, for 7 coils and 1 register, two int64 each: the value
and since when it has stood at the default (ns of CLOCK_MONOTONIC; 0 while it is not).
"""

from __future__ import annotations

import asyncio
import logging
import mmap
import socket
import sys
import time
from pathlib import Path
from typing import Any

from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

COILS = 7
OUTPUTS = COILS + 1
WRITES = (5, 6, 15, 16)


class Notes:
    """Follows the requests that the server takes."""

    def __init__(self, cells: Any) -> None:
        self._cells = cells

    def __call__(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and pdu.function_code in WRITES:
            registers = pdu.function_code in (6, 16)
            values = pdu.registers if registers else pdu.bits
            for index, value in enumerate(values[: pdu.count or 1], pdu.address + (COILS if registers else 0)):
                self._note(index, int(value))
        return pdu

    def _note(self, index: int, value: int) -> None:
        at = 2 * index
        self._cells[at] = value
        if value:
            self._cells[at + 1] = 0
        elif not self._cells[at + 1]:
            self._cells[at + 1] = time.monotonic_ns()


async def serve(cells: Any) -> None:
    bits = [SimData(0, count=64, values=False, datatype=DataType.BITS)]
    words = [SimData(0, count=64, values=0, datatype=DataType.REGISTERS)]
    device = SimDevice(0, simdata=(bits, bits, words, words))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    server = ModbusTcpServer(device, address=("127.0.0.1", port), trace_pdu=Notes(cells))
    await server.listen()
    print(port, flush=True)
    await asyncio.Event().wait()


def main() -> None:
    logging.disable()
    path = Path(sys.argv[1])
    path.write_bytes(bytes(16 * OUTPUTS))
    with path.open("r+b") as file:
        cells = memoryview(mmap.mmap(file.fileno(), 16 * OUTPUTS)).cast("q")
        asyncio.run(serve(cells))


if __name__ == "__main__":
    main()

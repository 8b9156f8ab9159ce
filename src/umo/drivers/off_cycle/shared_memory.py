"""The memory in which a worker process and the control process exchange the raw integers of one driver.

Every cell has one writer. What belongs together stands in one of two banks: the writer fills the bank that is not
valid, then counts on; the last bit of the count names the valid one. A reader that sees the count unchanged afterwards
has read one whole state. The memory is anonymous: no file of it could be cut by others.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Sequence
from contextlib import suppress
from enum import IntEnum
from typing import Any

import numpy as np

from umo.drivers.contract import Channel, IntArray

NEVER = -1
"""Stamp of a value that has not come yet."""
TEXT_BYTES = 200
"""Room for the cause of a failure, bytes."""
REQUEST_BYTES, ANSWER_BYTES = 1 << 14, 1 << 17
"""Room for a request and for its answer, bytes."""
MAX_READS = 1000
"""Number of tries to read a whole bank: its writer would have to fill two between each two of them."""


class Cell(IntEnum):
    """The single cells, int64."""

    BEAT = 0
    """Worker: its last sign of life, ns on the worker's clock."""
    ARRIVED = 1
    """Worker: the count of its transfers; the last bit names the bank of the last one."""
    GENERATION = 2
    """Worker: how often it has initialised the outputs."""
    AWAY_SINCE = 3
    """Worker: ns on its clock since which the device does not answer; NEVER: it answers."""
    ANSWERED = 4
    """Worker: the number of the last request that it has answered."""
    REQUESTED = 5
    """Control process: the number of the last request."""
    POSTED = 6
    """Control process: the count of what it wants the outputs to be; the last bit names the bank."""
    CYCLIC = 7
    """Control process: whether the worker transfers by itself, at its period."""
    NOW = 8
    """Control process: the machine's time in ns, by which injected faults act; NEVER: there are none."""


class Row(IntEnum):
    """The rows of a bank of the worker's: a number for each channel."""

    RAW = 0
    """Inputs: what was read last. Outputs: what was accepted last."""
    STAMP = 1
    """Time in ns at which the transfer began that brought it; NEVER: none has."""
    ORDER = 2
    """The number of the last order that was carried out."""
    GENERATION = 3
    """How often the outputs had been initialised: the same for all channels."""


class Wanted(IntEnum):
    """The rows of a bank of the control process's: a number for each channel."""

    RAW = 0
    """Outputs: the raw integer to be sent."""
    ORDER = 1
    """The number of the last order: a call for this channel alone, carried out once."""
    CALL = 2
    """The call that the order is, an `Order`."""
    GENERATION = 3
    """The generation for which this is meant: after outputs were initialised again, nothing older is sent."""


class Order(IntEnum):
    """What an order asks for."""

    WRITE = 0
    RESET = 1
    INITIALIZE = 2


class Banks:
    """Two banks of rows and the count that names the valid one. The stores of one process must become visible to the
    other in their order: so it is on x86, and on ARM where the interpreter's own locks come between them."""

    def __init__(self, memory: IntArray, cells: IntArray, count: Cell) -> None:
        """`memory` of the shape (2, rows, channels)."""
        self._memory, self._cells, self._count = memory, cells.data, count

    @property
    def count(self) -> int:
        return int(self._cells[self._count])

    def read(self) -> tuple[int, IntArray]:
        """A copy of the valid bank, with its count."""
        for _ in range(MAX_READS):
            count = self.count
            rows = self._memory[count & 1].copy()
            if self.count == count:
                break
        return count, rows

    def post(self, rows: IntArray) -> None:
        """Make these the valid ones."""
        count = self.count + 1
        self._memory[count & 1] = rows
        self._cells[self._count] = count


class Exchange:
    """The shared memory of one driver and its channels."""

    def __init__(self, channels: Sequence[Channel], shared: bool = True) -> None:
        """`shared`: whether processes that are forked have the same memory; else each has a copy."""
        self.channels = tuple(channels)
        self.place = {channel.text: number for number, channel in enumerate(self.channels)}
        """The number of each channel, by its text."""
        count = len(self.channels)
        banks = 2 * (len(Row) + len(Wanted)) * count
        words = len(Cell) + banks
        size = 8 * words + TEXT_BYTES * (count + 1) + REQUEST_BYTES + ANSWER_BYTES
        self._memory = mmap.mmap(-1, size) if shared else bytearray(size)
        numbers = np.frombuffer(self._memory, np.int64, words)
        numbers.fill(0)
        cells, rest = numbers[: len(Cell)], numbers[len(Cell) :]
        self.cells: Any = cells.data
        self.cells[Cell.AWAY_SINCE] = self.cells[Cell.NOW] = NEVER
        split = 2 * len(Row) * count
        own, wanted = rest[:split].reshape(2, len(Row), count), rest[split:].reshape(2, len(Wanted), count)
        own[:, Row.STAMP] = NEVER
        self.arrivals = Banks(own, cells, Cell.ARRIVED)
        """Worker: the values of all channels (`Row`)."""
        self.wanted = Banks(wanted, cells, Cell.POSTED)
        """Control process: what the outputs are to be (`Wanted`)."""
        self._texts = 8 * words
        self._request = self._texts + TEXT_BYTES * (count + 1)
        self._answer = self._request + REQUEST_BYTES

    # Texts -----------------------------------------------------------------------------------------------

    def set_cause(self, channel: int, text: str) -> None:
        """Why the last call for a channel failed, by its number; -1: of the whole driver. "": it did not."""
        at = self._texts + TEXT_BYTES * (channel + 1)
        self._memory[at : at + TEXT_BYTES] = text.encode(errors="replace")[:TEXT_BYTES].ljust(TEXT_BYTES, b"\0")

    def cause(self, channel: int) -> str:
        at = self._texts + TEXT_BYTES * (channel + 1)
        return bytes(self._memory[at : at + TEXT_BYTES]).rstrip(b"\0").decode(errors="replace")

    # Requests: while nothing is controlled -----------------------------------------------------------------

    def ask(self, request: dict[str, Any]) -> int:
        """Put down a request; its number."""
        number = int(self.cells[Cell.REQUESTED]) + 1
        self._put(self._request, REQUEST_BYTES, {**request, "number": number})
        self.cells[Cell.REQUESTED] = number
        return number

    def asked(self) -> tuple[int, dict[str, Any]] | None:
        """The request that is not answered yet, with its number. None as well while one takes the place of another that
        nobody waits for any longer."""
        number = int(self.cells[Cell.REQUESTED])
        if number == self.cells[Cell.ANSWERED]:
            return None
        with suppress(ValueError):
            request = self._get(self._request, REQUEST_BYTES)
            return (number, request) if request["number"] == number else None
        return None

    def answer(self, number: int, answer: dict[str, Any]) -> None:
        self._put(self._answer, ANSWER_BYTES, answer)
        self.cells[Cell.ANSWERED] = number

    def answered(self, number: int) -> dict[str, Any] | None:
        """The answer to the request of this number; None: not yet."""
        return self._get(self._answer, ANSWER_BYTES) if self.cells[Cell.ANSWERED] == number else None

    def _put(self, at: int, room: int, content: dict[str, Any]) -> None:
        text = json.dumps(content).encode()
        if len(text) >= room:
            raise ValueError(f"{len(text)} bytes do not fit into {room}")
        self._memory[at : at + len(text) + 1] = text + b"\0"

    def _get(self, at: int, room: int) -> dict[str, Any]:
        end = self._memory.find(b"\0", at, at + room)
        content: dict[str, Any] = json.loads(self._memory[at:end])
        return content

"""The memory in which a worker process and the control process exchange the raw integers of one driver.

Every cell has one writer, and is meaningful by itself. Values that belong together are in one of two banks: the writer
fills the invalid bank, then increments the count; the last bit of the count selects the valid bank. Banks, requests and
answers have a number and a checksum, with which a reader checks that its copy is complete (`umo.system.shared_cells`).
The causes of failures are texts that only people read. A text that is read while it changes may be a mixture of two
texts. The memory is anonymous, so there is no file that another process could truncate.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Sequence
from enum import IntEnum
from math import prod
from struct import Struct
from typing import Any
from zlib import crc32

import numpy as np

from umo.drivers.contract import Channel, IntArray
from umo.system.shared_cells import SharedText

NO_TIME = -1
"""Stamp of a value that has not arrived yet."""
TEXT_BYTES = 200
"""Size in bytes for the cause of a failure."""
REQUEST_BYTES, ANSWER_BYTES = 1 << 14, 1 << 17
"""Sizes in bytes for a request and for its answer."""
MAX_READS = 10
"""The number of attempts to read a complete bank. An attempt fails only if the writer fills two banks meanwhile. If all
attempts fail, the bank that was read before remains valid."""

BANK = Struct("<qq")
BANK_HEAD = 2
"""The head of a bank: the checksum of the following data, and the count for which the bank was written."""


class Cell(IntEnum):
    """The single cells, int64."""

    BEAT = 0
    """Written by the worker: the time of its last heartbeat, in ns on the worker's clock."""
    ARRIVED = 1
    """Written by the worker: the count of its transfers. The last bit of the count selects the bank of the last
    transfer."""
    GENERATION = 2
    """Written by the worker: the number of times that it has begun to initialise the outputs."""
    AWAY_SINCE = 3
    """Written by the worker: the time in ns on its clock since which the device does not answer; NO_TIME if it
    answers."""
    ANSWERED = 4
    """Written by the worker: the number of the last request that it has answered."""
    REQUESTED = 5
    """Written by the control process: the number of the last request."""
    POSTED = 6
    """Written by the control process: the count of the values that it wants at the outputs. The last bit of the count
    selects the bank."""
    CYCLIC = 7
    """Written by the control process: 1 if the worker makes transfers by itself, at its period."""
    NOW = 8
    """Written by the control process: the machine's time in ns, by which injected faults act; NO_TIME if there are no
    faults."""
    INITIALIZED = 9
    """Written by the worker: the last generation whose outputs have all been initialised."""


class Row(IntEnum):
    """The rows of a bank that the worker writes, each with a number for each channel."""

    RAW = 0
    """For an input: the raw integer read last. For an output: the raw integer accepted last."""
    STAMP = 1
    """Time in ns at which the transfer of this value began; NO_TIME if there was none."""
    ORDER = 2
    """The number of the last order that was carried out."""
    GENERATION = 3
    """Number of initialisations of the outputs so far; the same number for all channels."""


class Wanted(IntEnum):
    """The rows of a bank that the control process writes, each with a number for each channel."""

    RAW = 0
    """Outputs: the raw integer to be sent."""
    ORDER = 1
    """The number of the last order. An order is a single call for this channel only, which is carried out once."""
    CALL = 2
    """The kind of call of the order, an `Order`."""
    GENERATION = 3
    """The generation for which the values are meant. Values for an older generation are not sent after outputs were
    initialised again."""


class Order(IntEnum):
    """The kind of an order."""

    WRITE = 0
    RESET = 1
    INITIALIZE = 2


class Banks:
    """Two banks of rows and the count that names the valid one. Each bank has the count for which it was written, and a
    checksum over this count and the rows. With the checksum a reader verifies each copy, even if stores become visible
    in another order, or if the writer was killed while it wrote."""

    def __init__(self, memory: IntArray, cells: IntArray, count: Cell, rows: IntArray) -> None:
        """`memory`: an array of `words(rows.shape)` words. The given rows become the valid ones."""
        half = len(memory) // 2
        self._banks = [memory[:half].data, memory[half:].data]
        self._cells, self._count, self._shape = cells.data, count, rows.shape
        self._new = np.empty(half, np.int64)
        """The bank that is posted next: checksum, count, rows."""
        self._fill(0, rows)
        self._last = bytes(self._banks[0])
        """The bank that was read last."""

    @staticmethod
    def words(shape: tuple[int, ...]) -> int:
        """Return the size of two banks for rows of this shape, int64."""
        return 2 * (BANK_HEAD + prod(shape))

    @property
    def count(self) -> int:
        return int(self._cells[self._count])

    def read(self) -> tuple[int, IntArray]:
        """Return a copy of the valid bank, with its count. If the new bank is not yet complete, return the last
        complete bank that this process has read."""
        for _ in range(MAX_READS):
            count = self.count
            bank = bytes(self._banks[count & 1])
            proof, number = BANK.unpack_from(bank)
            if number == count and proof == crc32(memoryview(bank)[8:]):
                self._last = bank
                break
        rows = np.frombuffer(self._last, np.int64, offset=BANK.size).reshape(self._shape).copy()
        return int(BANK.unpack_from(self._last)[1]), rows

    def post(self, rows: IntArray) -> None:
        """Make these rows the valid ones."""
        count = self.count + 1
        self._fill(count, rows)
        self._cells[self._count] = count

    def _fill(self, count: int, rows: IntArray) -> None:
        new = self._new
        new[1], new[BANK_HEAD:] = count, rows.reshape(-1)
        new[0] = crc32(new.data[1:])
        self._banks[count & 1][:] = new.data


class Exchange:
    """The shared memory of one driver and its channels."""

    def __init__(self, channels: Sequence[Channel], shared: bool = True) -> None:
        """`shared`: whether forked processes use the same memory; otherwise each has a copy."""
        self.channels = tuple(channels)
        self.place = {channel.text: number for number, channel in enumerate(self.channels)}
        """The number of each channel, by its text."""
        count = len(self.channels)
        own = np.zeros((len(Row), count), np.int64)
        own[Row.STAMP] = NO_TIME
        wanted = np.zeros((len(Wanted), count), np.int64)
        split = len(Cell) + Banks.words(own.shape)
        words = split + Banks.words(wanted.shape)
        size = 8 * words + TEXT_BYTES * (count + 1) + REQUEST_BYTES + ANSWER_BYTES
        self._memory = mmap.mmap(-1, size) if shared else bytearray(size)
        numbers = np.frombuffer(self._memory, np.int64, words)
        numbers.fill(0)
        cells = numbers[: len(Cell)]
        self.cells: Any = cells.data
        self.cells[Cell.AWAY_SINCE] = self.cells[Cell.NOW] = NO_TIME
        self.arrivals = Banks(numbers[len(Cell) : split], cells, Cell.ARRIVED, own)
        """The values of all channels (`Row`), which the worker writes."""
        self.wanted = Banks(numbers[split:], cells, Cell.POSTED, wanted)
        """The values wanted at the outputs (`Wanted`), which the control process writes."""
        self._texts = 8 * words
        requests = self._texts + TEXT_BYTES * (count + 1)
        self._request = SharedText(self._memory, requests, REQUEST_BYTES)
        self._answer = SharedText(self._memory, requests + REQUEST_BYTES, ANSWER_BYTES)

    # Texts -----------------------------------------------------------------------------------------------

    def set_cause(self, channel: int, text: str) -> None:
        """Set the cause, as text, for which the last call failed for a channel (by its number; -1 stands for the whole
        driver). "" means that the call did not fail."""
        at = self._texts + TEXT_BYTES * (channel + 1)
        self._memory[at : at + TEXT_BYTES] = text.encode(errors="replace")[:TEXT_BYTES].ljust(TEXT_BYTES, b"\0")

    def cause(self, channel: int) -> str:
        at = self._texts + TEXT_BYTES * (channel + 1)
        return bytes(self._memory[at : at + TEXT_BYTES]).rstrip(b"\0").decode(errors="replace")

    # Requests: while nothing is controlled -----------------------------------------------------------------

    def ask(self, request: dict[str, Any]) -> int:
        """Store a request, and return its number."""
        number = int(self.cells[Cell.REQUESTED]) + 1
        self._request.put(number, json.dumps(request).encode())
        self.cells[Cell.REQUESTED] = number
        return number

    def asked(self) -> tuple[int, dict[str, Any]] | None:
        """Return the request that is not answered yet, with its number. Return None also while a request replaces
        another one for which nobody waits any more."""
        number = int(self.cells[Cell.REQUESTED])
        return None if number == self.cells[Cell.ANSWERED] else _of_number(self._request, number)

    def answer(self, number: int, answer: dict[str, Any]) -> None:
        self._answer.put(number, json.dumps(answer).encode())
        self.cells[Cell.ANSWERED] = number

    def answered(self, number: int) -> dict[str, Any] | None:
        """Return the answer to the request of this number, or None if there is no answer yet."""
        found = _of_number(self._answer, number)
        return None if found is None else found[1]


def _of_number(text: SharedText, number: int) -> tuple[int, dict[str, Any]] | None:
    """Return the content that has this number, or None if it has not been stored yet or was replaced."""
    found = text.get()
    return (number, json.loads(found[1])) if found is not None and found[0] == number else None

"""A simulated circuit for objects whose circuit does not exist yet, and for tests.

The circuit stores the last writes in a history. A sensor reads the value given by `set` (default: 0). As a timer the
circuit returns immediately with 0 missed periods, so time is virtual.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from ctypes import addressof, c_int64
from typing import NamedTuple

from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.optional import MovesInC, TransferInC
from umo.drivers.transfers_in_c import of_cells


class Written(NamedTuple):
    """One write: the channel and the value."""

    channel: str
    raw: int


class Simulated(Driver, MovesInC):
    """A circuit with channels of any name, for inputs and outputs, with 63 bits and a sign.

    Options:
        history: the number of last writes that are kept. With 0 no write is kept, and the transfers can be made in C.
    """

    def __init__(self, *, history: int = 10_000) -> None:
        self._raws: dict[str, int] = {}
        self._cells: dict[str, c_int64] = {}
        """The memory that replaces `_raws` when transfers are made in C, with a cell for each channel."""
        self._history: deque[tuple[str, int]] = deque(maxlen=history)

    @property
    def history(self) -> list[Written]:
        """The last writes, oldest first (`initialize` and `reset` included)."""
        return [Written(*each) for each in self._history]

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 64, signed=True)

    def set(self, channel: str, raw: int) -> None:
        """Set the raw value that the channel reads."""
        self._put(channel, int(raw))

    def get(self, channel: str) -> int:
        """Return the raw value last written or set; default: 0."""
        return self._cells[channel].value if channel in self._cells else self._raws.get(channel, 0)

    def read(self, channel: Channel) -> int:
        return self.get(channel.text)

    def write(self, channel: Channel, raw: int) -> None:
        self._put(channel.text, raw)
        self._history.append((channel.text, raw))

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        written = [*zip([channel.text for channel in channels], raws.tolist(), strict=True)]
        self._history.extend(written)
        if self._cells:
            for text, raw in written:
                self._put(text, raw)
        else:
            self._raws.update(written)

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        get = self.get if self._cells else self._raws.get
        out[:] = [get(channel.text) or 0 for channel in channels]

    def in_c(self, channels: Sequence[Channel], write: bool) -> TransferInC | str:
        if self._history.maxlen:
            return "it keeps a history of writes: set `history = 0`"
        cells = [self._cell(channel.text) for channel in channels]
        return of_cells([*map(addressof, cells)], write, cells)

    def _put(self, channel: str, raw: int) -> None:
        if channel in self._cells:
            self._cells[channel].value = raw
        else:
            self._raws[channel] = raw

    def _cell(self, channel: str) -> c_int64:
        if channel not in self._cells:
            self._cells[channel] = c_int64(self._raws.pop(channel, 0))
        return self._cells[channel]

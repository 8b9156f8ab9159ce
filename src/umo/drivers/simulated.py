"""The simulated circuit: for objects whose circuit does not exist yet, and for tests.

It stores every write in a history. A sensor reads the value given by `set`, default: 0. As the timer it returns
at once with 0 missed periods: virtual time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from umo.drivers.contract import Channel, Direction, Driver, IntArray


@dataclass(frozen=True)
class Written:
    """One write: to which channel, what."""

    channel: str
    raw: int


class Simulated(Driver):
    """Channels of any name, input and output alike, 63 bits and a sign.

    Options:
        history: how many of the last writes are kept.
    """

    def __init__(self, *, history: int = 10_000) -> None:
        self._raws: dict[str, int] = {}
        self.history: deque[Written] = deque(maxlen=history)
        """The last writes, oldest first (`initialize` and `reset` included)."""

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 64, signed=True)

    def set(self, channel: str, raw: int) -> None:
        """Set the raw value that the channel reads."""
        self._raws[channel] = int(raw)

    def get(self, channel: str) -> int:
        """The raw value last written or set; default: 0."""
        return self._raws.get(channel, 0)

    def read(self, channel: Channel) -> int:
        return self._raws.get(channel.text, 0)

    def write(self, channel: Channel, raw: int) -> None:
        self._raws[channel.text] = raw
        self.history.append(Written(channel.text, raw))

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        get = self._raws.get
        out[:] = [get(channel.text, 0) for channel in channels]

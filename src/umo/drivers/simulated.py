"""The simulated circuit: for objects whose circuit does not exist yet, and for tests.

It stores the last writes in a history. A sensor reads the value given by `set`, default: 0. As the timer it returns
at once with 0 missed periods: virtual time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from umo.drivers.contract import Channel, Direction, Driver, IntArray


class Written(NamedTuple):
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
        self._history: deque[tuple[str, int]] = deque(maxlen=history)

    @property
    def history(self) -> list[Written]:
        """The last writes, oldest first (`initialize` and `reset` included)."""
        return [Written(*each) for each in self._history]

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
        self._history.append((channel.text, raw))

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        written = [*zip([channel.text for channel in channels], raws.tolist(), strict=True)]
        self._raws.update(written)
        self._history.extend(written)

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        get = self._raws.get
        out[:] = [get(channel.text, 0) for channel in channels]

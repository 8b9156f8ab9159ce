"""A scripted circuit: it returns given readings, raises given failures, and records every call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any, cast

from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.optional import HasWatchdog
from umo.errors import ChannelError, ChannelsFailed

Reading = Any
"""The reading of a channel: an integer, a sequence of readings (the last one stays), a callable, or an exception."""


@dataclass(frozen=True)
class Call:
    """One call of the driver: its number (from 0), its segment, and its arguments."""

    number: int
    segment: str
    """initialize, read, read_many, write, write_many, reset, finalize, open, close or watchdog."""
    channels: tuple[str, ...] = ()
    raws: tuple[Any, ...] = ()
    """The written levels, the default of initialize and reset (None for a sensor), or the time of the watchdog in s."""


class Scripted(Driver, HasWatchdog):
    """A driver for tests.

        box = Scripted({"encoder": [0, 10, 20], "switch": lambda: 1, "scale": OSError("unplugged")})
        box.at(7, OSError("cut"))     # call number 7 raises
        box.at(8, 2.5)                # call 8, a read, returns a wrong value
        box.at(9, lambda call: ...)   # call 9 calls back first
        box.broken = OSError("dead")  # every call raises this until it is None again

    A channel without a script reads what was last written or `set`, or 0 before that. `calls` lists every call in
    order, including the failed ones. Without `channels` every name is a channel of 64 bits with a sign, for reading and
    writing.
    """

    def __init__(self, script: Mapping[str, Reading] | None = None, channels: Iterable[Channel] = ()) -> None:
        self.calls: list[Call] = []
        self.broken: BaseException | type[BaseException] | None = None
        self._channels = {channel.text: channel for channel in channels}
        self._raws: dict[str, Any] = {}
        self._scripts: dict[str, Iterator[Any]] = {}
        self._actions: dict[int, Any] = {}
        for text, reading in (script or {}).items():
            self.set(text, reading)

    # What a test says and asks -----------------------------------------------------------------------

    def at(self, number: int, action: Any) -> None:
        """Set what the call with this number does. Calls are numbered from 0; the next one is `len(box.calls)`. An
        exception is raised, a callable is called with the Call, and any other value is read. The result of a callable
        is the value that is read, unless it is None."""
        self._actions[number] = action

    def set(self, channel: str, reading: Reading) -> None:
        """Set the reading of the channel from now on."""
        if isinstance(reading, Sequence) and not isinstance(reading, str | bytes):
            if not reading:
                raise ValueError(f"the script of {channel!r} is empty")
            self._scripts[channel] = chain(reading, repeat(reading[-1]))
        else:
            self._scripts[channel] = repeat(reading)

    def get(self, channel: str) -> Any:
        """Return the level that was last written to the channel, or 0 before the first write."""
        return self._raws.get(channel, 0)

    def segments(self, *segments: str) -> list[Call]:
        """Return the calls of these segments, in order."""
        return [call for call in self.calls if call.segment in segments]

    # The driver --------------------------------------------------------------------------------------

    def channel(self, text: str) -> Channel:
        if not self._channels:
            return Channel(text, Direction.BOTH, 64, signed=True)
        if text not in self._channels:
            raise ChannelError(text, self._channels)
        return self._channels[text]

    def open(self) -> None:
        self._call("open")

    def close(self) -> None:
        self._call("close")

    def watchdog(self, seconds: float) -> None:
        self._call("watchdog", (), (seconds,))

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._call("initialize", (channel,), (default,))
        self._keep((channel,), (default,))

    def reset(self, channel: Channel, default: int | None) -> None:
        self._call("reset", (channel,), (default,))
        self._keep((channel,), (default,))

    def finalize(self, channel: Channel) -> None:
        self._call("finalize", (channel,))

    def read(self, channel: Channel) -> int:
        replaced = self._call("read", (channel,))
        return self._reading(channel, replaced)  # type: ignore[no-any-return]  # garbage on purpose

    def write(self, channel: Channel, raw: int) -> None:
        self._call("write", (channel,), (raw,))
        self._keep((channel,), (raw,))

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        replaced = self._call("read_many", channels)
        failed: dict[str, Exception | str] = {}
        for i, channel in enumerate(channels):
            try:
                out[i] = self._reading(channel, replaced)
            except ChannelsFailed as error:  # the others are read, as the contract says
                failed |= error.causes
        if failed:
            raise ChannelsFailed(failed)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        self._call("write_many", channels, tuple(raws.tolist()))
        self._keep(channels, raws.tolist())

    # Inside ------------------------------------------------------------------------------------------

    def _call(self, segment: str, channels: Sequence[Channel] = (), raws: tuple[Any, ...] = ()) -> Any:
        """Record the call and carry out its script. Return the scripted reading, or None."""
        call = Call(len(self.calls), segment, tuple(channel.text for channel in channels), raws)
        self.calls.append(call)
        action = self._actions.pop(call.number, None)
        error = self.broken if action is None else action
        if _raises(error):
            raise cast(BaseException, error)
        return action(call) if callable(action) else action

    def _reading(self, channel: Channel, replaced: Any) -> Any:
        if replaced is not None:
            return replaced
        script = self._scripts.get(channel.text)
        reading = self._raws.get(channel.text, 0) if script is None else next(script)
        if _raises(reading):
            raise reading
        return reading() if isinstance(reading, Callable) else reading  # type: ignore[arg-type]

    def _keep(self, channels: Sequence[Channel], raws: Sequence[int | None]) -> None:
        self._raws.update((c.text, raw) for c, raw in zip(channels, raws, strict=True) if raw is not None)


def _raises(thing: Any) -> bool:
    return isinstance(thing, BaseException) or (isinstance(thing, type) and issubclass(thing, BaseException))

"""Driver of another station's values: what it publishes in its frames, read only.

    [wire]
    force = { driver = "station:press", channel = "ram.force:0.1" }

A part that computes for longer than a fast period allows is a station of its own; this way its values come back. It is
off the cycle: a worker process looks at the frames, and no period waits. Every value has the age that it has there, so
one that the other station no longer renews grows old, whatever has happened to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from time import monotonic, monotonic_ns
from typing import Any

from umo.drivers.contract import Channel, Direction, Driver, IntArray, PhysicalScale
from umo.errors import ChannelError, ChannelsFailed, DriverError, FramesError, text_of
from umo.frames import Reader
from umo.objects import Quality
from umo.remote.search import find_running

NUMBER_BITS = 48
"""Bits of the raw integer of a number, with its sign: times its scale and divided by it, each comes back."""
SEARCH_INTERVAL = 0.2
"""Time in s from one search for the station to the next."""
DEFAULT_PERIOD = "5 ms"
"""Time from one look at the frames to the next, where the wiring does not say."""
READABLE = (Quality.GOOD, Quality.OUT_OF_RANGE, Quality.UNREFERENCED)
"""Qualities of a value that was read in its period. Any other is older than its frame."""


@dataclass(frozen=True)
class Published(Channel):
    """A path of the other station. `scale`: the value of one bit; None: it has two states."""

    path: str = ""
    scale: float | None = None


class StationDriver(Driver[Published]):
    """`station`: the other station as `umo watch` takes it: its name, its folder or the pid of its run."""

    forms = ("PATH (of an object with two states)", "PATH:SCALE (of a number; SCALE: the value of one bit)")
    only_off_cycle = True

    def __init__(self, *, station: str) -> None:
        self._station = station
        self._reader: Reader | None = None
        self._search_at = 0.0
        self._cause = ""
        self._places: dict[str, tuple[str, int, float]] = {}
        """Column, place in it, and age in s that a value may have in a frame, by path."""
        self._ages: list[float] = []

    @classmethod
    def table(cls, text: str) -> Mapping[str, Any]:
        """`driver = "station:press"`."""
        return {"station": text, "off_cycle": True, "period": DEFAULT_PERIOD}

    def channel(self, text: str) -> Published:
        path, colon, number = text.rpartition(":")
        if not colon:
            return Published(text, Direction.INPUT, 1, path=text)
        try:
            scale = float(number)
        except ValueError:
            scale = 0.0
        if not path or not isfinite(scale) or not scale:
            raise ChannelError(text, list(self.forms))
        return Published(text, Direction.INPUT, NUMBER_BITS, signed=True, path=path, scale=scale)

    def physical_scale(self, channel: Published) -> PhysicalScale | None:
        """As the running station declares it; None while it does not run."""
        reader = self._found()
        if reader is None or channel.scale is None:
            return None
        known = [*reader.layout.objects, *reader.layout.signals]
        units = next((each.get("unit") for each in known if each["path"] == channel.path), None)
        return None if units is None else PhysicalScale(channel.scale, 0.0, units)

    def open(self) -> None:
        """The station may come later."""

    def close(self) -> None:
        self._let_go()

    def look(self) -> bool | None:
        return self._found() is not None

    def read(self, channel: Published) -> int:
        return self._raw(channel, self._frame())[0]

    def read_many(self, channels: Sequence[Published], out: IntArray) -> None:
        frame, failed = self._frame(), {}
        self._ages = [0.0] * len(channels)
        for number, channel in enumerate(channels):
            try:
                out[number], self._ages[number] = self._raw(channel, frame)
            except DriverError as error:
                failed[channel.text] = str(error)
        if failed:
            raise ChannelsFailed(failed)

    def ages(self, channels: Sequence[Published]) -> Sequence[float]:
        return self._ages

    def write(self, channel: Published, raw: int) -> None:
        raise DriverError("the values of another station are read only")

    # The other station ---------------------------------------------------------------------------------

    def _found(self) -> Reader | None:
        """Its frames; None while it does not run."""
        if self._reader is not None and self._reader.alive:
            return self._reader
        now = monotonic()
        if now >= self._search_at:
            self._let_go()
            self._search_at = now + SEARCH_INTERVAL
            try:
                self._reader = find_running(self._station)
                self._places = _places(self._reader)
            except FramesError as error:
                self._cause = text_of(error)
        return self._reader

    def _let_go(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _frame(self) -> Any:
        reader = self._found()
        if reader is None:
            raise DriverError(self._cause or f"{self._station!r} is not running")
        frame = reader.latest()
        if frame is None:
            raise DriverError(f"{self._station} has not finished a period yet")
        return frame

    def _raw(self, channel: Published, frame: Any) -> tuple[int, float]:
        """The raw integer of a value, and its age in s."""
        if channel.path not in self._places:
            raise DriverError(f"{self._station} has no {channel.path}")
        column, place, held = self._places[channel.path]
        value = float(frame[column][place])
        if column == "values" and (quality := Quality(int(frame["quality"][place]))) not in READABLE:
            raise DriverError(f"{channel.path} of {self._station} is {quality.name}")
        if not isfinite(value):
            raise DriverError(f"{channel.path} of {self._station} has no value")
        raw = round(value / (channel.scale or 1.0))
        if not channel.lowest <= raw <= channel.highest:
            raise DriverError(
                f"{channel.path} of {self._station} is {value:g}, which channel {channel.text} cannot hold"
            )
        return raw, (monotonic_ns() - int(frame["began"])) * 1e-9 + held


def _places(reader: Reader) -> dict[str, tuple[str, int, float]]:
    """Where each path stands in a frame. In a part with a rate of its own a value may be a period of that old."""
    period = float(reader.about["period"])
    rates = {each["path"]: (each["every"] - 1) * period for each in reader.about.get("rates", ())}

    def held(path: str) -> float:
        names = path.split(".")
        around = (".".join(names[:count]) for count in range(len(names), 0, -1))
        return next((rates[each] for each in around if each in rates), 0.0)

    layout = reader.layout
    found = {each["path"]: ("signals", n, held(each["path"])) for n, each in enumerate(layout.signals)}
    return found | {each["path"]: ("values", n, held(each["path"])) for n, each in enumerate(layout.objects)}

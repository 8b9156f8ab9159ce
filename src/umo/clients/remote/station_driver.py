"""A driver whose channels are the values that another station publishes in its frames. They are read-only.

    [wire]
    force = { driver = "station:press", channel = "ram.force:0.1" }

A part that computes for longer than a fast period allows becomes a separate station, and this driver brings its values
back. The driver is off the cycle: a worker process looks at the frames, and no period waits. The age of a value is the
age of its period in the other station, so a value becomes old if the other station no longer renews it, for whatever
reason. (A value that the other station itself reads off the cycle may be older by the `max_age` that its wiring
allows.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from time import monotonic, monotonic_ns
from typing import Any, NamedTuple

from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.optional import HasShortForm, KnowsAges, KnowsScale, Looks, PhysicalScale
from umo.errors import ChannelError, ChannelsFailed, DriverError, FramesError, text_of
from umo.objects import Quality
from umo.objects.presentation.described import Described
from umo.process.frames import Reader, RunReader
from umo.process.frames.search import find_running
from umo.text import did_you_mean

NUMBER_BITS = 48
"""Number of bits, including the sign, of the raw integer of a number. Each such integer is unchanged after it is
multiplied by its scale and divided by it again."""
SEARCH_INTERVAL = 0.2
"""Time in s from one search for the station to the next."""
DEFAULT_PERIOD, DEFAULT_MAX_AGE = "5 ms", "500 ms"
"""Default time from one look at the frames to the next, and default largest age of a value, for the short form of the
wiring."""
READABLE = (Quality.GOOD, Quality.OUT_OF_RANGE)
"""The qualities with which a value is read. A value of another quality is older than its frame, or has no meaning
yet."""


@dataclass(frozen=True)
class Published(Channel):
    """A path of the other station. `scale`: the value of one bit, or None if the object has two states."""

    path: str = ""
    scale: float | None = None


class StationDriver(Driver[Published], Looks, KnowsAges, KnowsScale, HasShortForm):
    """Reads another station. `station`: the other station's name, its folder or the pid of its run, as for `umo show
    values`."""

    forms = ("PATH (of an object with two states)", "PATH:SCALE (of a number; SCALE: the value of one bit)")
    only_off_cycle = True

    def __init__(self, *, station: str) -> None:
        self._station = station
        self._reader: Reader | None = None
        self._search_at = 0.0
        self._cause = ""
        self._places: dict[str, _Place] = {}
        """The place of each value in a frame, by path."""
        self._ages: list[float] = []

    @classmethod
    def table(cls, text: str) -> Mapping[str, Any]:
        """Return the driver's table for the short form `driver = "station:press"`."""
        return {"station": text, "off_cycle": True, "period": DEFAULT_PERIOD, "max_age": DEFAULT_MAX_AGE}

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
        """Return the scale that the running station declares, or None while it does not run."""
        reader = self._found()
        if reader is None or channel.scale is None:
            return None
        known = reader.layout.described.traced
        found = next((each for each in known if each.path == channel.path and not each.is_binary), None)
        self._let_go()  # until it is opened, perhaps in another process
        self._search_at = 0.0
        return None if found is None else PhysicalScale(channel.scale, 0.0, found.unit)

    def open(self) -> None:
        """Open the driver. The other station may start later."""

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
        raise DriverError("the values of another station are read-only")

    # The other station ---------------------------------------------------------------------------------

    def _found(self) -> Reader | None:
        """Return the reader of the other station's frames, or None while the station does not run."""
        if self._reader is not None and self._reader.alive:
            return self._reader
        now = monotonic()
        if now >= self._search_at:
            self._let_go()
            self._search_at = now + SEARCH_INTERVAL
            try:
                reader = find_running(self._station)
                self._reader, self._places = reader, _places(reader)
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
        """Return the raw integer of a value, and the value's age in s. Raises DriverError if the value cannot be
        used."""
        name = f"{channel.path} of {self._station}"
        place = self._places.get(channel.path)
        if place is None:
            raise DriverError(f"{self._station} has no {channel.path}{did_you_mean(channel.path, self._places)}")
        if place.why:
            raise DriverError(f"{name} {place.why}")
        if place.binary is not (channel.scale is None):
            form = "PATH" if place.binary else "PATH:SCALE"
            raise DriverError(f"{name} {'has two states' if place.binary else 'is a number'}: its channel is {form}")
        value = float(frame[place.column][place.number])
        if place.column == "values" and (quality := Quality(int(frame["quality"][place.number]))) not in READABLE:
            raise DriverError(f"{name} is {quality.name}")
        if any(frame["equipment"][each] for each in place.equipment):
            raise DriverError(f"{name} belongs to equipment in fault")
        scaled = value / (channel.scale or 1.0)
        if not isfinite(scaled):
            raise DriverError(f"{name} has no value" if not isfinite(value) else f"{name} is {value:g}")
        raw = round(scaled)
        if not channel.lowest <= raw <= channel.highest:
            raise DriverError(f"{name} is {value:g}, which channel {channel.text} cannot hold")
        return raw, (monotonic_ns() - int(frame["began"])) * 1e-9 + place.held(int(frame["number"]))


class _Place(NamedTuple):
    """The place of a path's value in a frame."""

    column: str
    number: int
    binary: bool
    equipment: Sequence[int]
    """Places of the equipment that contains a signal. If the equipment is in fault, the signal is not used, because the
    laws of the equipment do not act. Empty for an object, which has a quality."""
    rate: tuple[int, int, float]
    """The number of periods from one execution of the part to the next, the phase of the part, and the period in s.
    Between two executions the values of the part grow older."""
    why: str = ""
    """The reason why the value cannot be used; "" if it can."""

    def held(self, number: int) -> float:
        """Return the age in s that the value has in the frame with this number."""
        every, phase, period = self.rate
        return (number - phase) % every * period


def _places(reader: RunReader) -> dict[str, _Place]:
    layout, period = reader.layout, float(reader.about["period"])
    rates = {each["path"]: (int(each["every"]), int(each["phase"]), period) for each in reader.about.get("rates", ())}
    equipment = {each["path"]: number for number, each in enumerate(layout.equipment)}

    def around(path: str) -> list[str]:
        names = path.split(".")
        return [".".join(names[:count]) for count in range(len(names), 0, -1)]

    def place(column: str, number: int, each: Described) -> _Place:
        paths = around(each.path)
        rate = next((rates[path] for path in paths if path in rates), (1, 0, period))
        in_fault = [equipment[path] for path in paths if path in equipment] if column == "signals" else ()
        late = "" if each.is_synchronous else "is asynchronous: the time of its reading is not known"
        return _Place(column, number, each.is_binary, in_fault, rate, late)

    columns = {"signals": layout.described.signals, "values": layout.described.objects}
    return {each.path: place(column, n, each) for column, all_ in columns.items() for n, each in enumerate(all_)}

"""Reading the frames of a running station: copies of complete frames, and a count of lost frames."""

from __future__ import annotations

import mmap
import os
import struct
import time
import zlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np
import numpy.typing as npt

from umo.clients.client_commands import Mode
from umo.cycle.claim_table import reason_of_client
from umo.cycle.columns import ASKED, FREE, TAKEN_BY_CLIENT
from umo.cycle.equipment import EquipmentState
from umo.cycle.events import FAULT, IN_FAULT, CommandState, Event
from umo.cycle.stage import Progress, Stage
from umo.errors import FramesError, PathError
from umo.frames.alarm_list import AlarmRow, alarm_rows, alarms_text
from umo.frames.frame_server import is_socket, receive
from umo.frames.layout import (
    CHECKSUM,
    DESCRIPTION,
    ENTRY,
    EVENT_BODY,
    EVENT_ROW,
    EVENTS,
    HEADER,
    HOLDER,
    MAGIC,
    NAME,
    VERSION,
    Layout,
    Live,
    Places,
    event_checksum,
)
from umo.frames.memory import RunDescriptors, mapped
from umo.objects import Quality
from umo.objects.claims import Claim, Rank
from umo.presentation.described import Described
from umo.presentation.durations import lasting
from umo.presentation.html_table import html_table, never_raises
from umo.presentation.rows import TableRow, restriction
from umo.presentation.run_facts import ALARMS, driven_text, facts_of, title
from umo.presentation.value_text import span
from umo.system import folders
from umo.text import did_you_mean, printable
from umo.wiring.patterns import chosen

Frames = npt.NDArray[Any]
"""Copies of frames, oldest first: a structured array with the fields of `Layout.columns`."""
Entries = npt.NDArray[Any]
"""Copies of entries of the journal (`umo.cycle.journal`): slot, `Kind`, `ErrorKind`, raw, raw before, time."""


LEASE_TRIES = 100
"""Looks at the lease while it changes."""
MAX_COUNT = 1 << 62
"""The largest count of frames, entries or events that is taken for sound."""


STAGES, MODES, WORST = {int(each): each for each in Stage}, {int(each): each for each in Mode}, max(Quality)
FRAME_HEAD = struct.Struct("<QQqd")
"""Sequence, checksum, number and time of a frame."""
SILENCE = 1.0
"""s without a frame, and 10 periods, after which a running station is said to be silent."""


class NumberedEvent(NamedTuple):
    """An event, and its number in the ring."""

    number: int
    event: Event


class Reader:
    """Reads one ring, or a file that holds one (a black box), from its oldest frame on.

    `read` returns every new frame, `latest` the last one. If the reader is too slow, frames are overwritten before
    they are read; `lost` counts them. `path` is the socket of a running station (`rings`) or a file; of memory that was
    handed over (`ends`, which it closes in the end) it is only a name. The memory of a run is sealed, and a file is
    read as a whole: whatever others do to them, a reader gets FramesError here or fewer frames later, and no more.
    """

    def __init__(self, path: Path | str, ends: RunDescriptors | None = None) -> None:
        self.path = Path(path)
        self.ends = receive(self.path) if ends is None and is_socket(self.path) else ends
        """The descriptors of the shared memory; None for a file."""
        self._release = finalize(self, _close, self.ends)  # also if nobody closes it
        try:
            self._memory = _read(self.path) if self.ends is None else mapped(self.ends.frames)
            self._attach()
        except BaseException as error:
            self._release()
            if isinstance(error, ValueError | struct.error | MemoryError):  # of numpy and struct
                raise FramesError(f"{self.path} is damaged: {error}") from None
            raise
        self.closed = False
        self.next = max(0, self.head - self.slots)
        """Number of the frame that is read next."""
        self.lost = 0
        self._index = {entry["path"]: i for i, entry in enumerate(self.layout.objects)}

    def _attach(self) -> None:
        memory, length = self._memory, len(self._memory)
        if length < DESCRIPTION:
            raise FramesError(f"{self.path} does not contain frames")
        magic, version, self.flags, first, size, self.slots, journal, entries, described = HEADER.unpack_from(memory)
        if magic != MAGIC:
            raise FramesError(f"{self.path} does not contain frames")
        if version != VERSION:
            raise FramesError(f"{self.path} has frames of version {version}, this umo reads version {VERSION}")
        if not self.slots or DESCRIPTION + described > first or journal > length:
            raise FramesError(f"{self.path} is truncated")
        description = memory[DESCRIPTION : DESCRIPTION + described]
        if struct.unpack_from("<Q", memory, 8 * Live.DESCRIBED)[0] != zlib.crc32(description):
            raise FramesError(f"{self.path} is damaged")
        self.layout = Layout.parse(description)
        self._dtype = self.layout.dtype
        if self._dtype.itemsize != size:
            raise FramesError(f"{self.path}: frames of {size} bytes do not fit their description")
        self._places = places = Places.of(self.layout, first, self.slots, entries)
        if places.journal != journal or places.size > length:
            raise FramesError(f"{self.path} is truncated")
        self._checked = bool(self.flags & CHECKSUM)
        fields = self._dtype.fields
        assert fields is not None
        self._sizes = size, self.layout.content, fields["quality"][1], len(self.layout.objects)
        """Bytes of a frame and those in use, offset of its qualities, how many there are."""
        self._live = memoryview(memory)[:DESCRIPTION].cast("q")
        self._rows = np.frombuffer(memory, np.uint8, self.slots * size, first).reshape(self.slots, size)
        self._journal: Entries = np.frombuffer(memory, ENTRY, entries, journal)
        self._events: Entries = np.frombuffer(memory, EVENT_ROW, EVENTS, places.events)

    def again(self) -> Reader:
        """Another reader of the same ring, from its oldest frame on."""
        try:
            return Reader(self.path, None if self.ends is None else self.ends.again())
        except OSError as error:
            raise FramesError(f"no frames at {self.path}: {error.strerror}") from None

    # What the ring says of itself ----------------------------------------------------------------------

    @property
    def about(self) -> dict[str, Any]:
        """Station, wiring, pid, when it started, the period in s."""
        return self.layout.about

    @property
    def paths(self) -> list[str]:
        """The objects' paths, in the order of a frame's values."""
        return list(self._index)

    @property
    def signals(self) -> list[str]:
        """The signals' paths, in the order of a frame's `signals`."""
        return [str(entry["path"]) for entry in self.layout.signals]

    @property
    def head(self) -> int:
        """Frames finished so far."""
        return self._count(Live.HEAD)

    @property
    def missed(self) -> int:
        return self._count(Live.MISSED)

    @property
    def state(self) -> Stage:
        """The stage of the run; ENDED also if its processes are gone."""
        if not self.alive:
            return Stage.ENDED
        number = self._live[Live.STATE]
        return STAGES.get(number, Stage.RUNNING)

    @property
    def is_finished(self) -> bool:
        """Whether the writer has finished the ring: no frame follows."""
        return bool(self._live[Live.STATE] == Stage.ENDED)

    @property
    def alive(self) -> bool:
        """Whether the process that writes this ring still lives."""
        if self.ends is None:
            return False
        try:
            os.read(self.ends.alive, 1)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False

    @property
    def mode(self) -> Mode | None:
        """Mode of the machine; None if it takes no commands from outside."""
        return MODES.get(self._live[Live.MODE])

    @property
    def lease(self) -> tuple[int, str]:
        """The number of the last lease, and who has it; "": nobody has it any longer."""
        for _ in range(LEASE_TRIES):
            number = int(self._live[Live.LEASE])
            text = self._memory[HOLDER : HOLDER + NAME].rstrip(b"\0").decode(errors="replace")
            if number >= 0 and number == self._live[Live.LEASE]:
                return number, text
        return -1, ""

    @property
    def holder(self) -> str:
        """Name of who has the lease; empty: nobody."""
        return self.lease[1]

    def lease_held(self, number: int) -> bool:
        """Whether the lease of this number still lasts: it has not ended, and no other client has taken it over."""
        last, holder = self.lease
        return last == number and bool(holder)

    @property
    def taken(self) -> int:
        """Commands from outside that the machine has taken from its queue."""
        return self._count(Live.TAKEN)

    @property
    def dropped(self) -> int:
        """The number of these that were not commands."""
        return self._count(Live.DROPPED)

    def tunables(self) -> dict[str, float]:
        """The tunable numbers by path, each at most as many periods old as there are numbers."""
        numbers = np.frombuffer(self._memory, "<f8", len(self.layout.tunables), self._places.tunables).tolist()
        return {entry["path"]: value for entry, value in zip(self.layout.tunables, numbers, strict=True)}

    def tuned(self) -> dict[str, float]:
        """The tunable numbers that differ from their values at the start of the run, by path."""
        start = {entry["path"]: entry.get("start") for entry in self.layout.tunables}
        return {path: value for path, value in self.tunables().items() if isfinite(value) and value != start[path]}

    @property
    def kept(self) -> list[str]:
        """The paths of the numbers that are kept over a restart."""
        return [entry["path"] for entry in self.layout.signals if "kept" in entry]

    def live(self, start: int, stop: int) -> bytes:
        """The live numbers as they stand in the ring."""
        return self._memory[start:stop]

    def told(self) -> bytes:
        """Events and tunable numbers as they stand in the ring."""
        return self._memory[self._places.events : self._places.size]

    def index(self, path: str) -> int:
        """The index of an object in a frame's `values`; PathError with the nearest path otherwise."""
        if path not in self._index:
            raise PathError(f"no object {path!r}{did_you_mean(path, self._index)} in {self.about.get('station')}")
        return self._index[path]

    @cached_property
    def _known(self) -> list[Described]:
        """Objects, signals, tunable numbers, in the order of rows."""
        return [each for group in self.layout.described for each in group]

    # Frames --------------------------------------------------------------------------------------------

    def read(self, most: int | None = None) -> Frames:
        """The frames finished since the last call (at most `most`), oldest first; those lost are counted."""
        head = self.head
        self.next = min(self.next, head)  # it was damaged
        oldest = max(self.next, head - self.slots)
        stop = head if most is None else min(head, oldest + most)
        frames = self._copy(oldest, stop)
        self.lost += stop - self.next - len(frames)
        self.next = stop
        return frames

    def skip_older_half(self) -> None:
        """Read on from the newer half of the ring: the older frames may be written over while they are read."""
        self.next = max(self.next, self.head - self.slots // 2)

    def latest(self) -> Any | None:
        """The last finished frame, None where there is none. Leaves `next` and `lost` alone."""
        for count in (1, 2, self.slots):  # the very last may be being written over already
            frames = self.last(count)
            if len(frames):
                return frames[-1]
        return None

    def last(self, count: int) -> Frames:
        """Up to the last `count` frames. Leaves `next` and `lost` alone."""
        head = self.head
        return self._copy(max(0, head - min(count, self.slots)), head)

    def every(self, first: int, stride: int, most: int) -> Frames:
        """Every `stride`-th frame from the number `first` on, at most `most`: those that are still there, oldest first.
        Leaves `next` and `lost` alone."""
        numbers = np.arange(first, self.head, stride, dtype=np.uint64)[:most]
        return self._whole(self._rows[numbers % np.uint64(self.slots)], numbers)

    def frame_bytes(self, number: int) -> bytes | None:
        """A frame as it stands in the ring; None: it is not there any more, or not whole. For one frame this is
        quicker than `every`."""
        size, content, quality, count = self._sizes
        at = self._places.first + number % self.slots * size
        data = self._memory[at : at + size]
        sequence, checksum, _, moment = FRAME_HEAD.unpack_from(data)
        if sequence != 2 * number + 2 or number <= self.head - self.slots - self.is_finished or not isfinite(moment):
            return None
        if count and max(data[quality : quality + count]) > WORST:
            return None
        if self._checked and zlib.crc32(data[16:content], zlib.crc32(data[:8])) != checksum:
            return None
        return data

    def values(self, frame: Any) -> dict[str, float | str]:
        """The value of every object by path: a number in its unit, or the name of a state; NaN: it was never read."""
        numbers = frame["values"].tolist()
        objects = self.layout.described.objects
        return {each.path: each.value(value) for each, value in zip(objects, numbers, strict=True)}

    def inhibited(self, frame: Any, number: int) -> str | None:
        """Why only the default of an object could be sent, or the client that had taken it; None: neither."""
        state = int(frame["restrictions"][number])
        if state in (FREE, ASKED):
            return None
        if state == TAKEN_BY_CLIENT:
            return reason_of_client(self.holder)
        return self.layout.interlocks[state - 1] if state <= len(self.layout.interlocks) else "an unknown interlock"

    def claims(self, frame: Any, faults: Mapping[str, str]) -> dict[int, Claim]:
        """Who drove each actuator at a frame that the program did not drive. `faults`: those of the frame."""
        restrictions = frame["restrictions"]
        numbers = np.flatnonzero((restrictions != FREE) & (restrictions != ASKED)).tolist()
        return {number: self._claim(frame, number, faults) for number in numbers}

    def claim(self, frame: Any, number: int) -> Claim:
        """Who drove an actuator at a frame."""
        return self._claim(frame, number, self.faults(frame))

    def _claim(self, frame: Any, number: int, faults: Mapping[str, str]) -> Claim:
        reason, path = self.inhibited(frame, number), str(self.layout.objects[number]["path"])
        if reason is None:
            return Claim(Rank.PROGRAM)
        if int(frame["restrictions"][number]) == TAKEN_BY_CLIENT:
            return Claim(Rank.CLIENT, reason)
        in_fault = any(not each or path.startswith(f"{each}.") for each in faults)
        return Claim(Rank.FAULT if in_fault else Rank.INTERLOCK, reason)

    def is_object(self, path: str) -> bool:
        """Whether a path is that of a sensor or an actuator."""
        return path in self._index

    def is_taken(self, path: str) -> bool:
        """Whether a client has taken the actuator at a path, by the newest frame; False for any other path."""
        number, frame = self._index.get(path), self.latest()
        return number is not None and frame is not None and int(frame["restrictions"][number]) == TAKEN_BY_CLIENT

    def faults(self, frame: Any) -> dict[str, str]:
        """The equipment in fault at a frame, by path: the reason, as long as the event that told it is kept."""
        if frame is None or not frame["equipment"].any():
            return {}
        events = (each.event for each in self.events() if each.event.asked == FAULT)
        told = {event.path: event.text.removeprefix(IN_FAULT) for event in events}
        states = zip(self.layout.equipment, frame["equipment"].tolist(), strict=True)
        paths = (str(entry["path"]) for entry, state in states if state == EquipmentState.FAULT)
        return {path: told.get(path, "its reason is no longer kept") for path in paths}

    def alarms(self, frame: Any, raised: bool = False) -> list[AlarmRow]:
        """The alarms that are not normal at a frame: what is to be acknowledged first, then by priority. `raised`: then
        those that are normal and were raised in this run, where that is known (`occurrences`)."""
        if frame is None or not (raised or frame["alarms"].any()):
            return []
        events = (each.event for each in self.events())
        return alarm_rows(self.layout.alarms, frame["alarms"].tolist(), events, self.occurrences(), raised)

    def occurrences(self) -> list[tuple[float, float, float]]:
        """Of each alarm how often it was raised in this run, when first and when last, in s on the cycle's clock. All
        0 where that is not known: in recordings, and of stations of other computers."""
        count = len(self.layout.alarms)
        numbers = np.frombuffer(self._memory, "<f8", 3 * count, self._places.alarms)
        return list(zip(*numbers.reshape(3, count).tolist(), strict=True))

    def unit_states(self, frame: Any) -> dict[str, str]:
        """The states of parts at a frame (`umo.operation`), by the paths of their state machines."""
        if frame is None or not self.layout.units:
            return {}
        signals = self.layout.described.signals
        places = {each.path: place for place, each in enumerate(signals)}
        found = ((str(unit["path"]), places[f"{unit['path']}.state"]) for unit in self.layout.units)
        values = ((path, signals[place], float(frame["signals"][place])) for path, place in found)
        return {path: about.state(value) for path, about, value in values if isfinite(value)}

    # In words ------------------------------------------------------------------------------------------

    @property
    def lasted(self) -> float | None:
        """s of this computer's steady clock since the run was connected; None: it runs, or ran, elsewhere, or before
        the computer was started."""
        begun = self.about.get("started_monotonic")
        passed = None if begun is None or "site" in self.about else (time.monotonic_ns() - int(begun)) * 1e-9
        return None if passed is None or passed < 0 else passed

    @property
    def title(self) -> str:
        return title(self.about["station"], self.about.get("wiring"))

    def facts(self, frame: Any) -> dict[str, str]:
        """Facts of the run at a frame (None: it has none yet), by name, in the order in which they are shown."""
        state, period = self.state, self.about.get("period") or None
        moment = None if frame is None else float(frame["time"])
        mode, holder, driven = self.mode, self.holder, self.driven(frame)
        facts = facts_of(
            state,
            mode,
            holder,
            progress_of(frame),
            driven=driven,
            time=moment,
            period=period,
            missed=self.missed,
            faults=self.faults(frame),
        )
        if frame is None:
            return facts | {"progress": "no period has ended yet"}
        if alarms := alarms_text(self.alarms(frame)):
            facts[ALARMS] = "; ".join(map(printable, alarms))
        silence = (time.monotonic_ns() - int(frame["began"])) * 1e-9
        if state is Stage.RUNNING and silence > max(SILENCE, 10 * self.about["period"]):
            facts["no frame for"] = lasting(silence)
        return facts | {"kept because": self.about.get("reason", "")}

    def driven(self, frame: Any) -> str:
        """The actuators that are away from their defaults in manual mode, and why; "": none, or another mode."""
        if frame is None or self.mode is not Mode.MANUAL:
            return ""
        taken = (frame["restrictions"] == TAKEN_BY_CLIENT).tolist()
        objects = self.layout.described.objects
        return driven_text(zip(objects, frame["values"].tolist(), taken, strict=True), self.holder)

    def rows(self, frame: Any, places: Iterable[int] | None = None) -> list[TableRow]:
        """Objects, signals, tunable numbers at a frame (None: without values), or those at these places."""
        numbers = self.tunables()
        return [self._row(frame, place, numbers) for place in (range(len(self._known)) if places is None else places)]

    def _row(self, frame: Any, place: int, numbers: Mapping[str, float]) -> TableRow:
        about, objects, signals = self._known[place], len(self.layout.objects), len(self.layout.signals)
        if place >= objects + signals:
            bounds = span(about.minimum, about.maximum)
            return TableRow(about, numbers[about.path], note=f"tunable, {bounds}" if bounds else "tunable")
        if frame is None:
            return TableRow(about)
        if place >= objects:
            return TableRow(about, float(frame["signals"][place - objects]))
        note = restriction(self.inhibited(frame, place), frame["restrictions"][place] == TAKEN_BY_CLIENT)
        value, quality, raw = frame["values"][place], frame["quality"][place], frame["raws"][place]
        return TableRow(about, float(value), int(quality), int(raw), note)

    def html(self, wanted: Sequence[str] = (), more: Mapping[str, str] = MappingProxyType({})) -> str:
        """A table of the last frame: everything, or what is at paths and patterns. `more`: facts for the heading."""
        if self.closed:
            raise FramesError(f"{self.title} is detached")
        frame = self.latest()
        places = chosen([each.path for each in self._known], wanted, str(self.about["station"]))
        return html_table(self.title, self.facts(frame) | dict(more), self.rows(frame, places))

    @never_raises
    def _repr_html_(self) -> str:
        return self.html()

    # The journal ---------------------------------------------------------------------------------------

    def journal(self, frame: Any) -> Entries | None:
        """The journal of a frame's period: transfers of single objects, in order; None if it was overwritten."""
        first, count = int(frame["journal"]), int(frame["entries"])
        start, entries = self.entries(first, first + count)
        torn = self._checked and count and zlib.crc32(entries.tobytes()) != frame["entries_checksum"]
        return None if torn or (start, len(entries)) != (first, count) else entries

    def entries(self, start: int, stop: int) -> tuple[int, Entries]:
        """The entries of these numbers that are still there, and the number of the first of them."""
        if not 0 <= start <= stop <= MAX_COUNT:  # of a damaged frame
            return max(start, stop), self._journal[:0]
        capacity = len(self._journal)
        begin = max(start, stop - capacity)
        entries = self._journal[np.arange(begin, stop) % max(capacity, 1)]
        oldest = self._count(Live.JOURNAL) - capacity  # after the copy: those before it may be torn
        there = min(max(begin, oldest), stop)
        return there, entries[there - begin :]

    # Events --------------------------------------------------------------------------------------------

    def events(self, start: int = 0) -> list[NumberedEvent]:
        """The events from this number on that are still there, oldest first."""
        stop = self.next_event
        numbers = np.arange(max(start, stop - EVENTS, 0), stop)
        rows = self._events[numbers % EVENTS]
        whole = self._events["sequence"][numbers % EVENTS] == numbers + 1  # after the copy
        if self._checked:
            whole &= np.array([_is_whole(row) for row in rows], bool)
        whole &= (rows["sequence"] == numbers + 1) & np.isfinite(rows["time"]) & (rows["state"] <= max(CommandState))
        return [
            NumberedEvent(int(number), Event(
                float(row["time"]), _text(row["path"]), _text(row["text"]), _text(row["who"]), int(row["command"]),
                CommandState(int(row["state"])), _text(row["asked"]),
            ))
            for number, row in zip(numbers[whole], rows[whole], strict=True)
        ]  # fmt: skip

    @property
    def end(self) -> Event | None:
        """The last event of a run that has ended; None: it could not tell any more."""
        return next((each.event for each in reversed(self.events()) if each.event.is_end), None)

    @property
    def next_event(self) -> int:
        """The number of the next event."""
        return self._count(Live.EVENT)

    # Inside --------------------------------------------------------------------------------------------

    def _count(self, place: int) -> int:
        """A live number that counts, within bounds where it is damaged."""
        return min(max(int(self._live[place]), 0), MAX_COUNT)

    def _copy(self, start: int, stop: int) -> Frames:
        """Copy those of the frames that are still there and whole."""
        numbers = np.arange(start, max(start, stop), dtype=np.uint64)
        if not len(numbers):
            return np.zeros(0, self._dtype)
        begin, end = start % self.slots, (stop - 1) % self.slots + 1
        parts = [self._rows[begin:end]] if begin < end else [self._rows[begin:], self._rows[:end]]
        return self._whole(np.concatenate(parts), numbers)

    def _whole(self, rows: npt.NDArray[np.uint8], numbers: npt.NDArray[np.uint64]) -> Frames:
        """Those of the frames, copied as bytes (numpy would pack their fields together), that are whole."""
        frames = np.ndarray(len(rows), self._dtype, rows)
        ended = self._live[Live.STATE] == Stage.ENDED  # looked up before the head, which then stands
        oldest = self.head - self.slots - ended  # frame `oldest` may be being written over at this moment
        whole = (numbers.astype(np.int64) > oldest) & (frames["sequence"] == 2 * numbers + 2)
        whole &= np.isfinite(frames["time"]) & (frames["quality"] <= WORST).all(axis=1)
        if self._checked:
            content = self.layout.content
            sums = [zlib.crc32(row[16:content].data, zlib.crc32(row[:8].data)) for row in rows]
            whole &= np.array(sums, np.uint64) == frames["checksum"]
        return frames if whole.all() else frames[whole]

    def close(self) -> None:
        if self.closed:
            return
        self.closed = True
        del self._rows, self._journal, self._events
        self._live.release()
        if isinstance(self._memory, mmap.mmap):
            self._memory.close()
        self._release()
        self.ends = None

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _is_whole(row: Any) -> bool:
    """Whether the copy of an event's row is what was written."""
    return bool(row["checksum"] == event_checksum(int(row["sequence"]), row.tobytes()[EVENT_BODY:]))


def progress_of(frame: Any) -> Progress:
    """The progress that the machine had told last; none without a frame."""
    if frame is None:
        return Progress()
    return Progress(_text(frame["progress"]), int(frame["done"]), int(frame["total"]))


def _close(ends: RunDescriptors | None) -> None:
    if ends is not None:
        ends.close()


def _read(path: Path) -> bytes:
    try:
        file = folders.open_own(path, follow=True)
    except OSError as error:
        raise FramesError(f"no frames at {path}: {error.strerror}") from None
    with os.fdopen(file, "rb") as stream:
        return stream.read()


def _text(data: bytes) -> str:
    return data.decode(errors="replace")

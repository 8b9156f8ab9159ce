"""The reader of a run, whatever its source: a run on this or another computer, a recording, or a replay.

A source implements the eight abstract functions of `RunReader`; all other functions use these.
`umo.process.frames.reader.Reader` reads the ring of a run, or of the mirror of a run;
`umo.process.frames.shown_run.ShownRun` shows frames of a recording or a replay.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from umo.cycle.claim_table import reason_of_client
from umo.cycle.columns import ASKED, FREE, TAKEN_BY_CLIENT
from umo.cycle.equipment import EquipmentState
from umo.cycle.events import FAULT, FAULT_PREFIX, Event
from umo.cycle.stage import Progress, Stage
from umo.duration import lasting
from umo.errors import FramesError, PathError
from umo.objects.claims import Claim, Rank
from umo.objects.presentation.described import Described
from umo.objects.presentation.html_table import html_table, never_raises
from umo.objects.presentation.rows import TableRow, restriction
from umo.objects.presentation.run_facts import ALARMS, driven_text, facts_of, title
from umo.objects.presentation.value_text import span
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.commands.client_commands import Mode
from umo.process.frames.alarm_list import AlarmRow, alarm_rows, alarms_text
from umo.process.frames.layout import Layout
from umo.text import did_you_mean, printable
from umo.wiring.patterns import chosen

Frames = npt.NDArray[Any]
"""Copies of frames, oldest first: a structured array with the fields of `Layout.columns`."""
SILENCE = 1.0
"""The time in s without a frame after which a running station counts as silent, if it is also at least 10 periods."""


class NumberedEvent(NamedTuple):
    """An event, and its number in the ring."""

    number: int
    event: Event


class RunNow(NamedTuple):
    """The data of a run in addition to its frames."""

    mode: Mode | None = None
    """The mode of the machine; None if the machine takes no commands from outside."""
    lease: int = 0
    """The number of the last lease; -1 if the writer was killed while it wrote the lease."""
    holder: str = ""
    """Name of the holder of the lease; "" if nobody has it."""
    missed: int = 0
    """Number of missed periods."""
    periods: int = 0
    """Number of frames so far."""
    next_event: int = 0
    """The number of the next event."""


class RunReader(ABC):
    """The base of readers of one run."""

    path: Path
    """The socket or file from which the run is read, or only a name."""
    layout: Layout
    """The description, which does not change during the run: facts (`about`), objects, signals, alarms, actions."""
    lost = 0
    """Number of frames that were overwritten before they were read."""
    closed = False

    # Functions of the source -------------------------------------------------------------------------------

    @property
    @abstractmethod
    def state(self) -> Stage:
        """The stage of the run. It is ENDED also if the processes of the run no longer exist."""

    @abstractmethod
    def now(self) -> RunNow:
        """Return the data of the run other than its frames."""

    @abstractmethod
    def tunables(self) -> dict[str, float]:
        """Return the tunable numbers by path."""

    @abstractmethod
    def latest(self) -> Any | None:
        """Return the last finished frame, or None if there is none."""

    @abstractmethod
    def read(self, most: int | None = None) -> Frames:
        """Return the frames since the last call (at most `most`), oldest first. Lost frames are counted."""

    @abstractmethod
    def events(self, start: int = 0) -> list[NumberedEvent]:
        """Return the events from this number on that are still available, oldest first."""

    @abstractmethod
    def again(self) -> Self:
        """Return another reader of the same run."""

    @abstractmethod
    def close(self) -> None: ...

    def alarm_times(self) -> list[AlarmTimes]:
        """Return the times of each alarm. All numbers are 0 if they are not known: in recordings, and for stations on
        other computers."""
        return [AlarmTimes()] * len(self.layout.alarms)

    # Derived functions --------------------------------------------------------------------------------------

    @property
    def about(self) -> dict[str, Any]:
        """Facts of the run: station, wiring, pid, start, and the period in s."""
        return self.layout.about

    @property
    def paths(self) -> list[str]:
        """The objects' paths, in the order of a frame's values."""
        return list(self._index)

    @property
    def signals(self) -> list[str]:
        """The signals' paths, in the order of a frame's `signals`."""
        return [str(entry["path"]) for entry in self.layout.signals]

    @cached_property
    def _index(self) -> dict[str, int]:
        return {entry["path"]: i for i, entry in enumerate(self.layout.objects)}

    def tuned(self) -> dict[str, float]:
        """Return the tunable numbers that differ from their values at the start of the run, by path."""
        start = {entry["path"]: entry.get("start") for entry in self.layout.tunables}
        return {path: value for path, value in self.tunables().items() if isfinite(value) and value != start[path]}

    @property
    def kept(self) -> list[str]:
        """The paths of the numbers that are kept across a restart."""
        return [entry["path"] for entry in self.layout.signals if "kept" in entry]

    def index(self, path: str) -> int:
        """Return the index of an object in a frame's `values`; raises PathError with the nearest path otherwise."""
        if path not in self._index:
            raise PathError(
                f"there is no object {path!r}{did_you_mean(path, self._index)} in {self.about.get('station')}"
            )
        return self._index[path]

    @cached_property
    def _known(self) -> list[Described]:
        """Objects, signals, tunable numbers, in the order of rows."""
        return [each for group in self.layout.described for each in group]

    def values(self, frame: Any) -> dict[str, float | str]:
        """Return the value of every object by path: a number in its unit, or the name of a state; NaN if it was never
        read."""
        numbers = frame["values"].tolist()
        objects = self.layout.described.objects
        return {each.path: each.value(value) for each, value in zip(objects, numbers, strict=True)}

    def inhibited(self, frame: Any, number: int) -> str | None:
        """Return the reason why only the default of an object could be sent, or the client that had taken the object,
        or None."""
        state = int(frame["restrictions"][number])
        if state in (FREE, ASKED):
            return None
        if state == TAKEN_BY_CLIENT:
            return reason_of_client(self.now().holder)
        return self.layout.interlocks[state - 1] if state <= len(self.layout.interlocks) else "an unknown interlock"

    def claims(self, frame: Any, faults: Mapping[str, str]) -> dict[int, Claim]:
        """Return the claims at a frame on the actuators that the program did not drive. `faults`: the faults at the
        frame."""
        restrictions = frame["restrictions"]
        numbers = np.flatnonzero((restrictions != FREE) & (restrictions != ASKED)).tolist()
        return {number: self._claim(frame, number, faults) for number in numbers}

    def claim(self, frame: Any, number: int) -> Claim:
        """Return the claim on an actuator at a frame."""
        return self._claim(frame, number, self.faults(frame))

    def _claim(self, frame: Any, number: int, faults: Mapping[str, str]) -> Claim:
        reason, path = self.inhibited(frame, number), str(self.layout.objects[number]["path"])
        if reason is None:
            return Claim(Rank.PROGRAM)
        if int(frame["restrictions"][number]) == TAKEN_BY_CLIENT:
            return Claim(Rank.CLIENT, reason)
        in_fault = any(not each or path.startswith(f"{each}.") for each in faults)
        return Claim(Rank.FAULT if in_fault else Rank.INTERLOCK, reason)

    def is_taken(self, path: str) -> bool:
        """Return True if a client has taken the actuator at a path, by the newest frame; False for any other path."""
        number, frame = self._index.get(path), self.latest()
        return number is not None and frame is not None and int(frame["restrictions"][number]) == TAKEN_BY_CLIENT

    def faults(self, frame: Any) -> dict[str, str]:
        """Return the equipment in fault at a frame, by path, with the reason as long as its event is kept."""
        if frame is None or not frame["equipment"].any():
            return {}
        events = (each.event for each in self.events() if each.event.asked == FAULT)
        told = {event.path: event.text.removeprefix(FAULT_PREFIX) for event in events}
        states = zip(self.layout.equipment, frame["equipment"].tolist(), strict=True)
        paths = (str(entry["path"]) for entry, state in states if state == EquipmentState.FAULT)
        return {path: told.get(path, "its reason is no longer kept") for path in paths}

    def alarms(self, frame: Any, raised: bool = False, every: bool = False) -> list[AlarmRow]:
        """Return the alarms that are not normal at a frame: unacknowledged ones first, then by priority. `raised`: also
        those that are normal and were raised in this run, if this is known (`alarm_times`). `every`: all alarms."""
        if frame is None or not (raised or every or frame["alarms"].any()):
            return []
        events = (each.event for each in self.events())
        return alarm_rows(self.layout.alarms, frame["alarms"].tolist(), events, self.alarm_times(), raised, every)

    def unit_states(self, frame: Any) -> dict[str, str]:
        """Return the states of parts at a frame (`umo.operation`), by the paths of their state machines."""
        if frame is None or not self.layout.units:
            return {}
        signals = self.layout.described.signals
        places = {each.path: place for place, each in enumerate(signals)}
        found = ((str(unit["path"]), places[f"{unit['path']}.state"]) for unit in self.layout.units)
        values = ((path, signals[place], float(frame["signals"][place])) for path, place in found)
        return {path: about.state(value) for path, about, value in values if isfinite(value)}

    def utc(self, frame: Any) -> float | None:
        """Return the UTC in s since 1970 at which the cycle's time was 0; None without a frame, and for a run that does
        not keep the pace of the wall clock."""
        if frame is None or not self.about.get("realtime"):
            return None
        return round((int(frame["began"]) + int(frame["utc"])) * 1e-9 - float(frame["time"]), 3)

    # In words ------------------------------------------------------------------------------------------

    @property
    def lasted(self) -> float | None:
        """The time in s on this computer's monotonic clock since the run was connected; None if the run is, or was, on
        another computer, or began before this computer was started."""
        begun = self.about.get("started_monotonic")
        passed = None if begun is None or "site" in self.about else (time.monotonic_ns() - int(begun)) * 1e-9
        return None if passed is None or passed < 0 else passed

    @property
    def title(self) -> str:
        return title(self.about["station"], self.about.get("wiring"))

    def facts(self, frame: Any) -> dict[str, str]:
        """Return the facts of the run at a frame (None if there is no frame yet), by name, in the order in which they
        are shown."""
        state, period = self.state, self.about.get("period") or None
        moment = None if frame is None else float(frame["time"])
        now, driven = self.now(), self.driven(frame)
        facts = facts_of(
            state,
            now.mode,
            now.holder,
            progress_of(frame),
            driven=driven,
            time=moment,
            period=period,
            missed=now.missed,
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
        """Return the actuators that are not at their defaults in manual mode, and the reasons; "" if there are none or
        the mode is not manual."""
        if frame is None or (now := self.now()).mode is not Mode.MANUAL:
            return ""
        taken = (frame["restrictions"] == TAKEN_BY_CLIENT).tolist()
        objects = self.layout.described.objects
        return driven_text(zip(objects, frame["values"].tolist(), taken, strict=True), now.holder)

    def rows(self, frame: Any, places: Iterable[int] | None = None) -> list[TableRow]:
        """Return rows of the objects, signals and tunable numbers at a frame (None for rows without values), or only
        the rows with these indices."""
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
        """Return a table of the last frame, with all values or with those at the given paths and patterns. `more`:
        facts for the heading."""
        if self.closed:
            raise FramesError(f"{self.title} is detached")
        frame = self.latest()
        places = chosen([each.path for each in self._known], wanted, str(self.about["station"]))
        return html_table(self.title, self.facts(frame) | dict(more), self.rows(frame, places))

    @never_raises
    def _repr_html_(self) -> str:
        return self.html()

    @property
    def end(self) -> Event | None:
        """The last event of a run that has ended; None if the run was killed."""
        return next((each.event for each in reversed(self.events()) if each.event.is_end), None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def progress_of(frame: Any) -> Progress:
    """Return the last progress of the machine; an empty progress without a frame."""
    if frame is None:
        return Progress()
    return Progress(frame["progress"].decode(errors="replace"), int(frame["done"]), int(frame["total"]))

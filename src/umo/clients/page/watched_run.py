"""Reads the ring of one run of a station, only once for all pages."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from umo.clients.page.ending import UNKNOWN_END, BoxInWords, Ending, ending_of, newest_box
from umo.clients.page.extremes import Extremes
from umo.cycle.events import Event
from umo.duration import duration
from umo.errors import UmoError
from umo.objects import Quality
from umo.objects.claims import NEXT, WHO, Rank
from umo.objects.presentation.described import shown_all
from umo.objects.presentation.rows import TableRow, declared_of
from umo.objects.presentation.run_facts import fault_texts
from umo.objects.presentation.value_text import SIGNS, WORDS
from umo.operation.commands.verbs import VERBS
from umo.plant.twin import declares_twin, place_of, twin_of
from umo.process.frames import RunReader, Stage
from umo.process.frames.alarm_list import AlarmRow, alarms_text
from umo.process.source_files import changed_files, changed_text
from umo.recording.scope.history import History, ValueHistory, last_good
from umo.text import printable

PAGE_FACTS = ("station", "wiring", "place", "pid", "period")
"""Facts of the run that a page receives."""
MAX_EVENTS = 100
"""Number of the last events that a page receives, and of the last missed periods."""
ENDING_TIME = 5.0
"""Time in s after the end of a run during which its guardian may still report how it ended."""


class Watched:
    """A run with its last minutes, and with its state ten times per second."""

    def __init__(self, reader: RunReader) -> None:
        self.reader, self.path = reader, reader.path
        self.about: dict[str, Any] = {name: reader.about[name] for name in PAGE_FACTS}
        self.station = str(self.about["station"])
        self.place = str(self.about["place"])
        """Folder of the station, or empty if it has none."""
        self.name = self.station
        """Name of this run on the page; two runs of one station have different names."""
        self.is_elsewhere = "site" in reader.about
        """True if the run is on another computer, and this object is its mirror."""
        self.run = f"{self.about['pid']}-{reader.about['started']}" if self.is_elsewhere else self.path.name
        self.jumps = 0
        """Number of times that the time of a recording jumped back or forward."""
        self.viewers = 0
        """Number of pages that show this run."""
        self.entries = reader.layout.described.traced
        self.columns = {each.path: column for column, each in enumerate(self.entries)}
        self.period = float(self.about["period"])
        self._memory = History(len(self.entries), self.period)
        self.history: ValueHistory = self._memory
        self.extremes = self._new_extremes()
        """The extremes in all frames that this server has read. The first ones can be older than the server, because
        a ring keeps frames."""
        self._more_extremes: list[Extremes] = []
        """The extremes that were started anew for pages."""
        self.twin_place = self._twin_place()
        """The folder of the station whose twin is drawn, or None if there is none on this computer."""
        own = self.twin_place is not None and declares_twin(self.twin_place)
        self.twin = own or (self.is_elsewhere and bool(reader.about.get("twin")))
        self.stage = reader.state
        self.number = 0
        """Number of the state; the next state is made when a page requests one."""
        self._taken = 0
        """The number of the last state that was made."""
        self.box = BoxInWords()
        """The newest black box of this run."""
        self.changed = ""
        """The files that have changed on disk since the run has read them, as text; empty if none."""
        self.ending: Ending | None = None
        """End of the run, or None if it has not ended, or its end is still being found out."""
        self.over = False
        """True if the run has ended and all its frames were read."""
        self._ended = 0.0
        """Time in s at which it was noticed that the run is over."""
        self._frame: Any = reader.latest()
        self._good = np.full(len(reader.layout.objects), np.nan)
        self._heard = time.monotonic()
        self._shown: list[Any] = []
        self._changed: dict[int, Any] = {}
        self._texts: dict[bool, str] = {}
        self._event = self._missed = 0
        """The number of the next event and the number of missed periods when the state was made."""
        self._new_events = self._new_misses = False
        self._last_event: Event | None = None
        """Event of the end of the run, or None if there is none."""
        self._troubled: tuple[Any, ...] = ()
        """The states, and the number of the next event, from which `_troubles` was made."""
        self._troubles: dict[str, Any] = {}
        self._misses: deque[tuple[float, int]] = deque(maxlen=MAX_EVENTS)
        """The last periods before which periods were missed, each with its time and the number of missed periods."""

    def _twin_place(self) -> Path | None:
        return None if self.is_elsewhere else place_of(self.reader.layout)

    def own_twin(self) -> dict[str, Any] | None:
        """Return the description of the twin of a station on this computer. Raises UmoError if the twin's declaration
        is wrong."""
        return None if self.twin_place is None else twin_of(self.reader.layout, self.twin_place)

    def read(self) -> None:
        self.stage = self.reader.state  # before the frames: the last ones are read in any case
        frames = self.reader.read()
        if self.ended and not self.over:
            self.over, self._ended = True, time.monotonic()
            self._last_event = self.reader.end
        if not len(frames):
            return
        self._heard = time.monotonic()
        self._frame = frames[-1]
        late = np.flatnonzero(frames["missed"])
        self._misses.extend(zip(frames["time"][late].tolist(), frames["missed"][late].tolist(), strict=True))
        self._memory.add_frames(frames)
        for extremes in (self.extremes, *self._more_extremes):
            extremes.add(frames)
        self._good = last_good(frames, self._good)

    def _new_extremes(self) -> Extremes:
        return Extremes(len(self.reader.layout.objects), len(self.reader.layout.signals))

    def extremes_for(self, anew: bool) -> Extremes:
        """Return the extremes in all frames that this server has read. With `anew` return extremes from now on, until
        `end_extremes`."""
        if not anew:
            return self.extremes
        self._more_extremes.append(self._new_extremes())
        return self._more_extremes[-1]

    def end_extremes(self, extremes: Extremes) -> None:
        if extremes in self._more_extremes:
            self._more_extremes.remove(extremes)

    def look_around(self) -> None:
        """Read the files of this run: its newest black box, and how it ended. Call this in a thread."""
        self.box = newest_box(self.reader.about, self.box)
        self.changed = "" if self.over else changed_text(changed_files(self.reader.about))
        if self.over:
            found = ending_of(self.reader.about, self._last_event, self.box)
            if found is None and time.monotonic() - self._ended > ENDING_TIME:
                found = Ending(True, UNKNOWN_END)
            self.ending = found and Ending(found.failed, printable(found.text))

    # What pages are told -------------------------------------------------------------------------------

    def description(self) -> dict[str, Any]:
        """Return a message with all data that do not change during the run."""
        told: dict[str, Any] = {"type": "description", "name": self.name, "run": self.run}
        told |= {name: self.about[name] for name in PAGE_FACTS}
        layout, (objects, signals, tunables) = self.reader.layout, self.reader.layout.described
        told["objects"] = [each.shown | {"declared": declared_of([TableRow(each)])} for each in objects]
        told |= {"signals": [each.shown for each in signals], "tunables": [each.shown for each in tunables]}
        told["actions"] = [each | {"arguments": shown_all(each["arguments"])} for each in layout.actions]
        return (
            told
            | {"twin": self.twin, "units": list(layout.units), "alarms": bool(layout.alarms)}
            | {"verbs": [each.plain() for each in VERBS.values()]}
            | {"books": [each | {"fields": shown_all(each["fields"])} for each in layout.books]}
            | {"qualities": list(zip(SIGNS, WORDS, strict=True))}
            | {"drivers": {rank.name: [WHO[rank], NEXT[rank]] for rank in Rank}}
        )

    def _take_state(self) -> None:
        """Make the state with the present number: the values that have changed since the previous state."""
        self._taken = self.number
        shown = self._values()
        before = self._shown if len(self._shown) == len(shown) else [None] * len(shown)
        self._changed = {i: new for i, (new, old) in enumerate(zip(shown, before, strict=True)) if new != old}
        self._shown = shown
        self._texts = {}
        now = self.reader.now()
        self._new_events, self._event = now.next_event != self._event, now.next_event
        self._new_misses, self._missed = now.missed != self._missed, now.missed

    def state(self, full: bool) -> str:
        """Return the state as JSON: all values, or those that have changed since the last number. The text is made only
        once for all pages."""
        if self._taken != self.number:
            self._take_state()
        if full not in self._texts:
            values = dict(enumerate(self._shown)) if full else self._changed
            events: dict[str, Any] = {"events": self._events()} if full or self._new_events else {}
            if full or self._new_misses:
                events["misses"] = list(self._misses)
            self._texts[full] = json.dumps(self._heading() | events | {"full": full, "values": values})
        return self._texts[full]

    def _heading(self) -> dict[str, Any]:
        frame, stage = self._frame, str(self.stage)
        told: dict[str, Any] = {
            "type": "state", "run": self.run, "number": self.number, "stage": stage, "box": self.box.text,
            "missed": self.reader.now().missed, "lost": self.reader.lost, "start": self.history.start,
            "stop": self.history.stop, "silent": round(time.monotonic() - self._heard, 1), "ages": self._ages(),
            "ending": self.ending and self.ending._asdict(), "utc": self.utc,
        }  # fmt: skip
        if frame is not None:
            told["time"] = float(frame["time"])
        return told | {"facts": self._facts()} | self._clients()

    def _facts(self) -> dict[str, str]:
        """Return the facts of the run as text. A fact is "" if there is nothing to report."""
        reader, frame = self.reader, self._frame
        facts = {"station": reader.title, "state": "", "end": self.ending.text if self.ending else ""}
        facts |= {"control" if name == "lease" else name: text for name, text in reader.facts(frame).items()}
        facts["execution"] = "" if frame is None else duration(int(frame["execution"]) * 1e-9)
        facts["changed"] = self.changed
        facts["not seen"] = f"{reader.lost:,} periods" if reader.lost else ""
        return facts | {"pid": str(self.about["pid"])}

    def _clients(self) -> dict[str, Any]:
        """Return faults, alarms, and the actuators that are inhibited or taken. If the station takes commands, also
        return the mode, the lease and the tunable numbers."""
        reader, frame = self.reader, self._frame
        told: dict[str, Any] = {}
        if frame is not None:
            told["faults"] = faults = reader.faults(frame)
            claims = {reader.paths[slot]: claim for slot, claim in reader.claims(frame, faults).items()}
            told["by_client"] = [path for path, claim in claims.items() if claim.rank is Rank.CLIENT]
            told["inhibited"] = {path: claim.reason for path, claim in claims.items() if claim.rank > Rank.CLIENT}
            told["in_fault"] = [path for path, claim in claims.items() if claim.rank is Rank.FAULT]
            told["taken"] = int(frame["taken"])
            told["alarms"] = [_alarm(row) for row in reader.alarms(frame)]
        if (now := reader.now()).mode is not None:
            tuned = {path: value if np.isfinite(value) else None for path, value in reader.tunables().items()}
            told |= {"mode": str(now.mode), "tuned": tuned}
            told["lease"] = {"number": now.lease, "holder": now.holder}
        return told

    def _events(self) -> list[dict[str, Any]]:
        found = [each.event for each in self.reader.events(self._event - MAX_EVENTS)]
        return [each._asdict() | {"state": str(each.state)} for each in found]

    def _values(self) -> list[Any]:
        """Return value, raw integer and quality of each object, and the value of each signal. None means no value."""
        if self._frame is None:
            return []
        frame = self._frame
        objects = zip(_plain(frame["values"]), frame["raws"].tolist(), frame["quality"].tolist(), strict=True)
        return [*map(list, objects), *([value] for value in _plain(frame["signals"]))]

    def _ages(self) -> dict[int, float | None]:
        """Return the ages of the values that are not new: the time in s since the device returned a value, or None if
        it never did."""
        if self._frame is None:
            return {}
        old = np.flatnonzero(self._frame["quality"] >= Quality.STALE)
        ages = np.round(float(self._frame["time"]) - self._good[old], 3)
        return dict(zip(old.tolist(), _plain(ages), strict=True))

    def line(self) -> dict[str, Any]:
        told = {"name": self.name, "station": self.station, "place": self.place}
        told |= {"stage": str(self.stage), "wiring": self.about["wiring"]}
        told |= {"changed": self.changed} if self.changed else {}
        return told | self._trouble() | ({} if self.ending is None else {"ending": self.ending._asdict()})

    def _trouble(self) -> dict[str, Any]:
        """Return the problems of an active run as text. The text is made anew when the states, or the events with the
        reasons, change."""
        frame = self._frame
        if frame is None or self.ended:
            return {}
        states = frame["equipment"].tobytes(), frame["alarms"].tobytes(), self.reader.now().next_event
        if states != self._troubled:
            faults, alarms = fault_texts(self.reader.faults(frame)), alarms_text(self.reader.alarms(frame))
            self._troubled = states
            self._troubles = {"faults": faults, "alarms": list(map(printable, alarms))}
        return self._troubles

    @property
    def utc(self) -> float | None:
        """The UTC in s since 1970 at which the cycle's time was 0; None for a run that does not keep the pace of the
        wall clock."""
        return self.reader.utc(self._frame)

    @property
    def now(self) -> float:
        """The newest time that pages show, in s on the cycle's clock."""
        return self.history.stop

    @property
    def ended(self) -> bool:
        return self.stage is Stage.ENDED

    def close(self) -> None:
        self.reader.close()


def described_twin(watched: Watched, ask: Callable[[str], dict[str, Any] | None] | None) -> dict[str, Any] | None:
    """Return the twin of a station, or the error in its declaration as `error`, or None if the station declares no
    twin. `ask`: function that requests the twin of a station on another computer by the station's name."""
    try:
        elsewhere = ask if watched.is_elsewhere else None
        found = watched.own_twin() if elsewhere is None else elsewhere(watched.station)
    except UmoError as error:
        return {"error": str(error)}
    return found and found | {"paths": shown_all(found.get("paths", ()))}


def _alarm(row: AlarmRow) -> dict[str, Any]:
    """Return an alarm with the verbs that can be applied to it now."""
    told = row._asdict() | {"state": str(row.state), "priority": str(row.priority), "text": printable(row.text)}
    return told | {"annunciated": row.annunciated, "active": row.active, "asks": row.asks, "verbs": row.verbs}


def _plain(numbers: Any) -> list[float | None]:
    """Return numbers with None instead of NaN and infinities, which JSON does not have."""
    return [value if np.isfinite(value) else None for value in numbers.tolist()]

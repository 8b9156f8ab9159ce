"""A recording as the page sees it: a run of which the time is chosen, with another one laid over it on demand."""

from __future__ import annotations

import shlex
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from umo.cycle.stage import Stage
from umo.frames import Reader
from umo.frames.layout import EVENTS, Live
from umo.frames.memory import RunDescriptors
from umo.frames.ring_copy import RingCopy
from umo.objects import Quality
from umo.page.extremes import Extremes
from umo.page.recorded_history import OverlaidHistory, RecordedHistory
from umo.page.watched_run import Watched
from umo.presentation.described import Described
from umo.process.station import Station, packaged
from umo.recording import Block, Recording
from umo.replay.recorded_wiring import files_among
from umo.replay.tape import NotReplayable
from umo.signature import signature_of
from umo.tables.recording_summary import facts_of, lines_of

MAX_TOLD = 1000
"""Events and missed periods that a page is told of, the last ones."""
MAX_SPEED = 1000.0
SAID = ("started", "length", "periods", "lost", "black boxes", "end", "replay", "file")
"""What of a recording is said beside its values."""
SECOND = "second"
"""What stands before the paths of the other recording."""


class WatchedRecording(Watched):
    """Its ring is a copy that holds the frame of the chosen time. The constructor reads the file once, and takes over
    the recordings; `tell` is called with the share that is read."""

    def __init__(
        self,
        recording: Recording,
        tell: Callable[[float], None] = lambda share: None,
        second: Recording | None = None,
        station: Station | None = None,
    ) -> None:
        """`station`: whose twin is drawn; None: the one that ships or is installed under the recorded name."""
        self._station, self._given = station, station is not None
        self._recordings = [recording, *([] if second is None else [second])]
        writer, readers = RunDescriptors.pair()
        self._ring = RingCopy(recording.layout, writer)
        self._ring.live({Live.STATE: Stage.RUNNING})
        super().__init__(Reader(recording.path, readers))
        self.is_elsewhere = False
        self.name = recording.path.name
        self.run = f"{self.name}-{recording.about.get('started_monotonic', 0)}"
        lines = lines_of(facts_of(recording))
        self._words = "\n".join(f"{name}: {text}" for name, text in lines if name in SAID)
        self._told = _Told(recording)
        shares = len(self._recordings)
        first = RecordedHistory(recording, self._told.add, lambda share: tell(share / shares))
        self._frames, self.history, self.extremes = first, first, self._told.extremes
        self._misses = deque(self._told.misses, maxlen=MAX_TOLD)
        self._second: RecordedHistory | None = None
        if second is not None:
            self._lay_over(second, lambda share: tell((1 + share) / shares))
        self._events_shown = 0
        self._before = time.monotonic()
        self.playing, self.speed = False, 1.0
        self.position = self.history.stop
        """The time that is shown, s on the machine's clock."""
        self._asked: float | None = None
        """The time that a page has asked for last."""
        self._answered: float | None = None
        """The one that was asked for when `read` last showed a time."""
        self._shown_at: float | None = None
        self.read()

    def _twin_place(self) -> Path | None:
        """That of the station that is given, or that ships or is installed: a recording names no code."""
        job = self._recordings[0].job
        if self._station is None and not job.get("machine") and (folder := packaged(str(job.get("station")))):
            self._station = Station(str(job["station"]), folder)
        return None if self._station is None else self._station.path

    def own_twin(self) -> dict[str, Any] | None:
        options = self._recordings[0].about.get("options", {})
        if self._station is not None and files_among(signature_of(self._station.make), options):
            raise NotReplayable(
                "the recorded run had a file as an option, and a recording opens none: there is no twin"
            )
        return super().own_twin()

    def _lay_over(self, other: Recording, tell: Callable[[float], None]) -> None:
        """Have the objects and signals of another recording as signals of this one."""
        told = _Told(other)
        self._second = RecordedHistory(other, told.add, tell)
        self.history = self._overlaid = OverlaidHistory(self._frames, self._second, len(self.entries))
        more = [_as_second(each) for each in (*other.layout.described.objects, *other.layout.described.signals)]
        self.entries += more
        self.columns = {each.path: column for column, each in enumerate(self.entries)}
        self.extremes = told.extremes.behind(self._told.extremes)

    # The time ------------------------------------------------------------------------------------------

    def play(self, time: float | None, playing: bool, speed: float) -> None:
        """Show a time, None: the one that is shown, and go on from there or stand."""
        if time is None and playing and not self.playing and self.position >= self.history.stop:
            time = self.history.start
        if time is not None:
            self._asked = time
            self.position = min(max(time, self.history.start), self.history.stop)
            self.jumps += 1
        self.playing, self.speed = playing, min(max(speed, 0.01), MAX_SPEED)

    @property
    def now(self) -> float:
        return self.position

    def read(self) -> None:
        now = time.monotonic()
        passed, self._before = now - self._before, now
        if self.playing:
            self.position = min(self.position + passed * self.speed, self.history.stop)
            self.playing = self.position < self.history.stop
        self._heard = now
        if self.position != self._shown_at:
            self._show(self.position)
            self._shown_at = self.position
        self._answered = self._asked

    def _show(self, moment: float) -> None:
        _, chunk, row = self._frames.at(moment)
        if not len(chunk.frames):
            return
        frames = chunk.frames[: row + 1]
        self._frame = frames[-1]
        live = self._told.before(int(self._frame["sequence"]) // 2 - 1)
        missed = live.missed + int(frames["missed"][live.row(frames) :].sum())
        self._ring.live({Live.MODE: live.mode, Live.MISSED: missed, Live.TAKEN: int(self._frame["taken"])})
        self._ring.lease(live.lease, live.holder.encode())
        self._ring.tunables(live.tunables)
        self._show_events(float(self._frame["time"]))
        self._ring.frame(frames[-1:].tobytes())
        self._good = live.good_in(frames)

    def _show_events(self, moment: float) -> None:
        events = self._told.events
        stop = bisect_right(events, moment, key=lambda each: each.event.time)
        first = self._events_shown if stop >= self._events_shown else max(stop - EVENTS, 0)
        for number in range(max(first, stop - EVENTS), stop):
            self._ring.event(number, events[number].event)
        self._ring.live({Live.EVENT: stop})
        self._events_shown = stop

    # What pages are told -------------------------------------------------------------------------------

    def description(self) -> dict[str, Any]:
        told = super().description()
        told["signals"] = [each.shown for each in self.entries[len(told["objects"]) :]]
        files = [{"file": each.path.name, "whole": not each.damage, "lost": each.lost} for each in self._recordings]
        first = self._recordings[0]
        words = ["umo", "replay", str(first.path.absolute())]
        if self._given and self._station is not None:
            words.append(str(self._station.path))
        replay = "" if first.replayable_from else shlex.join(words)
        return told | {"recording": {"files": files, "second": SECOND if self._second else "", "replay": replay}}

    def _heading(self) -> dict[str, Any]:
        played = {"time": round(self._shown_at or 0.0, 6), "asked": self._answered}
        played |= {"playing": self.playing, "speed": self.speed}
        return super()._heading() | {"silent": 0, "box": self._words, "recording": played}

    def _facts(self) -> dict[str, str]:
        facts = {name: text for name, text in super()._facts().items() if name not in ("no frame for", "not seen")}
        return facts | {"state": "recorded"}

    def _events(self) -> list[dict[str, Any]]:
        """Those of the whole recording."""
        found = [each.event for each in self._told.events[-MAX_TOLD:]]
        return [each._asdict() | {"state": str(each.state)} for each in found]

    def _values(self) -> list[Any]:
        values = super()._values()
        if self._second is None:
            return values
        other = self.position - self._overlaid.shift
        _, chunk, row = self._second.at(other)
        known = self._second.start <= other <= self._second.stop
        numbers = chunk.samples.values[:, row] if known else np.full(len(chunk.samples.values), np.nan)
        return values + [[value if np.isfinite(value) else None] for value in numbers.tolist()]

    def extremes_for(self, anew: bool) -> Extremes:
        return self.extremes

    def look_around(self) -> None:
        """A recording leaves nothing on the disk."""

    @property
    def path(self) -> Path:
        return self._recordings[0].path

    def close(self) -> None:
        if not self.reader.closed:
            super().close()
            self._ring.close()
        for recording in self._recordings:
            recording.close()


def _as_second(about: Described) -> Described:
    """An object or a signal of the other recording as a signal of this one."""
    kept = {name: fact for name, fact in about.plain.items() if name not in ("kind", "actuator", "wire")}
    return Described(kept | {"path": f"{SECOND}.{about.path}", "second": True})


class _Live:
    """What a run has beside its frames, before a frame."""

    def __init__(
        self, first: int, before: _Live | None, facts: Mapping[str, Any], layout_sizes: tuple[int, int]
    ) -> None:
        """`first`: the number of the frame."""
        objects, tunables = layout_sizes
        self.first = first
        mode, holder, told = facts.get("mode"), facts.get("holder"), facts.get("tunables")
        self.mode = -1 if mode is None else int(mode)
        self.holder = str(holder or "")
        self.lease: int = 0 if before is None else before.lease + (before.holder != self.holder)
        kept = bytes(8 * tunables) if before is None else before.tunables
        self.tunables: bytes = np.array(told, "<f8").tobytes() if told and len(told) == tunables else kept
        self.missed = 0
        self.good = np.full(objects, np.nan)
        """The time at which each object was read last, s; NaN: never."""

    def row(self, frames: Any) -> int:
        """The place of its frame."""
        return max(self.first - (int(frames["sequence"][0]) // 2 - 1), 0)

    def good_in(self, frames: Any) -> Any:
        """The times at which each object was read last, at the end of these frames."""
        return _good(frames[self.row(frames) :], self.good)


class _Told:
    """What a recording says beside its values: missed periods, extremes, and what goes with each block."""

    def __init__(self, recording: Recording) -> None:
        layout = recording.layout
        self._sizes = len(layout.objects), len(layout.tunables)
        self.extremes = Extremes(len(layout.objects), len(layout.signals))
        self.events = recording.events
        self.misses: list[tuple[float, int]] = []
        self._lives: list[_Live] = []
        self._missed, self._good = 0, np.full(len(layout.objects), np.nan)

    def add(self, block: Block) -> None:
        frames = block.frames
        live = _Live(block.first, self._lives[-1] if self._lives else None, block.live, self._sizes)
        live.missed, live.good = self._missed, self._good
        self._lives.append(live)
        if block.is_full:
            self.extremes.add(frames)
        late = np.flatnonzero(frames["missed"])
        self.misses += zip(frames["time"][late].tolist(), frames["missed"][late].tolist(), strict=True)
        self._missed += int(frames["missed"].sum())
        self._good = _good(frames, self._good)

    def before(self, number: int) -> _Live:
        """What the block has in which a frame is."""
        return self._lives[max(bisect_right(self._lives, number, key=lambda live: live.first) - 1, 0)]


def _good(frames: Any, before: Any) -> Any:
    usable = frames["quality"] < Quality.STALE
    last = len(frames) - 1 - np.argmax(usable[::-1], axis=0)
    return np.where(usable.any(axis=0), frames["time"][last], before)

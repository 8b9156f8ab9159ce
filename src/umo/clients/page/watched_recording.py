"""A recording as the page shows it: like a run, but the page selects the time. A second recording can be laid over
it."""

from __future__ import annotations

import shlex
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from umo.clients.page.extremes import Extremes
from umo.clients.page.overlaid_history import OverlaidHistory
from umo.clients.page.watched_run import Watched
from umo.objects.presentation.described import Described
from umo.process.station import Station, packaged
from umo.recording.block import Block
from umo.recording.recorded_history import RecordedHistory
from umo.recording.recording import Recording
from umo.recording.recording_reader import RecordingReader
from umo.recording.replay.recorded_wiring import files_among
from umo.recording.replay.tape import NotReplayable
from umo.recording.tables.recording_summary import facts_of, lines_of
from umo.signature import signature_of

MAX_TOLD = 1000
"""Number of the last events and missed periods that a page receives."""
MAX_SPEED = 1000.0
RECORDING_FACTS = ("started", "length", "periods", "lost", "black boxes", "end", "replay", "file")
"""The facts of a recording that are shown with its values."""
SECOND = "second"
"""The prefix of the paths of the other recording."""


class WatchedRecording(Watched):
    """The recording that a page shows. The constructor reads the file once. `tell` is called with the share that has
    been read. The recordings are closed with this object."""

    def __init__(
        self,
        recording: Recording,
        tell: Callable[[float], None] = lambda share: None,
        second: Recording | None = None,
        station: Station | None = None,
    ) -> None:
        """`station`: the station whose twin is drawn. None means the station that ships with umo or is installed under
        the recorded name."""
        self._station, self._given = station, station is not None
        self._recordings = [recording, *([] if second is None else [second])]
        self._run = RecordingReader(recording)
        super().__init__(self._run)
        self.is_elsewhere = False
        self.name = recording.path.name
        self.run = f"{self.name}-{recording.about.get('started_monotonic', 0)}"
        lines = lines_of(facts_of(recording))
        self._words = "\n".join(f"{name}: {text}" for name, text in lines if name in RECORDING_FACTS)
        seen = _Seen(recording)
        shares = len(self._recordings)

        def add(block: Block) -> None:
            self._run.add(block)
            seen.add(block)

        first = RecordedHistory(recording, add, lambda share: tell(share / shares))
        self._frames, self.history, self.extremes = first, first, seen.extremes
        self._misses = deque(seen.misses, maxlen=MAX_TOLD)
        self._second: RecordedHistory | None = None
        if second is not None:
            self._lay_over(second, lambda share: tell((1 + share) / shares))
        self._before = time.monotonic()
        self.playing, self.speed = False, 1.0
        self.position = self.history.stop
        """The time that is shown, s on the machine's clock."""
        self._asked: float | None = None
        """The time that a page has requested last."""
        self._answered: float | None = None
        """The requested time that `read` has shown last."""
        self._shown_at: float | None = None
        self.read()

    def _twin_place(self) -> Path | None:
        """Return the place of the given station, or else of the station that ships with umo or is installed under the
        recorded name. A recording itself contains no code."""
        job = self._recordings[0].job
        if self._station is None and not job.get("machine") and (folder := packaged(str(job.get("station")))):
            self._station = Station(str(job["station"]), folder)
        return None if self._station is None else self._station.path

    def own_twin(self) -> dict[str, Any] | None:
        options = self._recordings[0].about.get("options", {})
        if self._station is not None and files_among(signature_of(self._station.make), options):
            raise NotReplayable(
                "there is no twin: the recorded run had a file as an option, and a recording opens no files"
            )
        return super().own_twin()

    def _lay_over(self, other: Recording, tell: Callable[[float], None]) -> None:
        """Add the objects and signals of another recording to this one as signals."""
        seen = _Seen(other)
        self._second = RecordedHistory(other, seen.add, tell)
        self.history = self._overlaid = OverlaidHistory(self._frames, self._second, len(self.entries))
        more = [_as_second(each) for each in other.layout.described.traced]
        self.entries += more
        self.columns = {each.path: column for column, each in enumerate(self.entries)}
        self.extremes = seen.extremes.behind(self.extremes)

    # The time ------------------------------------------------------------------------------------------

    def play(self, time: float | None, playing: bool, speed: float) -> None:
        """Show a time, and play from there or pause. None means the time that is shown now."""
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
        self._run.show_last(chunk.frames[: row + 1])
        self._frame, self._good = self._run.latest(), self._run.good

    # What pages are told -------------------------------------------------------------------------------

    def description(self) -> dict[str, Any]:
        told = super().description()
        told["signals"] = [each.shown for each in self.entries[len(told["objects"]) :]]
        files = [{"file": each.path.name, "whole": not each.damage, "lost": each.lost} for each in self._recordings]
        first = self._recordings[0]
        words = ["umo", "recording", "replay", str(first.path.absolute())]
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
        """Return the last events of the whole recording, as plain data."""
        found = [each.event for each in self._recordings[0].events[-MAX_TOLD:]]
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
        """Do nothing, because a recording leaves no files."""

    def close(self) -> None:
        super().close()
        for recording in self._recordings:
            recording.close()


def _as_second(about: Described) -> Described:
    """Return an object or a signal of the other recording as a signal of this recording."""
    kept = {name: fact for name, fact in about.plain.items() if name not in ("kind", "actuator", "wire")}
    return Described(kept | {"path": f"{SECOND}.{about.path}", "second": True})


class _Seen:
    """The extremes and the missed periods in the blocks of a recording that were read so far."""

    def __init__(self, recording: Recording) -> None:
        self.extremes = Extremes(len(recording.layout.objects), len(recording.layout.signals))
        self.misses: list[tuple[float, int]] = []

    def add(self, block: Block) -> None:
        frames = block.frames
        if block.is_full:
            self.extremes.add(frames)
        late = np.flatnonzero(frames["missed"])
        self.misses += zip(frames["time"][late].tolist(), frames["missed"][late].tolist(), strict=True)

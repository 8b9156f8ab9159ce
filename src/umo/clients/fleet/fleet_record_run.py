"""One run of a station while it is recorded: the image that results from its deltas, the data to write, and the
gaps."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from umo.clients.fleet.fleet_record_rows import Gap, RunRows, TakenDelta
from umo.clients.fleet.message_parts import unpacked
from umo.clients.fleet.run_words import FULL_EVERY, Delta, RunMetadata, WordFrame, Words, peek
from umo.cycle.events import CommandState, Event
from umo.errors import FramesError
from umo.process.frames.layout import Layout

VALUES, EVENTS = "values", "events"
MAX_WAITING = 8 << 20
"""Largest number of bytes of deltas that wait for the declaration of their run."""
MAX_EVENTS = 10_000
"""Largest number of events that wait to be written."""
BEFORE, AWAY, LOST = "before it was recorded", "the recorder was away", "they did not arrive"
FULL_DISK, UNDECLARED = "no room on disk", "the station did not declare itself"
"""Reasons for missing data."""
UNKNOWN = RunMetadata(0, -1, 0, 0, b"", b"")


@dataclass
class Recorded:
    """The data of a station that are already in files."""

    last: dict[tuple[str, str], int] = field(default_factory=dict)
    """The last number for each kind of data (values, events) and run."""
    gaps: dict[tuple[str, str, int], int] = field(default_factory=dict)
    """The last number of each gap, by the kind of data, the run and the first number."""


class FollowedRun:
    """A run that is recorded. `recorded`: the data of the run that were in the files when the recorder started. Deltas
    and events must be given in their order."""

    def __init__(self, run: bytes, recorded: Recorded) -> None:
        self.run = run
        self.name = run.hex()
        self.rows: RunRows | None = None
        """The rows, or None before the run is declared."""
        self.last = {of: recorded.last.get((of, self.name), -1) for of in (VALUES, EVENTS)}
        """The last number of each kind of data that is recorded, or that waits to be written."""
        self._known_gaps = recorded.gaps
        self._why = {of: BEFORE if last < 0 else AWAY for of, last in self.last.items()}
        self._words: WordFrame | None = None
        self._image: Words | None = None
        self._seen = -1
        """Number of the delta that the image contains."""
        self._rest = UNKNOWN
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._period = -1
        self.taken: list[TakenDelta] = []
        self.gaps: list[Gap] = []
        self._events: list[tuple[int, Event]] = []
        self.bytes = 0
        """Size of the data to write."""
        self.has_ended = False

    @property
    def wanted(self) -> tuple[int, int]:
        """The numbers of the first delta and the first event to request. The requested deltas begin with one that has
        all words."""
        first = self.last[VALUES] + 1
        return first - first % FULL_EVERY, self.last[EVENTS] + 1

    @property
    def needs_declaration(self) -> bool:
        return bool(self._waiting) or (self.rows is None and bool(self._events))

    # Deltas --------------------------------------------------------------------------------------------

    def take_delta(self, data: bytes) -> None:
        """Take a delta of this run. Raises FramesError if the delta does not fit the run."""
        if not self._waiting and self._follow(data):
            return
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        while self._waiting_bytes > MAX_WAITING:
            self._forget_first()
        if self._words is not None:
            self._go_on()  # this may be one with all words

    def _follow(self, data: bytes) -> bool:
        """Apply a delta. Return False if an earlier one is missing."""
        if self._words is None:
            return False
        delta = self._words.parse(data)
        if delta.number <= self._seen:  # the declaration was of a later one
            return True
        if not delta.is_full and (self._image is None or delta.number != self._seen + 1):
            return False
        self._apply(delta)
        return True

    def _apply(self, delta: Delta) -> None:
        assert self._words is not None
        if self._image is None:
            self._image = np.zeros(self._words.count, np.uint64)
        self._words.apply(delta, self._image)
        if delta.rest:
            self._rest = RunMetadata.parse(delta.rest)
        self._seen = delta.number
        self._record(delta.number, delta.is_last)

    def _record(self, number: int, is_last: bool = False) -> None:
        """Add the image to the data to write, if it is new."""
        self.has_ended |= is_last
        if number <= self.last[VALUES]:
            return
        assert self._image is not None and self.rows is not None
        image = self._image.tobytes()
        self._find_gap(VALUES, number, self.rows.moment(image)[0])
        period = self.rows.period(image)
        if not (is_last and period == self._period):  # the last frame of all has been told before
            self.taken.append(TakenDelta(number, image, self._rest))
            self.bytes += len(image)
        self._period = period

    def _find_gap(self, of: str, number: int, at: int | None) -> None:
        """Record that the data with this number have arrived. If data before them are missing, record a gap."""
        first, self.last[of] = self.last[of] + 1, number
        first = max(first, self._known_gaps.pop((of, self.name, first), -1) + 1)  # told before the recorder was away
        why, self._why[of] = self._why[of], LOST
        if first < number:
            self.gaps.append(Gap(at, of, first, number - 1, why))

    # The declaration -----------------------------------------------------------------------------------

    def take_declaration(self, data: bytes) -> None:
        """Take the declaration. Raises FramesError if the declaration belongs to another run, or is incomplete."""
        about, described, words, rest = unpacked(data)
        facts = json.loads(about)
        if facts["run"] != self.name:
            raise FramesError("another run has begun")
        if self.rows is None:
            layout = Layout.parse(described)
            self._words, self.rows = WordFrame(layout), RunRows(self.name, layout)
        self._go_on()
        if not self._waiting or not words:
            return
        number = int(facts["number"])  # deltas before it need one with all words, which did not come
        while self._waiting and peek(self._waiting[0]).number <= number:
            self._forget_first()
        if number > self._seen:
            self._adopt(number, words, rest)
        self._go_on()

    def _adopt(self, number: int, words: bytes, rest: bytes) -> None:
        assert self._words is not None
        if len(words) != 8 * self._words.count:
            raise FramesError("the declaration does not fit its frames")
        self._image, self._rest, self._seen = np.frombuffer(words, np.uint64).copy(), RunMetadata.parse(rest), number
        self._record(number)

    def _go_on(self) -> None:
        """Apply the waiting deltas. The first one must follow the image, or have all words; waiting deltas before it
        are dropped."""
        while self._waiting:
            try:
                is_used = self._follow(self._waiting[0])
            except FramesError:
                self._forget_first()
                raise
            if not is_used:
                full = next((i for i, each in enumerate(self._waiting) if peek(each).is_full), None)
                if full is None:
                    return
                for _ in range(full):
                    self._forget_first()
            else:
                self._forget_first()

    def _forget_first(self) -> None:
        self._waiting_bytes -= len(self._waiting.popleft())

    def give_up(self) -> bool:
        """Report the deltas that still wait for a declaration as missing. Return True if there were any."""
        if self._waiting:
            number = peek(self._waiting[-1]).number
            self._waiting.clear()
            self._waiting_bytes = 0
            self._why[VALUES] = UNDECLARED
            self._find_gap(VALUES, number + 1, None)
            self.last[VALUES] = self._seen = number
        return bool(self.taken or self.gaps)

    # Events --------------------------------------------------------------------------------------------

    def take_events(self, events: Sequence[Sequence[Any]]) -> None:
        for number, at, path, text, who, command, state, asked in events:
            if number > self.last[EVENTS]:
                self._find_gap(EVENTS, int(number), None)
                event = Event(float(at), path, text, who, int(command), CommandState(state), asked)
                self._events.append((int(number), event))
        if excess := self._events[:-MAX_EVENTS]:
            del self._events[: len(excess)]
            self._drop(EVENTS, [number for number, _ in excess], None)

    def events(self) -> list[tuple[int, int | None, Event]]:
        """Return the events to write, with their UTC in us. The UTC is computed from the machine's clock and the UTC of
        its last frame."""
        if self._image is None or self.rows is None:
            return [(number, None, each) for number, each in self._events]
        utc, now = self.rows.moment(self._image.tobytes())
        return [(number, utc + round((each.time - now) * 1e6), each) for number, each in self._events]

    # What is written -----------------------------------------------------------------------------------

    @property
    def is_written(self) -> bool:
        """True if all received data are written."""
        return not (self.taken or self.gaps or self._events or self._waiting)

    def has_written(self, values: int = 0, events: int = 0, gaps: int = 0) -> None:
        """Record that these numbers of values, events and gaps are in files."""
        self.bytes -= sum(len(each.image) for each in self.taken[:values])
        del self.taken[:values], self._events[:events], self.gaps[:gaps]

    def drop_older_half(self) -> None:
        """Make room: drop the older half of the unwritten data, and report it as missing."""
        dropped = self.taken[: (len(self.taken) + 1) // 2]
        if dropped and self.rows is not None:
            self.has_written(values=len(dropped))
            self._drop(VALUES, [each.number for each in dropped], self.rows.moment(dropped[-1].image)[0])

    def _drop(self, of: str, numbers: list[int], at: int | None) -> None:
        for number in numbers:
            last = next((i for i in range(len(self.gaps) - 1, -1, -1) if self.gaps[i].of == of), None)
            gap = None if last is None else self.gaps[last]
            if last is not None and gap is not None and gap.why == FULL_DISK and gap.last + 1 == number:
                self.gaps[last] = gap._replace(last=number, time=at)
            else:
                self.gaps.append(Gap(at, of, number, number, FULL_DISK))

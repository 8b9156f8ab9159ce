"""One run of a station while it is recorded: its image from deltas, what is to be written, and what is missing."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from umo.cycle.events import CommandState, Event
from umo.errors import FramesError
from umo.fleet.fleet_record_rows import Gap, RunRows, TakenDelta
from umo.fleet.message_parts import unpacked
from umo.fleet.run_words import Delta, Rest, WordFrame, Words, peek
from umo.frames.layout import Layout

VALUES, EVENTS = "values", "events"
MAX_WAITING = 8 << 20
"""Bytes of deltas that wait for the declaration of their run at most."""
MAX_EVENTS = 10_000
"""Events that wait to be written at most."""
BEFORE, AWAY, LOST = "before it was recorded", "the recorder was away", "they did not come"
FULL_DISK, UNDECLARED = "no room on disk", "the station did not declare itself"
"""Why something is missing."""
UNKNOWN = Rest(0, -1, 0, 0, b"", b"")


@dataclass
class Recorded:
    """What the files have of a station already."""

    last: dict[tuple[str, str], int] = field(default_factory=dict)
    """Last number by what it counts (values, events) and run."""
    gaps: dict[tuple[str, str, int], int] = field(default_factory=dict)
    """Last number of each gap by what it counts, run and first number."""


class FollowedRun:
    """`recorded`: what the files had of it when the recorder began. `is_patient`: what was published before it was
    followed may still come, behind what is published now, until `hurry`."""

    def __init__(self, run: bytes, recorded: Recorded, is_patient: bool = False) -> None:
        self.run = run
        self.name = run.hex()
        self.rows: RunRows | None = None
        """None: it has not been declared yet."""
        self.last = {of: recorded.last.get((of, self.name), -1) for of in (VALUES, EVENTS)}
        """The last number that is recorded or is to be written."""
        self._known_gaps = recorded.gaps
        self._why = {of: BEFORE if last < 0 else AWAY for of, last in self.last.items()}
        self._words: WordFrame | None = None
        self._image: Words | None = None
        self._seen = -1
        """Number of the delta of the image."""
        self._rest = UNKNOWN
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._period = -1
        self.taken: list[TakenDelta] = []
        self.gaps: list[Gap] = []
        self._events: list[tuple[int, Event]] = []
        self.bytes = 0
        """Of what is to be written."""
        self.has_ended = False
        self.is_patient = is_patient

    @property
    def needs_declaration(self) -> bool:
        return bool(self._waiting) or (self.rows is None and bool(self._events))

    # Deltas --------------------------------------------------------------------------------------------

    def take_delta(self, data: bytes) -> None:
        """A message of this run. FramesError if it does not fit."""
        if self._waiting or not self._follow(data):
            self._wait(data)

    def hurry(self) -> None:
        """Nothing from before comes any more: go on with what is there."""
        self.is_patient = False
        if self._words is not None:
            self._go_on()

    def _wait(self, data: bytes) -> None:
        """They wait in the order of their numbers."""
        place, number = len(self._waiting), peek(data)[1]
        while place and peek(self._waiting[place - 1])[1] > number:
            place -= 1
        self._waiting.insert(place, data)
        self._waiting_bytes += len(data)
        while self._waiting_bytes > MAX_WAITING:
            self._waiting_bytes -= len(self._waiting.popleft())
        if self._words is not None:
            self._go_on()  # this may be one with all words

    def _follow(self, data: bytes) -> bool:
        """Apply a delta; False: what is before it is missing."""
        number = peek(data)[1]
        if number <= self._seen:  # it came twice
            return True
        if self._words is None:
            return False
        if self._awaits_older and number > self.last[VALUES] + 1:
            return False
        delta = self._words.parse(data)
        if not delta.is_full and (self._image is None or number != self._seen + 1):
            return False
        self._apply(delta)
        return True

    @property
    def _awaits_older(self) -> bool:
        return self.is_patient and self._image is None

    def _apply(self, delta: Delta) -> None:
        assert self._words is not None
        if self._image is None:
            self._image = np.zeros(self._words.count, np.uint64)
        self._words.apply(delta, self._image)
        if delta.rest:
            self._rest = Rest.parse(delta.rest)
        self._seen = delta.number
        self._record(delta.number, delta.is_last)

    def _record(self, number: int, is_last: bool = False) -> None:
        """Have the image written, if it is new."""
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
        """Note what is missing before a number, and that the number is there."""
        first, self.last[of] = self.last[of] + 1, number
        first = max(first, self._known_gaps.pop((of, self.name, first), -1) + 1)  # told before the recorder was away
        why, self._why[of] = self._why[of], LOST
        if first < number:
            self.gaps.append(Gap(at, of, first, number - 1, why))

    # The declaration -----------------------------------------------------------------------------------

    def take_declaration(self, data: bytes) -> None:
        """FramesError if it is of another run, or not whole."""
        about, described, words, rest = unpacked(data)
        facts = json.loads(about)
        if facts["run"] != self.name:
            raise FramesError("another run has begun")
        if self.rows is None:
            layout = Layout.parse(described)
            self._words, self.rows = WordFrame(layout), RunRows(self.name, layout)
        self._go_on()
        if not self._waiting or not words or self._awaits_older:
            return
        number = int(facts["number"])  # deltas before it need one with all words, which did not come
        while self._waiting and peek(self._waiting[0])[1] <= number:
            self._waiting_bytes -= len(self._waiting.popleft())
        if number > self._seen:
            self._adopt(number, words, rest)
        self._go_on()

    def _adopt(self, number: int, words: bytes, rest: bytes) -> None:
        assert self._words is not None
        if len(words) != 8 * self._words.count:
            raise FramesError("the declaration does not fit its frames")
        self._image, self._rest, self._seen = np.frombuffer(words, np.uint64).copy(), Rest.parse(rest), number
        self._record(number)

    def _go_on(self) -> None:
        """Apply those that wait, from the first one that can be: one with all words, or the one that follows."""
        while self._waiting:
            if not self._follow(self._waiting[0]):
                if self._awaits_older:
                    return
                full = next((i for i, each in enumerate(self._waiting) if self._is_full(each)), None)
                if full is None:
                    return
                for _ in range(full):
                    self._waiting_bytes -= len(self._waiting.popleft())
                continue
            self._waiting_bytes -= len(self._waiting.popleft())

    def _is_full(self, data: bytes) -> bool:
        assert self._words is not None
        return self._words.parse(data).is_full

    def give_up(self) -> bool:
        """Announce what still waits for a declaration; whether something did."""
        if self._waiting:
            number = peek(self._waiting[-1])[1]
            self._waiting.clear()
            self._waiting_bytes = 0
            self._why[VALUES] = UNDECLARED
            self._find_gap(VALUES, number + 1, None)
            self.last[VALUES] = self._seen = number
        return bool(self.taken or self.gaps)

    # Events --------------------------------------------------------------------------------------------

    def take_events(self, told: Mapping[str, Any]) -> None:
        for number, at, path, text, who, command, state, asked in told["events"]:
            if number > self.last[EVENTS]:
                self._find_gap(EVENTS, int(number), None)
                event = Event(float(at), path, text, who, int(command), CommandState(state), asked)
                self._events.append((int(number), event))
        if excess := self._events[:-MAX_EVENTS]:
            del self._events[: len(excess)]
            self._drop(EVENTS, [number for number, _ in excess], None)

    def events(self) -> list[tuple[int, int | None, Event]]:
        """Those that are to be written, with their UTC in us: the machine's clock against that of its last frame."""
        if self._image is None or self.rows is None:
            return [(number, None, each) for number, each in self._events]
        utc, now = self.rows.moment(self._image.tobytes())
        return [(number, utc + round((each.time - now) * 1e6), each) for number, each in self._events]

    # What is written -----------------------------------------------------------------------------------

    def has_written(self, values: int = 0, events: int = 0, gaps: int = 0) -> None:
        """So many of each are in files."""
        self.bytes -= sum(len(each.image) for each in self.taken[:values])
        del self.taken[:values], self._events[:events], self.gaps[:gaps]

    def drop_older_half(self) -> None:
        """Make room: forget the older half of what could not be written, and announce it."""
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

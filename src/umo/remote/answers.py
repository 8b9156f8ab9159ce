"""Answers of a running machine to a command: events in its frames."""

from __future__ import annotations

import time

from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError
from umo.frames import Reader

ANSWER_TIMEOUT = 5.0
"""s within which the machine takes a command; five periods if they are longer."""


class Answers:
    """The answers to the command of this number. `start`: the number of the next event before it was sent."""

    def __init__(self, reader: Reader, number: int, start: int) -> None:
        self.begun = False
        """An action has begun; its end is still to come."""
        self._reader = reader
        self._number = number
        self._next = start
        self._limit = max(ANSWER_TIMEOUT, 5 * reader.about["period"])
        self._until = time.monotonic() + self._limit

    def new(self) -> list[Event]:
        """New answers since the last look. CommandRefused if none has come in time, FramesError if none can come any
        more."""
        ended = self._reader.state is Stage.ENDED  # before the events: the last of them may be the answer
        events = self._reader.events(self._next)
        if events:
            self._next = events[-1].number + 1
        found = [each.event for each in events if each.event.command == self._number]
        self.begun = self.begun or bool(found)
        if not found and ended:
            raise FramesError(f"{self._reader.about['station']} has ended before it answered")
        if not self.begun and time.monotonic() > self._until:
            raise CommandRefused(f"the machine has not answered within {self._limit:g} s")
        return found

    def end(self) -> Event | None:
        """The last answer, if it has come."""
        return next((event for event in self.new() if event.state is not CommandState.BEGUN), None)

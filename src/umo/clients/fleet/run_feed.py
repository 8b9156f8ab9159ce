"""Delivers the deltas and events of one run in the order of their numbers, each once, and requests missing ones. Zenoh
drops messages that it cannot send, and messages that are in transit when a router or a gateway is killed. The gateway
keeps what it has published (`umo.clients.fleet.kept_deltas`), and sends it again from a requested number on. This
module neither waits nor sends: the caller sends what `request` returns (`umo.clients.fleet.past_queries`), and passes
the answers to `take_past`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import inf
from typing import Any, NamedTuple

from umo.clients.fleet.message_parts import unpacked
from umo.clients.fleet.run_words import peek

RETRY_DELAY = 1.0
"""Time in s after which a query without an answer is sent again."""
TRIES = 20
"""Number of unanswered queries after which the missing data count as lost."""
SILENCE, LONGEST_SILENCE = 2.0, 8.0
"""Shortest and longest time in s without data of a run after which its gateway is asked whether the run has
continued."""
AHEAD = 1000
"""Largest number by which a delta may be ahead of the last delta of its gateway. The origin of a delta that is further
ahead is unknown."""
MAX_HELD = 8 << 20
"""Largest number of bytes of deltas that wait for earlier ones. Deltas beyond this limit are dropped and requested
again."""


class Missing(NamedTuple):
    """The numbers of the first missing delta and of the first missing event."""

    run: bytes
    delta: int
    event: int


class RunFeed:
    """The feed of one run. `delta` and `event` are the numbers of the first delta and the first event to deliver. `now`
    is always in s of the monotonic clock."""

    def __init__(self, run: bytes, delta: int, event: int, now: float) -> None:
        self.run, self.delta, self.event = run, delta, event
        self._last_delta, self._last_event = delta - 1, event - 1
        """The largest numbers of a delta and of an event that are known to exist."""
        self._held: dict[int, bytes] = {}
        self._held_bytes = 0
        self._deltas: list[bytes] = []
        self._events: list[list[Any]] = []
        self._asked = -inf
        self._tries = 0
        """Number of consecutive requests without an answer."""
        self._heard, self._silence = now, SILENCE
        self.is_over = False
        """True if the last delta of the run has arrived."""

    # What comes ----------------------------------------------------------------------------------------------

    def take_delta(self, data: bytes, now: float) -> bool:
        """Take a delta as it was published. Return False if it has arrived before. Raises FramesError if the delta is
        malformed."""
        head = peek(data)
        if head.number < self.delta:
            return False
        self._heard, self._silence = now, SILENCE
        self._last_delta = max(self._last_delta, head.number)
        self._last_event = max(self._last_event, head.events - 1)
        self._hold(head.number, data)
        self._go_on()
        return True

    def leave_out(self, delta: int) -> None:
        """Record that missing deltas before this number will not arrive any more."""
        if delta > self.delta:
            self._skip_to(delta)
            self._go_on()

    def leave_out_events(self, event: int) -> None:
        """Record that missing events before this number will not arrive any more."""
        self.event = max(self.event, event)

    def take_events(self, told: Mapping[str, Any]) -> None:
        """Take a message with events as it was published. Missing events with lower numbers are requested."""
        events = told["events"]
        self._last_event = max(self._last_event, int(events[-1][0]))
        if int(events[0][0]) <= self.event:
            self._add_events(events)

    def take_past(self, data: bytes) -> None:
        """Take the answer to a request. It contains the data of the gateway from the requested number on. Raises
        FramesError if it is malformed."""
        about, *deltas = unpacked(data)
        facts = json.loads(about)
        before = self.delta, self.event
        self._tries = 0
        self._add_events(facts["events"])
        self.event = max(self.event, int(facts["event"]))
        self._last_event = self.event - 1
        for each in deltas:
            if (number := peek(each).number) >= self.delta:
                self._skip_to(number)  # nobody has what is between
                self._hold(number, each)
                self._go_on()
        head = int(facts["head"])
        for number in [each for each in self._held if each > head + AHEAD]:
            self._held_bytes -= len(self._held.pop(number))
        self._last_delta = max(head, self.delta - 1, *self._held)
        if before != (self.delta, self.event):
            self._asked = -inf  # there may be more

    def _add_events(self, events: list[list[Any]]) -> None:
        for event in events:
            if (number := int(event[0])) >= self.event:
                self._events.append(event)
                self.event = number + 1

    def _hold(self, number: int, data: bytes) -> None:
        """Keep a delta until its turn."""
        if number > self.delta and self._held_bytes + len(data) > MAX_HELD:
            return
        self._held_bytes += len(data) - len(self._held.get(number, b""))
        self._held[number] = data

    def _go_on(self) -> None:
        """Deliver the held deltas that follow the last delivered one without a gap."""
        while (data := self._held.pop(self.delta, None)) is not None:
            self._held_bytes -= len(data)
            self._deltas.append(data)
            self.delta += 1

    def _skip_to(self, number: int) -> None:
        """Deliver the held deltas before this number, and give up the missing ones."""
        for each in sorted(each for each in self._held if each < number):
            data = self._held.pop(each)
            self._held_bytes -= len(data)
            self._deltas.append(data)
        self.delta = number

    def restart(self, number: int) -> None:
        """Continue with this number, whatever data have arrived so far."""
        self._held.clear()
        self._held_bytes = 0
        self._deltas.clear()
        self.delta, self._last_delta = number, number - 1

    # What is taken from it -------------------------------------------------------------------------------------

    def events(self) -> list[list[Any]]:
        """Return the next events. Each has its number, then the fields of `umo.cycle.events.Event`."""
        events, self._events = self._events, []
        return events

    def deltas(self) -> list[bytes]:
        """Return the next deltas. If a number is missing, that delta was lost. The last delta of a run is returned
        after all events of the run."""
        deltas, self._deltas = self._deltas, []
        if deltas and (last := peek(deltas[-1])).is_last:
            self._last_event = max(self._last_event, last.events - 1)  # an answer knows less: it is older, or was full
            if self.event <= self._last_event:
                self._deltas = [deltas.pop()]
            else:
                self.is_over = True
        return deltas

    # What is asked for -----------------------------------------------------------------------------------------

    @property
    def _is_missing(self) -> bool:
        return self.delta <= self._last_delta or self.event <= self._last_event

    def request(self, now: float) -> Missing | None:
        """Return what to request now, or None."""
        if self.is_over or now - self._asked < RETRY_DELAY:
            return None
        if not self._is_missing:
            if now - self._heard < self._silence:
                return None
            self._heard, self._silence = now, min(2 * self._silence, LONGEST_SILENCE)
            self._tries = 0
        elif self._tries == TRIES:
            self.give_up()
            return None
        self._asked = now
        self._tries += 1
        return Missing(self.run, self.delta, self.event)

    @property
    def holds_nothing(self) -> bool:
        return not (self._held or self._deltas or self._events)

    def give_up(self) -> None:
        """Continue with the data that have arrived, because there is no answer."""
        self._tries = 0
        self.event = self._last_event + 1
        self._skip_to(min(self._held, default=self._last_delta + 1))
        self._go_on()

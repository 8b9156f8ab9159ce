"""The faults of equipment in one run, and the errors in its program, taken from the events of the run."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from umo.cycle.events import FAULT, FAULT_CLEARED, FAULT_PREFIX, MISTAKE, Event, Events
from umo.objects.presentation.run_facts import clock_text

KEPT_FAULTS = 1000
"""The number of the most recent faults that are kept. All faults are counted."""
KEPT_MISTAKES = 100
"""The largest number of mistakes that are kept; these are the first ones of the run."""


@dataclass
class EquipmentFaultRecord:
    """One fault of one part of the machine."""

    path: str
    time: float
    """The time in s on the cycle's clock at which the equipment entered the fault."""
    reason: str
    cleared: float | None = None
    """Time in s at which the fault was cleared, or None if it was not cleared."""

    def __str__(self) -> str:
        if self.cleared is None:
            return f"in fault since {clock_text(self.time)}: {self.reason}"
        return f"in fault from {clock_text(self.time)} to {clock_text(self.cleared)}: {self.reason}"


@dataclass
class MistakeRecord:
    """One error in the program, recorded once."""

    path: str
    """The object that the error concerns."""
    time: float
    """Time in s on the cycle's clock at which the mistake was seen."""
    text: str


class FaultLog:
    """A log that counts the faults, and keeps the last faults and the first errors of the program."""

    def __init__(self) -> None:
        self.number = 0
        """Total number of faults."""
        self.last: deque[EquipmentFaultRecord] = deque(maxlen=KEPT_FAULTS)
        self.standing: dict[str, EquipmentFaultRecord] = {}
        """The faults that have not been cleared, by the path of the equipment."""
        self.mistakes: list[MistakeRecord] = []
        self.next = 0
        """The number of the event that is added next."""

    def add(self, event: Event) -> None:
        """Add the next event; other events are ignored."""
        if event.command or event.who:  # of a client
            return
        if event.asked == FAULT:
            fault = EquipmentFaultRecord(event.path, event.time, event.text.removeprefix(FAULT_PREFIX))
            self.number += 1
            self.last.append(fault)
            self.standing[event.path] = fault
        elif event.text == FAULT_CLEARED and (cleared := self.standing.pop(event.path, None)):
            cleared.cleared = event.time
        elif event.asked == MISTAKE and len(self.mistakes) < KEPT_MISTAKES:
            self.mistakes.append(MistakeRecord(event.path, event.time, event.text))

    def add_new(self, events: Events) -> list[Event]:
        """Add the new events of a machine in this process that are still kept, and return them."""
        if events.told == self.next and not events.untold:
            return []
        new = events.number - self.next
        self.next = events.number
        found = list(events)[-new:] if new else []
        for event in found:
            self.add(event)
        return found

"""Events: actions of guards, clients and the machine itself, in their order. Within a period they are noted as data.
They are formatted, logged and shown to other processes when the outputs of the period have been sent
(docs/decisions/0060).
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, overload

from umo.objects.node import Node
from umo.system.streams import log_without_waiting
from umo.text import NamedNumber, some

log = logging.getLogger("umo")
KEPT_EVENTS = 1000
"""The number of the most recent events that are kept."""
LIMIT_COUNT, LIMIT_TIME = 3, 60.0
"""Largest number of absences of one driver that are recorded within this time in s, including their ends."""
EVENTS_PER_PERIOD = 20
"""The largest number of events and lines of the log in a period, not counting answers to clients. Further events follow
in the next periods."""
MOST_WAITING = 1000
"""The largest number of events that may wait for a later period. Faults and ends of holds are not counted and always
wait. If there are more events, the oldest are left out, and an event reports their number."""
EVENT_TEXT_BYTES = 448
"""The length of an event's text that other processes see, in bytes of UTF-8."""
END = "end"
"""`Event.asked` of the last event of a run. The state of this event is DONE (the application has ended), CANCELLED (the
run was stopped) or FAILED. It has no number of a command."""


LET_GO = "let go"
"""`Event.asked` for the end of a client's hold. If several holds end for one reason, such as the end of the lease, one
event without a number of a command covers all."""
FAULT = "fault"
"""`Event.asked` of the event which says that the equipment at its path has entered a fault."""
FAULT_PREFIX = "in fault: "
"""The beginning of the text of a FAULT event; the reason follows."""
FAULT_CLEARED = "fault cleared"
"""The text of the event which says that the fault of the equipment at its path has ended."""
MISTAKE = "mistake"
"""`Event.asked` for an error in the program, at the object concerned. The error is recorded once, and the run
continues."""
ALARM = "alarm"
"""`Event.asked` of a change of the alarm at its path; the text begins with its new state (`umo.operation.alarms`)."""


class CommandState(NamedNumber):
    """The state of a command. The numbers are stored in shared memory and keep their meaning."""

    NONE = 0
    """The event does not belong to a command."""
    BEGUN = 1
    """An action, or a change to automatic mode, has begun; another event reports its end. Further events with this
    state report the progress of an action."""
    DONE = 2
    REFUSED = 3
    """The command is not allowed or not valid. Nothing was changed."""
    FAILED = 4
    """The command was carried out, and failed."""
    CANCELLED = 5


class EventLimit:
    """The limit of the events of one source, `LIMIT_COUNT` within `LIMIT_TIME`, so that a source that changes rapidly
    does not displace all other events."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=LIMIT_COUNT)
        self._left_out = 0

    def admit(self, now: float) -> int | None:
        """Return the number of events that were left out before the present event, which happens at a time in s. Return
        None if the present event is left out, too."""
        if len(self._times) == LIMIT_COUNT and now - self._times[0] < LIMIT_TIME:
            self._left_out += 1
            return None
        self._times.append(now)
        left_out, self._left_out = self._left_out, 0
        return left_out


def limited(time: float, path: str, text: str, left_out: int) -> Event:
    """Return an event that an `EventLimit` has admitted, with the number of events that the limit has left out
    before."""
    return Event(time, path, f"{text} ({left_out} earlier events of this kind were not stored)" if left_out else text)


class Event(NamedTuple):
    """Something that has happened: its time (in s on the cycle's clock), the path of the object, and a text."""

    time: float
    path: str
    text: str
    """The text; for a command that has ended, its result as JSON, or its error."""
    who: str = ""
    """The client; empty means the machine itself."""
    command: int = 0
    """The number of a client's command, from 1."""
    state: CommandState = CommandState.NONE
    asked: str = ""
    """The command as text."""

    @property
    def is_end(self) -> bool:
        """True if it is the end of the run."""
        return self.asked == END and not self.command


class Note(NamedTuple):
    """Something that has happened and is not an event yet."""

    event: Event | Callable[[], Event | str]
    """The event, a function that formats it, or a line that is only logged."""
    logged: bool
    is_answer: bool
    """True if the note becomes an event in its period."""
    is_needed: bool
    """True if the note always becomes an event, perhaps in a later period."""


class Events(Sequence[Event]):
    """The last events. Readers in this process also find events that were only noted so far; `tell` logs these and
    shows them to other processes later."""

    def __init__(self) -> None:
        self._kept: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.untold = False
        """True if there are notes that must become events. The attribute is checked after the outputs of a period were
        sent."""
        self._noted: deque[Note] = deque()
        """The notes since the last period."""
        self._waiting: deque[Note] = deque()
        """The notes of earlier periods."""
        self._spare = 0
        """The number of waiting notes that may be left out."""
        self._lines: deque[tuple[str, float | None]] = deque()
        """The lines for the log that are already formatted, with the times of their events."""
        self.told = 0
        """The number of events that were formatted so far."""

    def add(self, event: Event | Callable[[], Event], *, logged: bool = False, needed: bool = False) -> None:
        """Add an event, or a function that makes the event later. `logged`: also write the event to the log, as a
        warning. `needed`: the event is never left out, like the answers to clients."""
        self.untold = True
        is_answer = isinstance(event, Event) and event.command > 0
        self._noted.append(Note(event, logged, is_answer, needed))

    def log(self, line: Callable[[], str]) -> None:
        """Add a warning for the log only; the function formats the warning later."""
        self.untold = True
        self._noted.append(Note(line, True, False, False))

    def tell(self) -> None:
        """Format and log the noted events after the outputs of a period were sent: all answers to clients, and the
        first of the other events."""
        room = EVENTS_PER_PERIOD
        while self._waiting and room:
            self._take_waiting()
            room -= 1
        while self._noted:
            note = self._noted.popleft()
            if note.is_answer:
                self._take(note)
            elif room:
                self._take(note)
                room -= 1
            else:
                self._waiting.append(note)
                self._spare += not note.is_needed
        if self._spare > MOST_WAITING:
            self._leave_out(self._spare - MOST_WAITING)
        self._log()

    def tell_all(self) -> None:
        """Format all notes as events, because no period follows."""
        self._take_all()
        self._log()

    def _leave_out(self, count: int) -> None:
        """Leave out this number of the oldest notes that wait; an event and a line of the log say so."""
        waiting, left = self._waiting, count
        self._waiting = deque()
        for note in waiting:
            if left and not note.is_needed:
                left -= 1
            else:
                self._waiting.append(note)
        self._spare -= count
        time = self._kept[-1].time if self._kept else 0.0
        text = f"{count:,} events were not stored: there were more than {EVENTS_PER_PERIOD} in one period"
        self._take(Note(Event(time, "", text), True, False, True))

    def _take_all(self) -> None:
        while self._waiting:
            self._take_waiting()
        while self._noted:
            self._take(self._noted.popleft())

    def _take_waiting(self) -> None:
        note = self._waiting.popleft()
        self._spare -= not note.is_needed
        self._take(note)

    def _take(self, note: Note) -> None:
        found = note.event if isinstance(note.event, Event) else note.event()
        if isinstance(found, Event):
            self.told += 1
            self._kept.append(found)
        if note.logged:
            line = (found, None) if isinstance(found, str) else (f"{found.path} {found.text}".lstrip(), found.time)
            self._lines.append(line)

    def _log(self) -> None:
        while self._lines:
            log_without_waiting(log, *self._lines.popleft())
        self.untold = bool(self._noted or self._waiting)

    @property
    def number(self) -> int:
        """Number of all events so far."""
        self._take_all()
        return self.told

    def recent(self, count: int) -> list[Event]:
        """Return the last events, but no more than this number."""
        kept = self._kept
        return [kept[place] for place in range(-min(count, len(kept)), 0)]

    def __len__(self) -> int:
        self._take_all()
        return len(self._kept)

    def __iter__(self) -> Iterator[Event]:
        self._take_all()
        return iter(self._kept.copy())

    @overload
    def __getitem__(self, place: int) -> Event: ...
    @overload
    def __getitem__(self, place: slice) -> list[Event]: ...
    def __getitem__(self, place: int | slice) -> Event | list[Event]:
        self._take_all()
        return list(self._kept)[place] if isinstance(place, slice) else self._kept[place]


class Paths(Sequence[str]):
    """The paths of objects. Each path is made when it is read."""

    def __init__(self, items: Sequence[Node], places: Sequence[int]) -> None:
        """`places`: the indices of the objects among the items."""
        self._items, self._places = items, places

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, number: int) -> str: ...
    @overload
    def __getitem__(self, number: slice) -> list[str]: ...
    def __getitem__(self, number: int | slice) -> str | list[str]:
        if isinstance(number, slice):
            return [self._items[place]._path for place in self._places[number]]
        return self._items[self._places[number]]._path

    @property
    def around(self) -> str:
        """The path of the innermost compound that contains all the objects; "" means the machine."""
        compounds = {id(parent): parent for place in self._places if (parent := self._items[place]._parent)}
        common: list[Node] = []
        for number, compound in enumerate(compounds.values()):
            outer = _with_outer(compound)
            common = outer if number == 0 else [one for one, other in zip(common, outer, strict=False) if one is other]
            if len(common) == 1:
                break
        return common[-1]._path


def _with_outer(node: Node | None) -> list[Node]:
    """Return the objects from the machine down to this one."""
    found: list[Node] = []
    while node is not None:
        found.append(node)
        node = node._parent
    return found[::-1]


def of_several(time: float, paths: Paths, alone: str, together: str) -> Event:
    """Return one event for one cause that concerns any number of objects. For one object, the event is at its path and
    has the text `alone`. For several objects, the event is at the path of the innermost compound around them; its text
    consists of `together` and their paths."""
    if len(paths) == 1:
        return Event(time, paths[0], alone)
    return Event(time, paths.around, f"{together}: {some(paths)}")


def around(paths: Sequence[str]) -> str:
    """Return the path of the innermost compound around these objects; "" for the machine."""
    first, last = min(paths).split("."), max(paths).split(".")
    same = 0
    while same < min(len(first), len(last)) - 1 and first[same] == last[same]:
        same += 1
    return ".".join(first[:same])

"""The detection of two writers that write one actuator although the first one has not released it. One event reports
this (docs/decisions/0082). The code is called only when the writer of an actuator changes: with the extension in C at
any write (`writes.py`), without it only in some periods (`sampled_writes.py`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import FrameType, MethodType
from typing import Any, NamedTuple, cast

from umo.cycle import wait_graph
from umo.cycle.columns import LAST, NOW, TOLD, UNSEEN
from umo.cycle.events import MISTAKE, Event, Paths
from umo.cycle.image import Image
from umo.cycle.sequences import Task
from umo.cycle.writes import CalledAction, ImageWrites, Turn, make_writes
from umo.objects import Compound
from umo.text import CodePlace, in_brackets, is_users, shown_place, some

MACHINE = {
    str(Path(__file__).with_name(name)) for name in ("acting_laws.py", "part_periods.py", "period.py", "sequences.py")
}
"""The files that call laws, sequences and actions."""
LOOKED_AT = 100
"""The largest number of actuators whose changes of writers are examined in a period."""


class _Loop:
    """The writer that is the program's own loop, between `sample`, `control` and `update`."""


LOOP = _Loop()


class WriterSeen(NamedTuple):
    """The writer of an actuator, and the period since which it writes."""

    turn: object
    """The task that was advanced at the first write, in the form that `ImageWrites` compares."""
    who: Task | Compound | CalledAction | _Loop | None
    """The writer: a sequence, the compound that has the law, an action of a client, or the program's loop. None for a
    writer that may always write, such as a hook of a suspension."""
    place: CodePlace | None
    """The place in the code at which the writer first wrote the actuator."""
    number: int
    """The number of the period of this write."""
    at_default: bool = False
    """True if the first value was the default."""
    taken_from: WriterSeen | None = None
    """The previous writer, if it had not released the actuator."""

    @property
    def has_stopped(self) -> bool:
        """True if the writer has taken the actuator from another writer to bring the actuator to its default."""
        return self.at_default and self.taken_from is not None

    @property
    def is_sequence(self) -> bool:
        return isinstance(self.who, Task)

    def text(self, *, in_full: bool = False) -> str:
        """Return the writer as text. `in_full`: with details that distinguish a sequence from others of its name."""
        if isinstance(self.who, Task):
            shown = self.who.shown
            name = f"{shown.name}{in_brackets(shown.details)}" if in_full else shown.name
        elif isinstance(self.who, Compound):
            name = control_of(self.who)
        elif isinstance(self.who, CalledAction):
            name = str(self.who)
        else:
            name = "the program's loop"
        return name + in_brackets(shown_place(self.place))


def control_of(compound: Compound) -> str:
    """Return the law of a compound, as text."""
    return f"control of {compound._path or type(compound).__name__}"


class TwoWriters:
    """The detection of the code that writes the actuators of one connected machine."""

    def __init__(self, image: Image, turn: Turn) -> None:
        self._image, self._turn = image, turn
        self._written: Any = image.columns.written.data
        self._writers: dict[int, WriterSeen] = {}
        """The writers of the examined actuators, by slot."""
        self._number = -1
        """Number of the period."""
        self._looked_at: set[int] = set()
        """The slots whose changes are examined in this period."""
        self._found: dict[tuple[object, object], list[int]] = {}
        """The slots for an event, by the two places of the writes: slots that are written at the same two places share
        an event."""
        columns = image.columns
        views = image.restrictions, image.pending, self._written, columns.owners.data
        self.writes: ImageWrites | None = make_writes(*views, turn, image.command, self.changed)

    def changed(self, slots: Sequence[int], before: Sequence[float], values: Sequence[float]) -> None:
        """Record that a writer other than the previous one is about to write other values to these actuators."""
        if self._number != self._image.clock.number:
            self._number = self._image.clock.number
            self._looked_at.clear()
        new = None
        for slot, pending, value in zip(slots, before, values, strict=True):
            if slot in self._looked_at or len(self._looked_at) < LOOKED_AT:
                self._looked_at.add(slot)
                new = new or self._writer()
                self._writers[slot] = self._next(slot, new, pending, value)
            else:
                self._writers.pop(slot, None)

    def _next(self, slot: int, new: WriterSeen, pending: float, value: float) -> WriterSeen:
        """Return the new writer of an actuator. Two writers are reported."""
        former, default = self._writers.get(slot), self._image.scales.defaults[slot]
        written = self._written[slot]
        self._written[slot] = written & ~UNSEEN
        if former is None or former.who is new.who or written & UNSEEN:
            return new
        written = self._bits(slot)
        holds = (pending != default or former.has_stopped) and _holds(former, new, written)
        if _are_two(former, new, holds, written):
            self._tell(slot, former, new)
        taken_from = former._replace(taken_from=None) if holds else None
        return new._replace(at_default=bool(value == default), taken_from=taken_from)

    def _bits(self, slot: int) -> int:
        """Return when the actuator was written last, as the bits of the column `written`. For an asynchronous actuator
        the time of sending decides, because each write is sent at once."""
        if not self._image.deliveries[slot].at_once:
            return int(self._written[slot])
        clock, time = self._image.clock, self._image.times[slot]
        return NOW if time >= clock.now else LAST if time >= clock.now - 1.5 * clock.dt else 0

    def _writer(self) -> WriterSeen:
        """Return the writer that is now being carried out."""
        task, law = self._turn.task, self._turn.law
        place, is_called = _where()
        who: Any = None if is_called else LOOP
        if task is not None:
            who = task if task.started.of_application else task.started.action
        elif isinstance(law, CalledAction):
            who = law
        elif law is not None:
            who = cast(MethodType, law).__self__
            place = place or _place_of(law)
        return WriterSeen(law if task is None else task, who, place, self._image.clock.number)

    # ChangeEvents -------------------------------------------------------------------------------------------

    def _tell(self, slot: int, former: WriterSeen, new: WriterSeen) -> None:
        self._written[slot] |= TOLD
        key = former.place, new.place
        if key not in self._found:
            self._found[key] = []
            self._image.events.add(partial(self._event, self._image.clock.now, former, new), logged=True)
        self._found[key].append(slot)

    def _event(self, now: float, former: WriterSeen, new: WriterSeen) -> Event:
        paths = Paths(self._image.items, sorted(self._found.pop((former.place, new.place))))
        names = former.text(), new.text()
        if names[0] == names[1]:
            names = former.text(in_full=True), new.text(in_full=True)
        both = f"{' and '.join(names)}; the last value counts. {_advice(former, new)}"
        if len(paths) == 1:
            return Event(now, paths[0], f"written by two: {both}", asked=MISTAKE)
        return Event(now, paths.around, f"{some(paths)} are written by two: {both}", asked=MISTAKE)


def _advice(former: WriterSeen, new: WriterSeen) -> str:
    if former.is_sequence and new.is_sequence:
        return "Let one await the other, or both share a Lock"
    return "Let only one of them write it; the other one can set an attribute with the value to write"


def _are_two(former: WriterSeen, new: WriterSeen, holds: bool, written: int) -> bool:
    """Return True if both write the actuator, in one period or in turns."""
    if holds and written & NOW:
        return True
    is_back = former.taken_from is not None and former.taken_from.who is new.who
    return is_back and (former.number == new.number or (holds and former.is_sequence and new.is_sequence))


def _holds(former: WriterSeen, new: WriterSeen, written: int) -> bool:
    """Return True if the earlier writer has not released the actuator."""
    who = former.who
    if who is None or new.who is None:
        return False
    if isinstance(who, CalledAction):  # it may have done its work, so only its period counts
        return bool(written & NOW) and not isinstance(new.who, CalledAction)
    if not isinstance(who, Task):
        return bool(written & (NOW | LAST))
    if any(each.paused or cast(Task, each).done for each in who.lineage):
        return False
    return not (isinstance(new.who, Task) and _is_agreed(who, new.who))


def _is_agreed(former: Task, new: Task) -> bool:
    """Return True if the first sequence waits for the second, or the second has a lock that both use."""
    locks = [lock for each in new.lineage for lock in each.holds]
    return wait_graph.awaits(former, new) or any(each in lock._users for lock in locks for each in former.lineage)


def _where() -> tuple[CodePlace | None, bool]:
    """Return the line of the user's code that writes (None if only umo's own code writes), and True if the machine has
    called this code."""
    frame: FrameType | None = sys._getframe(1)
    place = None
    while frame is not None and (file := frame.f_code.co_filename) not in MACHINE:
        if place is None and is_users(file):
            place = CodePlace(file, frame.f_lineno, frame.f_code.co_name)
        frame = frame.f_back
    return place, frame is not None


def _place_of(law: MethodType) -> CodePlace | None:
    """Return the first line of a law."""
    code = getattr(getattr(type(law.__self__), "control", None), "__code__", None)
    return None if code is None else CodePlace(code.co_filename, code.co_firstlineno, code.co_name)

"""Compares each period of a replay with the recorded period: the raw integers and the journal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isnan
from typing import Any

import numpy as np

from umo.cycle.frame import Frame
from umo.cycle.journal import Journal, Kind
from umo.cycle.machine import ConnectedMachine
from umo.cycle.showing import frame_of
from umo.drivers.contract import Direction
from umo.process.frames.layout import ENTRY as ENTRY_ROW
from umo.process.frames.layout import Layout
from umo.recording.replay.player import Player
from umo.recording.replay.result import Difference, Replayed
from umo.recording.replay.tape import JournalEntry, TapedPeriod

MAX_SIGNALS = 8
"""Largest number of signals that a difference names."""
UNORDERED = (Kind.RESET, Kind.FAILED_RESET, Kind.INITIALIZE)
"""Entries whose order depends on the wall clock, because objects that do not answer are reset last."""
WORDS = {
    Kind.READ: "read",
    Kind.WRITE: "written",
    Kind.FAILED_READ: "not read: it failed",
    Kind.FAILED_WRITE: "not accepted: it failed",
    Kind.RESET: "reset",
    Kind.FAILED_RESET: "not reset: it failed",
    Kind.EXPIRED: "expired",
    Kind.INTERLOCKED: "interlocked",
    Kind.INITIALIZE: "initialised",
    Kind.LOOKED: "looked for",
    Kind.ARRIVED: "arrived",
    Kind.CONFIRMED: "confirmed",
    Kind.AGAIN: "transferred once more",
    Kind.RENEWED: "initialised again by the worker process",
}


class Comparison:
    """An observer that compares a replayed run with its recording. It keeps the first difference, and counts the
    comparisons."""

    def __init__(
        self, machine: ConnectedMachine, journal: Journal, player: Player, layout: Layout, result: Replayed
    ) -> None:
        self._machine, self._journal, self._player = machine, journal, player
        self._layout, self._result = layout, result
        self.on_difference: Callable[[], object] = lambda: None
        """Function that is called at the first difference."""
        self.compares = True
        """True if commands are compared; otherwise they are only counted."""
        image = machine.image
        self._paths = [str(each["path"]) for each in layout.objects]
        slot_of = {item.path: slot for slot, item in enumerate(image.items)}
        order = np.array([slot_of[path] for path in self._paths], np.int64)
        self._order = None if (order == np.arange(len(order))).all() else order
        """The present slot of each recorded slot, or None if all are the same."""
        self._slot_of = order.tolist()
        self._recorded_slot = np.argsort(order)
        self._raws = image.columns.raws
        items = [image.items[today] for today in self._slot_of]
        self.outputs = [slot for slot, item in enumerate(items) if item.direction is Direction.OUTPUT]
        """The recorded slots of the actuators."""
        self._timer = -1 if image.timer < 0 else int(self._recorded_slot[image.timer])

    def __call__(self, frame: Frame) -> None:
        period, result = self._player.period, self._result
        if period is None:
            self._tell_extra(frame)
            return
        journal = self._journal
        result.periods += 1
        result.simulated = frame.time
        if not self.compares:
            return
        result.raws += len(self.outputs)
        raws = self.replayed_raws()
        same = (
            frame.number == period.number
            and journal.count == period.count
            and raws.tobytes() == period.raws.tobytes()
            and (journal.sampled, journal.updated) == (period.sampled, period.updated)
            and (not journal.count or self._same_entries(period))
        )
        if not same and result.difference is None and (found := self._find(frame, period, raws)) is not None:
            result.difference = found
            self.on_difference()

    def tell(self, slot: int, recorded: str, replayed: str) -> None:
        """Report a call that differs from the recording, which may be the first difference."""
        period = self._player.period
        if self._result.difference is None and period is not None:
            path = self._paths[slot] if slot >= 0 else ""
            self._result.difference = self._difference(period, path, recorded, replayed)
            self.on_difference()

    def _tell_extra(self, frame: Frame) -> None:
        """Report a frame that was not recorded: the program updates once more in a period. At the end of the tape this
        is not a difference."""
        if self.compares and not self._player.over and self._result.difference is None:
            number = max(self._player.shown - 1, 0)
            found = Difference(number, frame.time, "", "one update in this period", "a second update")
            self._result.difference = found
            self.on_difference()

    def replayed_raws(self) -> Any:
        """Return the raw integers of the replay by recorded slots. The result is a view that is valid in this
        period."""
        raws = self._raws if self._order is None else self._raws[self._order]
        if self._timer >= 0 and self._player.period is not None:  # a tick that ends the replay is in no frame
            raws = raws.copy()
            raws[self._timer] = self._player.period.raws[self._timer]
        return raws

    # What differs --------------------------------------------------------------------------------------

    def _entries(self) -> list[JournalEntry]:
        journal = self._journal
        rows = np.frombuffer(journal.buffer, ENTRY_ROW, journal.count)
        if self._order is not None:
            rows = rows.copy()
            rows["slot"] = self._recorded_slot[rows["slot"]]
        entries: list[JournalEntry] = rows.tolist()
        return entries

    def _same_entries(self, period: TapedPeriod) -> bool:
        if self._order is None and self._journal.entries == period.journal:
            return True
        return _in_order(self._entries()) == _in_order(period.entries)

    def _find(self, frame: Frame, period: TapedPeriod, raws: Any) -> Difference | None:
        if frame.number != period.number:
            return self._difference(period, "", f"tick {period.number}", f"tick {frame.number}")
        recorded, replayed = _in_order(period.entries), _in_order(self._entries())
        for number in range(max(len(recorded), len(replayed))):
            one = recorded[number] if number < len(recorded) else None
            other = replayed[number] if number < len(replayed) else None
            if one != other:
                either: Any = one or other
                return self._difference(period, self._paths[either[0]], self._entry_text(one), self._entry_text(other))
        different = np.flatnonzero(raws != period.raws).tolist()
        if different:
            slot = next((slot for slot in different if slot in self.outputs), different[0])
            return self._difference(
                period, self._paths[slot], self._text(slot, int(period.raws[slot])), self._text(slot, int(raws[slot]))
            )
        journal = self._journal
        counts = ("sample", period.sampled, journal.sampled), ("update", period.updated, journal.updated)
        for what, before, now in counts:
            if before != now:
                return self._difference(period, "", _whole(what, before), _whole(what, now))
        return None

    def _difference(self, period: TapedPeriod, path: str, recorded: str, replayed: str) -> Difference:
        machine = self._machine
        places = tuple(filter(None, machine.sequences.places))
        signals = tuple(self._signals(period))
        return Difference(self._player.shown, period.time, path, recorded, replayed, places, signals)

    def _entry_text(self, entry: Any) -> str:
        if entry is None:
            return "nothing"
        kind, raw = Kind(entry[1]), entry[3]
        if kind in (Kind.READ, Kind.WRITE, Kind.FAILED_WRITE, Kind.RESET, Kind.INITIALIZE):
            return f"{WORDS[kind]}, {self._text(entry[0], raw)}"
        return WORDS.get(kind, kind.name.lower())

    def _text(self, slot: int, raw: int) -> str:
        """Return a value with its unit, and its raw integer, as text."""
        try:
            value = self._machine.image.wires[self._slot_of[slot]].value(raw)
            return f"{self._layout.described.objects[slot].text(value)} (raw {raw})"
        except Exception:  # of a linearization of the user's
            return f"raw {raw}"

    def _signals(self, period: TapedPeriod) -> list[str]:
        recorded = period.signals
        frame = frame_of(self._machine)
        replayed = {each.path: value for each, value in zip(frame.signals, frame.signal_values, strict=False)}
        found = []
        for about, value in zip(self._layout.described.signals, recorded, strict=False):
            now = replayed.get(about.path, value)
            if now != value and not (isnan(now) and isnan(value)):
                found.append(f"{about.path}: recorded {about.text(value)}, replayed {about.text(now)}")
        rest = len(found) - MAX_SIGNALS
        return found[:MAX_SIGNALS] + ([f"and {rest} more signals"] if rest > 0 else [])


def _whole(what: str, count: int) -> str:
    return f"no {what} of the whole machine" if count < 0 else f"the {what} after {count} transfers of single objects"


def _in_order(entries: Sequence[JournalEntry]) -> list[tuple[Any, ...]]:
    """Return the entries in a form that can be compared: NaN equals NaN, and consecutive resets are sorted by slot."""
    found: list[tuple[Any, ...]] = []
    row: list[tuple[Any, ...]] = []
    for entry in entries:
        plain = (*entry[:5], "" if isnan(entry[5]) else entry[5])
        if entry[1] in UNORDERED:
            row.append(plain)
        else:
            found += [*sorted(row), plain]
            row = []
    return found + sorted(row)

"""The parts of a recorded run that a replay needs: frames, journal and commands, in the order of arrival."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from umo.cycle.journal import NO_TRANSFER, Kind
from umo.errors import UmoError
from umo.process.frames.layout import ENTRY, Layout

MOVING = {Kind.READ, Kind.WRITE, Kind.RESET, Kind.INITIALIZE, Kind.ARRIVED, Kind.CONFIRMED}
"""Entries of the journal that change the raw integer of an object."""
OPEN_LOOP = "open_loop"
"""The fact that marks a recording from which periods were left out (`umo.recording.replay.shrinking`). Only the error
of such a recording is compared."""
JournalEntry = tuple[int, int, int, int, int, float]
"""An entry of a journal: slot, kind, error, raw integer, the raw integer before, time."""


class NotReplayable(UmoError):
    """Raised if a recording cannot be replayed. The text has one line."""


class TapeCommand(Protocol):
    """A received command of a client."""

    @property
    def number(self) -> int: ...
    @property
    def period(self) -> int: ...
    @property
    def data(self) -> bytes: ...


class TapeBlock(Protocol):
    """Consecutive frames of a recording."""

    @property
    def frames(self) -> npt.NDArray[Any]:
        """Structured array with the fields of `Layout.columns`, as far as they were recorded."""

    @property
    def entries(self) -> npt.NDArray[Any]:
        """The entries of the frames' journal (`umo.process.frames.layout.ENTRY`)."""

    @property
    def commands(self) -> Sequence[TapeCommand]:
        """The commands that were taken in these periods."""

    @property
    def lost(self) -> int:
        """Number of frames that are missing before the block."""

    @property
    def entries_lost(self) -> int:
        """Number of missing entries of the journal."""

    @property
    def commands_lost(self) -> int:
        """Number of missing commands."""

    @property
    def events_lost(self) -> int:
        """Number of missing events."""


class Tape(Protocol):
    """The interface of a recorded run. `umo.recording.Recording` implements it."""

    layout: Layout

    @property
    def job(self) -> Mapping[str, Any]:
        """The job: station, wiring, options (`umo.process.job_facts`)."""

    @property
    def events(self) -> Iterable[Any]:
        """The events of the run: `umo.cycle.events.Event`, or with its number
        `umo.process.frames.reader.NumberedEvent`."""

    def blocks(self) -> Iterator[TapeBlock]:
        """Return the blocks from the first period on."""


def events_of(tape: Tape) -> list[Any]:
    """Return the events without their numbers."""
    return [getattr(each, "event", each) for each in tape.events]


class TapedPeriod:
    """One recorded period."""

    __slots__ = (
        "_entries",
        "_full",
        "_place",
        "_rows",
        "missed",
        "number",
        "raws",
        "sampled",
        "taken",
        "time",
        "updated",
    )

    def __init__(
        self,
        row: tuple[int, float, int, int, int, int],
        raws: npt.NDArray[np.int64],
        entries: Any,
        place: tuple[npt.NDArray[Any], int],
        full: bool,
    ) -> None:
        self.number, self.time, self.missed, self.taken, self.sampled, self.updated = row
        self.raws = raws
        """The raw integer of each object at the end of the period."""
        self._rows, self._place, self._full = entries, place, full
        self._entries: list[JournalEntry] | None = None

    @property
    def entries(self) -> list[JournalEntry]:
        """The entries of the period's journal."""
        if self._entries is None:
            self._entries = self._rows.tolist()
        return self._entries

    @property
    def count(self) -> int:
        """Number of the period's entries."""
        return len(self._rows)

    @property
    def signals(self) -> list[float]:
        """The values of the period's signals; empty if they were not recorded."""
        frames, number = self._place
        signals: list[float] = frames["signals"][number].tolist() if self._full else []
        return signals

    @property
    def journal(self) -> bytes:
        """The entries as stored in the journal."""
        data: bytes = self._rows.tobytes()
        return data

    def moved(self, slot: int, since: int) -> int:
        """Return the raw integer that an object had before the entry with this number."""
        for entry in self.entries[since:]:
            if entry[0] == slot and entry[1] in MOVING:
                return entry[4]
        return int(self.raws[slot])


def first_sample(initial: Mapping[str, Any], raws: Sequence[int]) -> TapedPeriod:
    """Return the first sample, which was made while connecting, in the form of a period."""
    entries = np.frombuffer(bytes.fromhex(initial.get("entries", "")), ENTRY)
    return TapedPeriod(
        (0, 0.0, 0, 0, NO_TRANSFER, NO_TRANSFER), np.array(raws, np.int64), entries, (np.empty(0), 0), False
    )


class Periods:
    """The periods of a tape one after another; `ended` is the reason why the replay is no longer exact, or "" while it
    is exact."""

    def __init__(self, tape: Tape) -> None:
        self._tape = tape
        self.commands: dict[int, bytes] = {}
        """The commands that were taken and must still be passed on, by number."""
        self.ended = ""

    def __iter__(self) -> Iterator[TapedPeriod]:
        last = 0.0
        for block in self._tape.blocks():
            if block.lost:
                self.ended = f"{block.lost} frames after {last:g} s were lost"
                return
            if block.entries_lost:
                self.ended = f"{block.entries_lost} entries of the journal after {last:g} s were lost"
                return
            if block.commands_lost:
                self.ended = f"{block.commands_lost} commands of clients after {last:g} s were lost"
                return
            if block.events_lost:
                self.ended = f"{block.events_lost} events after {last:g} s were lost"
                return
            self.commands |= {each.number: each.data for each in block.commands}
            for period, lost in self._periods(block):
                if lost:
                    self.ended = f"{lost} entries of the journal of the period at {period.time:g} s did not fit into it"
                    return
                last = period.time
                yield period
        self.ended = str(getattr(self._tape, "damaged_end", ""))

    def _periods(self, block: TapeBlock) -> Iterator[tuple[TapedPeriod, int]]:
        frames, entries = block.frames, block.entries
        names = ("number", "time", "missed", "taken", "sampled", "updated")
        rows = zip(*(frames[name].tolist() for name in names), strict=True)
        raws = np.ascontiguousarray(frames["raws"])
        counts, lost = frames["entries"].tolist(), frames["entries_lost"].tolist()
        full = getattr(block, "is_full", True)
        at = 0
        for number, row in enumerate(rows):
            own = entries[at : at + counts[number]]
            at += counts[number]
            yield TapedPeriod(row, raws[number], own, (frames, number), full), lost[number]

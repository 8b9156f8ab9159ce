"""The player of a tape. It keeps the period and the journal entry that a replay has reached, and returns the recorded
values there. A replay writes its own journal. As long as nothing differs, the number of entries in that journal is the
place in the recorded one. Entries that the transfer stage makes by itself (a driver that is away, an expiry) need no
answer.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from math import nan
from typing import Any

from umo.cycle.journal import OF_BLOCK, ErrorKind, Journal, Kind
from umo.drivers.contract import IntArray
from umo.drivers.optional import WaitEnded
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError
from umo.recording.replay.tape import JournalEntry, Periods, TapedPeriod

CAUSE = "it failed in the recording"
"""The text of a driver's error that is replayed."""
READS, WRITES = (Kind.READ, Kind.FAILED_READ), (Kind.WRITE, Kind.FAILED_WRITE)
BROUGHT = Kind.ARRIVED, Kind.CONFIRMED


class Player:
    """The position of a replay. Slots are those of the recording."""

    def __init__(self, periods: Periods, initial: Sequence[int]) -> None:
        """`initial`: the raw integers at the beginning of the recording."""
        self._periods = periods
        self._coming: Iterator[TapedPeriod] = iter(periods)
        self.raws: Any = list(initial)
        """The raw integers of the last period that was played; at first those of the beginning."""
        self.period: TapedPeriod | None = None
        """The period that is being played, or None before the first and after the last period."""
        self._begun: TapedPeriod | None = None
        """The period that has begun although the period before it was not shown yet; otherwise None."""
        self.next: TapedPeriod | None = next(self._coming, None)
        """The period that follows on the tape, or None at the end of the tape."""
        self.journal: Journal | None = None
        """The journal of the replay, or None if it has not begun."""
        self.lenient = False
        """True if calls that were not recorded are also answered, as in a replay with other settings."""
        self.wrong: Callable[[int, str, str], object] = lambda slot, recorded, replayed: None
        """Function that is called for a call that differs from the recording: with its object, the recorded value, and
        the requested one."""
        self.paused = False
        """True if calls of drivers come from an observer of the machine and are not a part of the replay."""
        self.over = self.next is None
        """True if the recording has no further data."""
        self.skipped = 0 if self.next is None else self.next.number - max(self.next.missed, 1)
        """Number of ticks that the recorded run skipped before its first period."""
        self.whole: Any = None
        """The channels of the block whose first transfer of this period is in progress, or None if there is none."""
        self.seen: set[int] = set()
        """The blocks (first slots) that were transferred in this period."""
        self._used: set[int] = set()
        """The numbers of the entries that were used out of their order."""
        self.shown = 0
        """Number of the completed periods."""

    # Periods -------------------------------------------------------------------------------------------

    def connect(self, journal: Journal | None, first: TapedPeriod) -> None:
        """Begin the first sample, while connecting."""
        self.journal, self.period = journal, first

    def connected(self, journal: Journal) -> None:
        """Record that the machine is connected, and that the periods follow. `journal`: the journal of the replay."""
        self.journal = journal
        self._begin(None)

    def tick(self) -> TapedPeriod:
        """Read the timer, and return the period that begins. Raises WaitEnded at the end of the tape."""
        if self.journal is None:
            raise WaitEnded
        period, self._begun = self.next, None
        if period is None:
            self.over = True
            raise WaitEnded
        self.next = next(self._coming, None)
        if self.period is None:
            self._begin(period)
        else:
            self._begun = period
        return period

    def _begin(self, period: TapedPeriod | None) -> None:
        self.period = period
        self._used.clear()
        self.seen.clear()

    def finish(self) -> None:
        """Finish a period that was shown."""
        shown, begun, self._begun = self.period, self._begun, None
        if shown is not None:
            self.raws = shown.raws
            self.shown += 1
        if shown is not None and begun is None and self.next is not None and self.next.number == shown.number:
            begun, self.next = self.next, next(self._coming, None)  # the program has updated once more
        self._begin(begun)
        self.over = self.period is None and self.next is None

    @property
    def commands(self) -> dict[int, bytes]:
        """The accepted commands by number. The code that passes a command on removes it."""
        return self._periods.commands

    @property
    def ended(self) -> str:
        """The reason why the replay stopped being exact before the end of the tape; "" if it did not."""
        return self._periods.ended

    # Answers -------------------------------------------------------------------------------------------

    @property
    def at(self) -> int:
        """The present place in the recorded journal."""
        return 0 if self.journal is None else self.journal.count

    def read(self, slot: int) -> int:
        """Return the present reading of one sensor."""
        if self.period is None or self.paused:
            return int(self.raws[slot])
        entry = self._entry(slot, READS, "a separate reading")
        if entry is None:
            return int(self.raws[slot])
        _raise_if_failed(entry)
        return entry[3]

    def write(self, slot: int, raw: int) -> None:
        """Write one actuator."""
        if self.period is not None and not self.paused:
            entry = self._entry(slot, WRITES, f"a separate write (raw {raw})")
            if entry is not None:
                _raise_if_failed(entry)

    def bring_to_default(self, slot: int, kind: Kind) -> None:
        """Replay `initialize` or `reset` of one object. The order of objects may differ from the recording, because it
        depends on the wall clock."""
        if self.period is None or self.paused:
            return
        kinds = kind, Kind.FAILED_RESET
        entry = self._search(slot, kinds, self.at) or self._search(slot, kinds)
        if entry is None:
            self._tell(slot, "none", f"its {kind.name.lower()}")
        else:
            _raise_if_failed(entry)

    @property
    def resets_again(self) -> bool:
        """True if another reset was recorded."""
        entries = [] if self.period is None else self.period.entries
        kinds = (Kind.RESET, Kind.FAILED_RESET)
        return any(entry[1] in kinds and number not in self._used for number, entry in enumerate(entries))

    def looked(self, slots: Collection[int]) -> bool | None:
        """Return the recorded result of a look for a driver that is away."""
        if self.period is None or self.paused:
            return True
        entry = self._next()
        if entry is None or entry[1] != Kind.LOOKED or entry[0] not in slots:
            self._tell(min(slots, default=-1), "none", "a check whether its driver answers")
            return True
        return {1: True, 0: False}.get(entry[3])

    # Drivers off the cycle -------------------------------------------------------------------------------

    def arrivals(self, slots: Collection[int], in_blocks: Collection[int]) -> list[JournalEntry]:
        """Return the entries at this place that come from a driver that is off the cycle: the readings of
        objects in each of its transfers, and repeated initialisations. Call this before the tick of the period."""
        period = self.period or self.next
        if period is None or self.journal is None or self.paused:
            return []
        found: dict[tuple[int, int], JournalEntry] = {}
        for number, entry in enumerate(period.entries):
            key = entry[0], entry[1]
            if number < self.at and not self.lenient:
                continue
            again = entry[1] == Kind.RENEWED and entry[0] in slots
            if key in found or not (again or (entry[1] in BROUGHT and entry[0] in in_blocks)) or (again and found):
                if found or not self.lenient:
                    break
            else:
                found[key] = entry
        return list(found.values())

    def carried_out(self, slot: int) -> JournalEntry | None:
        """Return the entry of an order that was carried out or refused, or None if neither has happened yet."""
        if self.period is None or self.paused:
            return None
        if self.lenient:
            return self._search(slot, (Kind.CONFIRMED,))
        entry = self._next()
        return entry if entry is not None and entry[:2] == (slot, Kind.CONFIRMED) else None

    def readings(self, slots: Sequence[int]) -> list[tuple[JournalEntry | None, float]]:
        """Return readings of single sensors of a driver off the cycle, each with the time in s at which it was read."""
        found: dict[int, JournalEntry] = {}
        times: dict[int, float] = {}
        for entry in self.period.entries[self.at :] if self.period is not None and not self.paused else ():
            slot, kind = entry[0], entry[1]
            if slot not in slots or (kind in READS and slot in found):
                break
            if kind in READS:
                found[slot] = entry
            elif kind == Kind.ARRIVED:
                times[slot] = entry[5]
            else:
                break
        return [(found.get(slot), times.get(slot, nan)) for slot in slots]

    # Blocks and groups -----------------------------------------------------------------------------------

    def read_group(self, slots: Sequence[int], texts: Sequence[str], out: IntArray) -> None:
        """Read some sensors in one transfer, each with its own entry."""
        if self.period is None or self.paused:
            out[:] = [self.raws[slot] for slot in slots]
            return
        found = self._group(slots, READS, "a separate reading")
        out[:] = [int(self.raws[slot]) if slot not in found else found[slot][3] for slot in slots]
        _raise_for(found.values(), slots, texts)

    def write_group(self, slots: Sequence[int], texts: Sequence[str]) -> None:
        if self.period is not None and not self.paused:
            found = self._group(slots, WRITES, "a separate write")
            _raise_for(found.values(), slots, texts)

    def read_block(self, slots: IntArray, texts: Sequence[str], out: IntArray) -> None:
        """Read the block of a driver for the first time in this period. Only failures have entries."""
        period = self.period
        if period is None or self.paused:
            out[:] = [self.raws[slot] for slot in slots.tolist()]
            return
        if not period.entries:
            out[:] = period.raws[slots]
            return
        failed = self._failed(slots, Kind.FAILED_READ)
        since = self.at + len(failed)
        out[:] = [period.moved(slot, since) for slot in slots.tolist()]
        _raise_for(failed, slots.tolist(), texts)

    def write_block(self, slots: IntArray, texts: Sequence[str]) -> None:
        if self.period is not None and self.period.entries and not self.paused:
            _raise_for(self._failed(slots, Kind.FAILED_WRITE), slots.tolist(), texts)

    # Entries -------------------------------------------------------------------------------------------

    def _next(self) -> JournalEntry | None:
        assert self.period is not None
        entries, at = self.period.entries, self.at
        return entries[at] if at < len(entries) else None

    def _entry(self, slot: int, kinds: Collection[int], asked: str) -> JournalEntry | None:
        """Return the entry of a call for one object. If there is none, report a difference and return None."""
        entry = self._next()
        if self.lenient:
            return self._search(slot, kinds)
        if entry is not None and entry[0] == slot and entry[1] in kinds:
            return entry
        self._tell(slot, "none", asked)
        return None

    def _search(self, slot: int, kinds: Collection[int], since: int = 0) -> JournalEntry | None:
        """Return the next unused entry of an object, from the entry number `since` on."""
        assert self.period is not None
        for number, entry in enumerate(self.period.entries[since:], since):
            if entry[0] == slot and entry[1] in kinds and number not in self._used:
                self._used.add(number)
                return entry
        return None

    def _group(self, slots: Sequence[int], kinds: Collection[int], asked: str) -> dict[int, JournalEntry]:
        assert self.period is not None
        if self.lenient:
            each = {slot: self._search(slot, kinds) for slot in slots}
            return {slot: entry for slot, entry in each.items() if entry is not None}
        found = {e[0]: e for e in self.period.entries[self.at : self.at + len(slots)] if e[1] in kinds}
        missing = [slot for slot in slots if slot not in found]
        if missing:
            self._tell(missing[0], "none", asked)
        return found

    def _failed(self, slots: IntArray, kind: Kind) -> list[JournalEntry]:
        """Return the entries, from the present place on, of the objects of a block whose transfer failed."""
        assert self.period is not None
        places = {slot: number for number, slot in enumerate(slots.tolist())}
        failed: list[JournalEntry] = []
        last = -1
        for entry in self.period.entries[self.at :]:
            place = places.get(entry[0], -1)
            if entry[1] != kind or entry[5] != OF_BLOCK or place <= last:
                break
            failed.append(entry)
            last = place
        return failed

    def _tell(self, slot: int, recorded: str, replayed: str) -> None:
        if not self.lenient:
            self.wrong(slot, recorded, replayed)


def _raise_if_failed(entry: JournalEntry) -> None:
    if entry[2] == ErrorKind.TIMEOUT:
        raise DeviceTimeout(CAUSE)
    if entry[2] != ErrorKind.NONE:
        raise DriverError(CAUSE)


def _raise_for(entries: Collection[JournalEntry], slots: Sequence[int], texts: Sequence[str]) -> None:
    """Raise the error that the driver raised for the transfer of these objects in the recorded run, if any."""
    failed = [entry for entry in entries if entry[2] != ErrorKind.NONE]
    for entry in failed:
        if entry[2] != ErrorKind.CHANNELS:
            _raise_if_failed(entry)
    if failed:
        named = {entry[0] for entry in failed}
        raise ChannelsFailed({text: CAUSE for slot, text in zip(slots, texts, strict=True) if slot in named})

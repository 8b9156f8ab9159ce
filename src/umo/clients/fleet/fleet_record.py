"""The recorder of a fleet: writes what stations publish to Parquet files.

When it starts, it reads from its files which data it wrote last, so that nothing is recorded twice, and the number of
missing data is reported. Gateways keep their last 60 s at 10 Hz, so a recorder that was away for a shorter time
receives the missed data later. A recorder that cannot write keeps a bounded amount of data.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_mirror import ANSWER_TIME
from umo.clients.fleet.fleet_record_files import RecordFolder
from umo.clients.fleet.fleet_record_rows import gaps_table
from umo.clients.fleet.fleet_record_run import FollowedRun
from umo.clients.fleet.fleet_record_source import RecordSource, StreamPlace
from umo.clients.fleet.run_feed import RunFeed
from umo.clients.fleet.run_words import RUN_BYTES, peek
from umo.clients.fleet.stream_positions import StreamPositions
from umo.errors import FramesError, UmoError, text_of
from umo.recording.tables.value_tables import events_table

log = logging.getLogger("umo.fleet")
FLUSH = 3.0
"""Time in s after which received data are in a file. With more than `FLUSHES * FLUSH` stations it takes longer."""
FLUSHES = 50
"""Largest number of files of values written per second."""
PART_BYTES = 8 << 20
"""Size in bytes at which the data of a run are written even before `FLUSH` has passed."""
MAX_INCOMING = 256 << 20
"""Largest number of bytes of messages that wait to be processed. Further messages are dropped and become a gap."""
MAX_AHEAD = 32 << 20
"""Size in bytes of the waiting messages at which a source pauses, if it can."""
MAX_PENDING = 512 << 20
"""Largest number of bytes of all data that wait to be written. If there are more, because the disk is full, older
values are dropped."""
TAKE_WAIT = 0.1
"""Longest time in s to wait for a message."""
MAX_MESSAGES = 2000
"""Largest number of messages that are processed between two checks for data to be written."""
DECLARATIONS = 50
"""Number of declarations that are requested at a time."""
TIDY_PAUSE = 600.0
"""Time in s between two checks of all folders; they are also checked at the end of an hour."""


class QueuedMessage(NamedTuple):
    kind: str
    key: StationKey
    data: bytes
    place: StreamPlace | None


class Incoming:
    """A bounded queue of messages from other threads."""

    def __init__(self, most: int = MAX_INCOMING) -> None:
        self._most = most
        self._bytes = 0
        self._messages: deque[QueuedMessage] = deque()
        self._changed = threading.Condition()

    @property
    def size(self) -> int:
        return self._bytes

    def put(self, kind: str, key: StationKey, data: bytes, place: StreamPlace | None = None) -> None:
        with self._changed:
            if self._bytes + len(data) > self._most:
                return
            self._bytes += len(data)
            self._messages.append(QueuedMessage(kind, key, data, place))
            self._changed.notify()

    def take(self, wait: float) -> list[QueuedMessage]:
        with self._changed:
            if not self._messages:
                self._changed.wait(wait)
            taken = [self._messages.popleft() for _ in range(min(len(self._messages), MAX_MESSAGES))]
            self._bytes -= sum(len(each.data) for each in taken)
            return taken


@contextmanager
def told(key: StationKey) -> Iterator[None]:
    """Return a context that catches and reports errors in the processing of a message, so that other messages are still
    processed."""
    try:
        yield
    except UmoError as error:
        log.warning("%s: %s", key, error)
    except Exception as error:  # of a message that is none of umo's
        log.warning("%s: %s", key, text_of(error), exc_info=error)


@dataclass
class Followed:
    """A run that is recorded, with the times of the last operations on it."""

    key: StationKey
    run: FollowedRun
    feed: RunFeed
    heard: float
    written: float
    asked: float = float("-inf")
    """Time at which the declaration of the run was requested."""
    is_described: bool = field(default=False)
    positions: StreamPositions = field(default_factory=StreamPositions)

    def go_on(self) -> None:
        """Continue the recording."""
        for event in self.feed.events():
            with told(self.key):
                self.run.take_events([event])
        for data in self.feed.deltas():
            with told(self.key):
                self.run.take_delta(data)


class FleetRecorder:
    """The recorder. `keep`: time in s for which data are kept, or None to keep everything. `say` is called with notices
    for the user."""

    def __init__(
        self,
        source: RecordSource,
        folder: RecordFolder,
        *,
        keep: float | None = None,
        say: Callable[[str], object] = log.info,
        utc: Callable[[], float] = time.time,
        most_pending: int = MAX_PENDING,
    ) -> None:
        self._source, self._folder, self._keep, self._say, self._utc = source, folder, keep, say, utc
        self._most_pending = most_pending
        self._incoming = Incoming()
        self._followed: dict[tuple[StationKey, bytes], Followed] = {}
        self._is_full = False
        self._tidied, self._hour = float("-inf"), ""
        self._untidy: deque[Path] = deque()
        self._pending = 0
        """Size in bytes of the data to be written, when it was last computed."""
        self._place = 0
        """Place of the last message that was taken from the stream."""
        source.begin(self._incoming.put, self._has_room)

    def _has_room(self) -> bool:
        return not self._is_full and self._incoming.size < MAX_AHEAD and self._pending < self._most_pending // 2

    def run(self, stop: Callable[[], bool]) -> None:
        """Record until `stop`, then write the data that have arrived."""
        while not stop():
            self.step()
        self._source.end()
        while messages := self._incoming.take(0.0):
            for message in messages:
                self._take(message)
        for followed in list(self._followed.values()):
            self._write(followed)
        self._tell_written()

    def step(self) -> None:
        """Process new messages, and write what is due."""
        for message in self._incoming.take(TAKE_WAIT):
            self._take(message)
        now = time.monotonic()
        self._ask_for_past(now)
        self._ask(now)
        interval = max(FLUSH, len(self._followed) / FLUSHES)
        due = [
            each for each in self._followed.values()
            if now - each.written >= interval or (each.run.bytes >= PART_BYTES and not self._is_full)
        ]  # fmt: skip
        for each in due[:FLUSHES]:
            self._write(each)
        if due:
            self._tell_written()
        self._make_room()
        self._tidy(now)

    # What comes ----------------------------------------------------------------------------------------

    def _take(self, queued: QueuedMessage) -> None:
        kind, key, data, place = queued
        if place is not None:
            self._place = place.sequence
        with told(key):
            if kind == keys.DELTA:
                head = peek(data)
                followed = self._run_of(key, head.run)
                if place is not None:
                    followed.positions.take(place.sequence, head)
                    followed.feed.leave_out(place.first)
                followed.feed.take_delta(data, time.monotonic())
            elif kind == keys.EVENT:
                message = json.loads(data)
                followed = self._run_of(key, bytes.fromhex(message["run"]))
                if place is not None:
                    followed.positions.take(place.sequence, None)
                    followed.feed.leave_out_events(int(message["events"][0][0]))
                followed.feed.take_events(message)
            elif kind == keys.PAST:
                followed = self._run_of(key, data[:RUN_BYTES])
                followed.feed.take_past(data[RUN_BYTES:])
            elif kind == keys.DECLARATION:
                self._take_declaration(key, data)
                return
            else:  # of a station that is not wanted
                return
            followed.go_on()

    def _run_of(self, key: StationKey, run: bytes) -> Followed:
        followed = self._followed.get((key, run))
        if followed is None:
            now = time.monotonic()
            this = FollowedRun(run, self._folder.recorded(key))
            followed = Followed(key, this, RunFeed(run, *this.wanted, now), 0.0, now)
            self._followed[key, run] = followed
            self._say(f"{key} is recorded")
        followed.heard = self._source.now()
        return followed

    def _ask_for_past(self, now: float) -> None:
        """Request missing data. A station that was asked goes to the end of the queue."""
        for of, each in list(self._followed.items()):
            if not self._source.ask_past(each.key, each.feed, now):
                return
            self._followed[of] = self._followed.pop(of)
            each.go_on()  # with what is there, if nobody answers

    def _ask(self, now: float) -> None:
        """Request the declarations that are needed."""
        waiting = [
            each for each in self._followed.values()
            if each.run.needs_declaration and now - each.asked > ANSWER_TIME
        ]  # fmt: skip
        for each in waiting[:DECLARATIONS]:
            each.asked = now
            self._source.ask_declaration(each.key, each.run.run)

    def _take_declaration(self, key: StationKey, data: bytes) -> None:
        for followed in self._followed.values():
            if followed.key == key and followed.run.needs_declaration:
                with suppress(FramesError):
                    followed.run.take_declaration(data)

    # What is written -----------------------------------------------------------------------------------

    def _write(self, followed: Followed) -> None:
        """Write the data of a run. Data that cannot be written are kept."""
        followed.written = time.monotonic()
        run, key, hour = followed.run, followed.key, self._hour_of(self._utc())
        try:
            if run.rows is not None and not followed.is_described:
                self._folder.write_objects(key, run.name, run.rows.objects())
                followed.is_described = True
            if gaps := list(run.gaps):  # first: what is told twice is found, what is not told is not
                self._folder.write("gaps", key, gaps_table(run.name, gaps), {}, hour)
                run.has_written(gaps=len(gaps))
            if run.taken and run.rows is not None:
                count = len(run.taken)
                numbers = {run.name: (run.taken[0].number, run.taken[-1].number)}
                self._folder.write("values", key, run.rows.values(run.taken), numbers, hour)
                run.has_written(values=count)
            if events := run.events():
                numbers = {run.name: (events[0][0], events[-1][0])}
                self._folder.write("events", key, events_table(run.name, events), numbers, hour)
                run.has_written(events=len(events))
        except (OSError, pa.ArrowException) as error:
            self._tell_full(error)
            return
        if self._is_full:
            self._is_full = False
            self._say("the history can be written again")
        everything = run.is_written and followed.feed.holds_nothing
        followed.positions.wrote(run.last["values"], everything=everything)
        if followed.heard < self._source.now() - self._source.idle:
            self._leave(followed)

    def _leave(self, followed: Followed) -> None:
        """Expect no more data of a run: continue with the existing data, and forget the run when they are written."""
        followed.feed.give_up()
        followed.go_on()
        if followed.feed.holds_nothing and not followed.run.give_up():
            del self._followed[followed.key, followed.run.run]

    def _tell_written(self) -> None:
        """Tell the source which data a restarted recorder does not need."""
        needed = [
            each.positions.needed(each.run.last["values"], has_ended=each.run.has_ended)
            for each in self._followed.values()
        ]
        self._source.written(min((each for each in needed if each is not None), default=self._place + 1) - 1)

    def _tell_full(self, error: Exception) -> None:
        if not self._is_full:
            self._is_full = True
            why = getattr(error, "strerror", None) or text_of(error)
            self._say(f"the history cannot be written: {why}; the last values are kept until there is room")

    def _make_room(self) -> None:
        """If too many data wait to be written, drop the older half of the data of each run that has more than its
        share."""
        self._pending = sum(each.run.bytes for each in self._followed.values())
        if self._pending <= self._most_pending:
            return
        share = self._most_pending / len(self._followed)
        for each in self._followed.values():
            if each.run.bytes >= share:
                each.run.drop_older_half()

    def _tidy(self, now: float) -> None:
        """Merge parts, one folder at a time."""
        hour = self._hour_of(self._utc())
        if not self._untidy:
            if now - self._tidied < TIDY_PAUSE and hour == self._hour:
                self._untidy.extend(self._folder.grown)
            else:
                self._tidied, self._hour = now, hour
                self._untidy.extend(self._folder.folders())
        if self._untidy:
            oldest = "" if self._keep is None else self._hour_of(self._utc() - self._keep)
            try:
                self._folder.tidy(self._untidy.popleft(), hour, oldest)
            except (OSError, pa.ArrowException) as error:
                self._tell_full(error)

    @staticmethod
    def _hour_of(utc: float) -> str:
        return datetime.fromtimestamp(utc, UTC).strftime("%Y-%m-%dT%H")

"""The recorder of a fleet: subscribes to all stations, and writes what they publish to Parquet files.

What it has written last it reads from its own files when it begins, so that nothing is there twice and what is missing
is announced with its count. Gateways keep their last 60 s at 10 Hz: what a recorder that is away for less has missed
comes later. One that cannot write keeps a bounded amount.
"""

from __future__ import annotations

import json
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import pyarrow as pa
import zenoh

from umo.errors import FramesError, OptionError, UmoError, text_of
from umo.fleet import fleet_keys as keys
from umo.fleet.fleet_keys import StationKey, station_of
from umo.fleet.fleet_mirror import ANSWER_TIME
from umo.fleet.fleet_record_files import RecordFolder
from umo.fleet.fleet_record_rows import gaps_table
from umo.fleet.fleet_record_run import FollowedRun
from umo.fleet.past_queries import PastQueries
from umo.fleet.run_feed import RunFeed
from umo.fleet.run_words import RUN_BYTES, peek
from umo.tables.value_tables import events_table

log = logging.getLogger("umo.fleet")
FLUSH = 3.0
"""Time in s after which what has come is in a file, with up to `FLUSHES * FLUSH` stations; longer with more."""
FLUSHES = 50
"""Files of values a second at most."""
PART_BYTES = 8 << 20
"""Bytes of a run that are written before it is time."""
MAX_INCOMING = 256 << 20
"""Bytes of messages that wait to be looked at, at most. What comes beyond is a gap."""
MAX_PENDING = 512 << 20
"""Bytes of all that waits to be written, at most: while the disk is full older values are dropped."""
TAKE_WAIT = 0.1
"""Time in s that a message is waited for."""
MOST = 2000
"""Messages between two looks at what is to be written."""
DECLARATIONS = 50
"""Declarations that are asked for at a time."""
IDLE = 120.0
"""Time in s after which a run of which nothing comes any more is forgotten; the files know it."""
TIDY_PAUSE = 600.0
"""Time in s from one look at all folders to the next, also at the end of an hour."""
_PATTERN = re.compile(r"[\w.*-]{1,64}/[\w.*-]{1,64}", re.ASCII)


QueuedMessage = tuple[str, StationKey, bytes]
"""Kind, station and what it is."""


class Incoming:
    """Messages from the threads of Zenoh, bounded."""

    def __init__(self, most: int = MAX_INCOMING) -> None:
        self._most = most
        self._bytes = 0
        self._messages: deque[QueuedMessage] = deque()
        self._changed = threading.Condition()

    def put(self, kind: str, key: StationKey, data: bytes) -> None:
        with self._changed:
            if self._bytes + len(data) > self._most:
                return
            self._bytes += len(data)
            self._messages.append((kind, key, data))
            self._changed.notify()

    def take(self, wait: float) -> list[QueuedMessage]:
        with self._changed:
            if not self._messages:
                self._changed.wait(wait)
            taken = [self._messages.popleft() for _ in range(min(len(self._messages), MOST))]
            self._bytes -= sum(len(data) for _, _, data in taken)
            return taken


@contextmanager
def told(key: StationKey) -> Iterator[None]:
    """Whatever is wrong with a message is told, and disturbs no other."""
    try:
        yield
    except UmoError as error:
        log.warning("%s: %s", key, error)
    except Exception as error:  # of a message that is none of umo's
        log.warning("%s: %s", key, text_of(error), exc_info=error)


@dataclass
class Followed:
    """A run with the times of what was done with it."""

    key: StationKey
    run: FollowedRun
    feed: RunFeed
    heard: float
    written: float
    asked: float = float("-inf")
    """When it was asked for its declaration."""
    is_described: bool = field(default=False)

    def go_on(self) -> None:
        """Record what has its turn."""
        for event in self.feed.events():
            with told(self.key):
                self.run.take_events([event])
        for data in self.feed.deltas():
            with told(self.key):
                self.run.take_delta(data)


class FleetRecorder:
    """`patterns`: SITE/STATION with `*`; `keep`: s, None: for ever. `say` is told of what a user has to know."""

    def __init__(
        self,
        session: zenoh.Session,
        folder: RecordFolder,
        patterns: Sequence[str] = ("*/*",),
        *,
        keep: float | None = None,
        say: Callable[[str], object] = log.info,
        utc: Callable[[], float] = time.time,
        most_pending: int = MAX_PENDING,
    ) -> None:
        self._session, self._folder, self._keep, self._say, self._utc = session, folder, keep, say, utc
        self._most_pending = most_pending
        self._incoming = Incoming()
        self._followed: dict[tuple[StationKey, bytes], Followed] = {}
        self._is_full = False
        self._tidied, self._hour = float("-inf"), ""
        self._untidy: deque[Path] = deque()
        self._queries = PastQueries(session, self._answered_past)
        self._subscribers = [
            session.declare_subscriber(f"{keys.ROOT}/{key_pattern(each)}/{kind}", partial(self._put, kind))
            for each in patterns
            for kind in (keys.DELTA, keys.EVENT)
        ]

    def _put(self, kind: str, sample: zenoh.Sample) -> None:
        self._incoming.put(kind, station_of(str(sample.key_expr)), bytes(sample.payload))

    def _answered_past(self, key: StationKey, run: bytes, data: bytes) -> None:
        self._incoming.put(keys.PAST, key, run + data)

    def run(self, stop: Callable[[], bool]) -> None:
        """Record until `stop`; then write what has come."""
        while not stop():
            self.step()
        for each in self._subscribers:
            each.undeclare()
        while messages := self._incoming.take(0.0):
            for kind, key, data in messages:
                self._take(kind, key, data)
        for followed in list(self._followed.values()):
            self._write(followed)

    def step(self) -> None:
        """Take what has come, write what is due."""
        for kind, key, data in self._incoming.take(TAKE_WAIT):
            self._take(kind, key, data)
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
        self._make_room()
        self._tidy(now)

    # What comes ----------------------------------------------------------------------------------------

    def _take(self, kind: str, key: StationKey, data: bytes) -> None:
        with told(key):
            if kind == keys.DELTA:
                followed = self._run_of(key, peek(data).run)
                followed.feed.take_delta(data, time.monotonic())
            elif kind == keys.EVENT:
                message = json.loads(data)
                followed = self._run_of(key, bytes.fromhex(message["run"]))
                followed.feed.take_events(message)
            elif kind == keys.PAST:
                followed = self._run_of(key, data[:RUN_BYTES])
                followed.feed.take_past(data[RUN_BYTES:])
            else:
                self._take_declaration(key, data)
                return
            followed.go_on()

    def _run_of(self, key: StationKey, run: bytes) -> Followed:
        now = time.monotonic()
        followed = self._followed.get((key, run))
        if followed is None:
            this = FollowedRun(run, self._folder.recorded(key))
            followed = Followed(key, this, RunFeed(run, *this.wanted, now), now, now)
            self._followed[key, run] = followed
            self._say(f"{key} is recorded")
        followed.heard = now
        return followed

    def _ask_for_past(self, now: float) -> None:
        """Ask for what is missing: who was asked is behind the others the next time."""
        for of, each in list(self._followed.items()):
            if self._queries.are_too_many:
                return
            if (request := each.feed.request(now)) is not None:
                self._queries.ask(each.key, request)
                self._followed[of] = self._followed.pop(of)
            each.go_on()  # with what is there, if nobody answers

    def _ask(self, now: float) -> None:
        """Ask for the declarations that are needed."""
        waiting = [
            each for each in self._followed.values()
            if each.run.needs_declaration and now - each.asked > ANSWER_TIME
        ]  # fmt: skip
        for each in waiting[:DECLARATIONS]:
            each.asked = now
            with suppress(zenoh.ZError):  # the network is away
                self._session.get(
                    each.key.key(keys.DECLARATION),
                    zenoh.handlers.Callback(partial(self._answered, each.key), lambda: None),
                    timeout=ANSWER_TIME,
                )

    def _answered(self, key: StationKey, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._incoming.put(keys.DECLARATION, key, bytes(reply.ok.payload))

    def _take_declaration(self, key: StationKey, data: bytes) -> None:
        for followed in self._followed.values():
            if followed.key == key and followed.run.needs_declaration:
                with suppress(FramesError):
                    followed.run.take_declaration(data)

    # What is written -----------------------------------------------------------------------------------

    def _write(self, followed: Followed) -> None:
        """Write what has come of a run. What cannot be written is kept."""
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
            self._say("the history is written again")
        if followed.heard < followed.written - IDLE and not run.give_up():
            del self._followed[key, run.run]

    def _tell_full(self, error: Exception) -> None:
        if not self._is_full:
            self._is_full = True
            why = getattr(error, "strerror", None) or text_of(error)
            self._say(f"the history cannot be written: {why}; the last values are kept until there is room")

    def _make_room(self) -> None:
        """Drop the older half of what the runs have that hold more than their share."""
        if sum(each.run.bytes for each in self._followed.values()) <= self._most_pending:
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


def key_pattern(text: str) -> str:
    """`cell7/*`, `*/press*` as a key of Zenoh; OptionError if it is none."""
    if not _PATTERN.fullmatch(text):
        raise OptionError(f"{text!r} names no stations; write SITE/STATION, where * stands for anything, as 'cell7/*'")
    return "/".join(part if part == "*" else re.sub(r"\*+", "$*", part) for part in text.split("/"))

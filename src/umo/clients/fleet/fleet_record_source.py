"""The sources of the recorder's messages: the fleet, or a JetStream (`umo.clients.fleet.jetstream_source`)."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple, Protocol

import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey, station_of
from umo.clients.fleet.fleet_mirror import ANSWER_TIME
from umo.clients.fleet.past_queries import PastQueries
from umo.clients.fleet.run_feed import RunFeed
from umo.errors import OptionError

_PATTERN = re.compile(r"[\w.*-]{1,64}/[\w.*-]{1,64}", re.ASCII)


class StreamPlace(NamedTuple):
    """The place of a message in a stream. `time`: the UTC of the server in s. `first`: the number of the first delta
    that can still follow in the same run."""

    sequence: int
    time: float
    first: int


Put = Callable[[str, StationKey, bytes, StreamPlace | None], None]
"""Function that takes the kind, station, content and place of a message. Any thread may call it."""


class RecordSource(Protocol):
    """The interface of a source. `idle`: time in s without a message, on the clock of the source, after which a run is
    forgotten."""

    idle: float

    def begin(self, put: Put, has_room: Callable[[], bool]) -> None:
        """Deliver messages from now on. A source that can pause does so while the recorder has no room."""

    def end(self) -> None:
        """Deliver no more messages."""

    def now(self) -> float:
        """Return the present time in s of the clock by which idle runs are found."""

    def ask_past(self, key: StationKey, feed: RunFeed, now: float) -> bool:
        """Request the missing data of a run. Return False if too many requests are in progress."""

    def ask_declaration(self, key: StationKey, run: bytes) -> None:
        """Ask for the declaration of a run."""

    def written(self, sequence: int) -> None:
        """Record that all messages up to this place are in files, or are no longer needed."""


class FleetSource:
    """The fleet as a source. `patterns`: names SITE/STATION, in which `*` stands for any characters."""

    idle = 120.0

    def __init__(self, session: zenoh.Session, patterns: Sequence[str] = ("*/*",)) -> None:
        self._session, self._patterns = session, patterns

    def begin(self, put: Put, has_room: Callable[[], bool]) -> None:
        """Subscribe. Zenoh cannot pause: messages for which there is no room are dropped."""
        self._put = put
        self._queries = PastQueries(self._session, self._answered_past)
        self._subscribers = [
            self._session.declare_subscriber(f"{keys.ROOT}/{key_pattern(each)}/{kind}", partial(self._take, kind))
            for each in self._patterns
            for kind in (keys.DELTA, keys.EVENT)
        ]

    def end(self) -> None:
        for each in self._subscribers:
            each.undeclare()

    def now(self) -> float:
        return time.monotonic()

    def _take(self, kind: str, sample: zenoh.Sample) -> None:
        self._put(kind, station_of(str(sample.key_expr)), bytes(sample.payload), None)

    def _answered_past(self, key: StationKey, run: bytes, data: bytes) -> None:
        self._put(keys.PAST, key, run + data, None)

    def ask_past(self, key: StationKey, feed: RunFeed, now: float) -> bool:
        if self._queries.are_too_many:
            return False
        if (request := feed.request(now)) is not None:
            self._queries.ask(key, request)
        return True

    def ask_declaration(self, key: StationKey, run: bytes) -> None:
        with suppress(zenoh.ZError):  # the network is away
            self._session.get(
                key.key(keys.DECLARATION),
                zenoh.handlers.Callback(partial(self._answered, key), lambda: None),
                timeout=ANSWER_TIME,
            )

    def _answered(self, key: StationKey, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._put(keys.DECLARATION, key, bytes(reply.ok.payload), None)

    def written(self, sequence: int) -> None:
        pass


def key_pattern(text: str) -> str:
    """Return a pattern such as `cell7/*` or `*/press*` as a key of Zenoh. Raises OptionError if the string is not such
    a pattern."""
    if not _PATTERN.fullmatch(text):
        raise OptionError(
            f"{text!r} names no stations; write SITE/STATION, where * stands for any name, as in 'cell7/*'"
        )
    return "/".join(part if part == "*" else re.sub(r"\*+", "$*", part) for part in text.split("/"))

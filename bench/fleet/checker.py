"""A subscriber that knows what the values must be: `python -m bench.fleet.checker REPORT ADDRESS...`.

It follows every station of the fleet by its deltas alone, as a recorder does, and counts: each delta once and equal to
what was made, those that came again, gaps with and without a count, ages.
"""

from __future__ import annotations

import json
import queue
import sys
import time
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from bench.fleet import report_file
from bench.fleet.rings import layout_of, value
from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import EVERY, StationKey
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.message_parts import unpacked
from umo.clients.fleet.past_queries import PastQueries
from umo.clients.fleet.run_feed import RunFeed
from umo.clients.fleet.run_words import RUN_BYTES, WordFrame, Words, peek
from umo.errors import FramesError
from umo.process.frames.layout import Layout

MADE = "made"
"""Names of stations that do not exist begin with it (`bench.fleet.rings`)."""
MADE_WORDS = WordFrame(layout_of(MADE))
LOOK = 0.1
"""Time in s from one look at what is missing to the next."""
ASK_AGAIN = 0.5
"""Time in s after which a declaration that did not come is asked for again."""


@dataclass
class FollowedRun:
    """What came of one run."""

    station: str
    first: int = -1
    next: int = 0
    received: int = 0
    bytes: int = 0
    """Of the messages, without what the network adds."""
    again: int = 0
    """Deltas that came before."""
    lost: int = 0
    """In gaps that were told with their count."""
    untold: int = 0
    """That came behind a gap without a basis."""
    wrong: int = 0
    latest: float = 0.0
    """Greatest age in s of a delta when it came."""
    frame: int = -1
    """Number of the last frame."""
    ended: bool = False
    gaps: list[tuple[int, int, float]] = field(default_factory=list)
    """Number of the first delta that is not there, how many, when, s of the monotonic clock."""


class Follower:
    """Follows one run. `words`: of its layout; None: it is not known yet."""

    def __init__(self, key: StationKey, run: bytes, words: WordFrame | None) -> None:
        self.key, self.told, self.feed = key, FollowedRun(str(key)), RunFeed(run, 0, 0, time.monotonic())
        self.words, self.is_made = words, words is not None
        self._waiting: list[bytes] = []
        """Deltas that wait for the layout."""
        self.asked = 0.0
        self._image: Words | None = None

    @property
    def needs_layout(self) -> bool:
        return self.words is None

    def take(self, data: bytes) -> None:
        """A delta as it was published."""
        self.told.again += not self.feed.take_delta(data, time.monotonic())
        self.go_on()

    def take_past(self, data: bytes) -> None:
        self.feed.take_past(data)
        self.go_on()

    def go_on(self) -> None:
        """Check what has its turn."""
        self.feed.events()
        self._waiting += self.feed.deltas()
        if self.words is not None:
            waiting, self._waiting = self._waiting, []
            for data in waiting:
                self._take(self.words, data)

    def _take(self, words: WordFrame, data: bytes) -> None:
        delta, told = words.parse(data), self.told
        if not delta.is_full and (self._image is None or delta.number != told.next):
            told.untold += 1
            return
        if told.first < 0:
            told.first = told.next = delta.number
        if delta.number > told.next:
            told.lost += delta.number - told.next
            told.gaps.append((told.next, delta.number - told.next, time.monotonic()))
        if self._image is None:
            self._image = np.zeros(words.count, np.uint64)
        words.apply(delta, self._image)
        told.next, told.received, told.bytes = delta.number + 1, told.received + 1, told.bytes + len(data)
        self._check(words.frame(self._image), delta.number, is_last=delta.is_last)

    def _check(self, frame: Any, number: int, *, is_last: bool) -> None:
        told, values = self.told, frame["values"]
        at = int(frame["number"])
        if self.is_made:
            told.wrong += not (is_last or at == number) or bool((values != value(at)).any())
            made = int(frame["raws"][0])
        else:
            half = values[: (len(values) - 1) // 2]  # but for the timer, which is the last
            told.wrong += bool((half != half[0]).any()) or at < told.frame
            made = int(frame["began"])
        told.frame, told.ended = at, told.ended or is_last
        if not is_last:
            told.latest = max(told.latest, (time.monotonic_ns() - made) * 1e-9)


class Checker:
    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self.incoming: queue.SimpleQueue[tuple[StationKey, str, bytes]] = queue.SimpleQueue()
        self.followed: dict[tuple[StationKey, bytes], Follower] = {}
        self._queries = PastQueries(session, lambda key, run, data: self.incoming.put((key, keys.PAST, run + data)))
        self._subscriber = session.declare_subscriber(EVERY.key(keys.DELTA), self._put)

    def _put(self, sample: zenoh.Sample) -> None:
        self.incoming.put((keys.station_of(str(sample.key_expr)), keys.DELTA, bytes(sample.payload)))

    def take(self, key: StationKey, kind: str, data: bytes) -> None:
        if kind == keys.DECLARATION:
            about, layout, *_ = unpacked(data)
            follower = self._follower(key, bytes.fromhex(json.loads(about)["run"]))
            if follower.needs_layout:
                follower.words = WordFrame(Layout.parse(layout))
                follower.go_on()
        elif kind == keys.PAST:
            self._follower(key, data[:RUN_BYTES]).take_past(data[RUN_BYTES:])
        else:
            self._follower(key, peek(data).run).take(data)

    def _follower(self, key: StationKey, run: bytes) -> Follower:
        if (follower := self.followed.get((key, run))) is None:
            known = MADE_WORDS if key.station.startswith(MADE) else None
            follower = self.followed[key, run] = Follower(key, run, known)
        return follower

    def look(self) -> None:
        """Ask for what is missing."""
        now = time.monotonic()
        for each in self.followed.values():
            if each.needs_layout and now - each.asked > ASK_AGAIN:
                each.asked = now
                declared = zenoh.handlers.Callback(partial(self._declared, each.key))
                self._session.get(each.key.key(keys.DECLARATION), declared, timeout=3.0)
            if not self._queries.are_too_many and (request := each.feed.request(now)) is not None:
                self._queries.ask(each.key, request)
                each.go_on()

    def _declared(self, key: StationKey, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self.incoming.put((key, keys.DECLARATION, bytes(reply.ok.payload)))

    def found(self) -> dict[str, Any]:
        return {f"{key}/{run.hex()}": asdict(each.told) for (key, run), each in self.followed.items()}


def main(report: Path, addresses: list[str]) -> None:
    file = report_file.ReportFile(report)
    session = opened(FleetNetwork(connect=addresses), "client")
    checker = Checker(session)
    looked = 0.0
    while not (file.ends and checker.incoming.empty()):
        if time.monotonic() - looked > LOOK:
            checker.look()
            looked = time.monotonic()
        try:
            checker.take(*checker.incoming.get(timeout=LOOK))
        except queue.Empty:
            pass
        except FramesError as error:
            print(f"{error}", file=sys.stderr)
        file.write(checker.found)
    file.write(checker.found, now=True)
    session.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

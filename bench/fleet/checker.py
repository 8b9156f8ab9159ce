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
from umo.errors import FramesError
from umo.fleet import fleet_keys as keys
from umo.fleet.fleet_keys import EVERY, StationKey
from umo.fleet.fleet_mirror import subscribed
from umo.fleet.fleet_session import FleetNetwork, opened
from umo.fleet.message_parts import unpacked
from umo.fleet.run_words import WordFrame, Words, peek
from umo.frames.layout import Layout

MADE = "made"
"""Names of stations that do not exist begin with it (`bench.fleet.rings`)."""
MADE_WORDS = WordFrame(layout_of(MADE))
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
    """In gaps that were not."""
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

    def __init__(self, key: StationKey, words: WordFrame | None) -> None:
        self.told = FollowedRun(str(key))
        self.words, self.is_made = words, words is not None
        self.held: list[bytes] = []
        """Deltas that wait for the declaration."""
        self.asked = 0.0
        self._image: Words | None = None

    def declare(self, about: dict[str, Any], layout: bytes, words: bytes) -> None:
        """Go on from this image; with the deltas that were held."""
        if self.words is None:
            self.words = WordFrame(Layout.parse(layout))
        held, self.held = self.held, []
        number, told = int(about["number"]), self.told
        begins = bool(held) and self.words.parse(held[0]).is_full
        if words and number >= told.next and not begins:
            self._image = np.frombuffer(words, np.uint64).copy()
            if told.first < 0:
                told.first = number + 1
            else:
                self._gap(number + 1, told=False)
            told.next = number + 1
        for data in held:
            self.take(data)

    def take(self, data: bytes) -> bool:
        """A delta. False: it waits for a declaration."""
        if self.words is None or self.held:
            self.held.append(data)
            return False
        delta, told = self.words.parse(data), self.told
        if delta.number < told.next:
            told.again += 1
            return True
        if not delta.is_full and (self._image is None or delta.number != told.next):
            self.held.append(data)
            return False
        if told.first < 0:
            told.first = told.next = delta.number
        if delta.number > told.next:
            self._gap(delta.number, told=True)
        if self._image is None:
            self._image = np.zeros(self.words.count, np.uint64)
        self.words.apply(delta, self._image)
        told.next, told.received, told.bytes = delta.number + 1, told.received + 1, told.bytes + len(data)
        self._check(self.words.frame(self._image), delta.number, is_last=delta.is_last)
        return True

    def _gap(self, number: int, *, told: bool) -> None:
        this = self.told
        count = number - this.next
        if told:
            this.lost += count
        else:
            this.untold += count
        this.gaps.append((this.next, count, time.monotonic()))

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
        self._subscriber = subscribed(session, EVERY.key(keys.DELTA), self._put)

    def _put(self, sample: zenoh.Sample) -> None:
        self.incoming.put((keys.station_of(str(sample.key_expr)), keys.DELTA, bytes(sample.payload)))

    def take(self, key: StationKey, kind: str, data: bytes) -> None:
        if kind == keys.DECLARATION:
            about, layout, words, _ = unpacked(data)
            facts = json.loads(about)
            if (follower := self.followed.get((key, bytes.fromhex(facts["run"])))) is not None:
                follower.declare(facts, layout, words)
            return
        run, _ = peek(data)
        if (follower := self.followed.get((key, run))) is None:
            known = MADE_WORDS if key.station.startswith(MADE) else None
            follower = self.followed[key, run] = Follower(key, known)
        if not follower.take(data) and time.monotonic() - follower.asked > ASK_AGAIN:
            follower.asked = time.monotonic()
            self._session.get(
                key.key(keys.DECLARATION), zenoh.handlers.Callback(partial(self._declared, key)), timeout=3.0
            )

    def _declared(self, key: StationKey, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self.incoming.put((key, keys.DECLARATION, bytes(reply.ok.payload)))

    def found(self) -> dict[str, Any]:
        return {f"{key}/{run.hex()}": asdict(each.told) for (key, run), each in self.followed.items()}


def main(report: Path, addresses: list[str]) -> None:
    file = report_file.ReportFile(report)
    session = opened(FleetNetwork(connect=addresses), "client")
    checker = Checker(session)
    while not (file.ends and checker.incoming.empty()):
        try:
            checker.take(*checker.incoming.get(timeout=0.1))
        except queue.Empty:
            pass
        except FramesError as error:
            print(f"{error}", file=sys.stderr)
        file.write(checker.found)
    file.write(checker.found, now=True)
    session.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

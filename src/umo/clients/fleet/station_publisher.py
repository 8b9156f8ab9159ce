"""Publishes one running station in a fleet: its declaration, deltas, events and status."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from contextlib import suppress
from math import ceil
from typing import Any

import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.kept_deltas import KeptDeltas
from umo.clients.fleet.message_parts import packed
from umo.clients.fleet.run_words import FULL, FULL_EVERY, LAST, Delta, RunMetadata, WordFrame, Words
from umo.cycle.stage import Stage
from umo.errors import text_of
from umo.objects.presentation.run_facts import ALARMS
from umo.plant.twin import declares_twin, place_of, twin_of
from umo.process.frames import Reader, RunReader
from umo.process.frames.layout import DESCRIPTION, without_job
from umo.process.frames.reader import FRAME_HEAD
from umo.process.frames.run_reader import NumberedEvent

KEPT = 60.0
"""Time in s for which deltas are kept for recorders and mirrors that have missed some."""
MAX_DELTAS = 100
"""Largest number of deltas sent at one look; further frames of the ring follow at the next looks."""
REST_EVERY = 10
"""One delta in this number of deltas contains the metadata, even if they have not changed."""
STATUS_FIELDS = ("done", "total", "progress", "signals", "equipment", "alarms")
"""Fields of a frame that the status contains."""
STATUS_PAUSE = 1.0
"""Time in s from one publication of the status to the next."""


class StationPublisher:
    """The publisher of one station. `interval`: shortest time in s from one delta to the next."""

    def __init__(self, session: zenoh.Session, key: StationKey, reader: Reader, interval: float) -> None:
        self.key, self.reader = key, reader
        about = reader.about
        period = float(about["period"])
        self.stride = max(1, round(interval / period)) if period else 1
        self.run = run_of(about, self.stride)
        self._frames = WordFrame(reader.layout)
        self._tunables = 8 * len(reader.layout.tunables)
        oldest = max(0, reader.head - reader.slots + 1)
        self._next = oldest // self.stride
        self._event = 0
        self._words: Words | None = None
        self._rest = b""
        self.latest: tuple[int, Words, bytes] | None = None
        """Number, words and metadata of the last delta."""
        self.time = float("-inf")
        """Time of the last published frame, s on the cycle's clock."""
        self._status: dict[str, Any] = {}
        self._status_at = 0.0
        self._status_about: Any = ()
        fields = reader.layout.dtype.fields
        assert fields is not None
        self._began = fields["began"][1] // 8
        found = [fields[name] for name in STATUS_FIELDS]
        self._status_parts = [slice(at, at + kind.itemsize) for kind, at, *_ in found]
        self.kept = KeptDeltas(
            max(MAX_DELTAS, ceil(KEPT / max(interval, self.stride * period or interval))), FULL_EVERY
        )
        self._deltas, self._events, self._statuses = (
            session.declare_publisher(key.key(kind), congestion_control=zenoh.CongestionControl.DROP)
            for kind in (keys.DELTA, keys.EVENT, keys.STATUS)
        )
        self._past = session.declare_queryable(key.key(keys.PAST), self._tell_past)
        self._declared = session.declare_queryable(key.key(keys.DECLARATION), self._declare)
        self._told = session.declare_queryable(key.key(keys.STATUS), self._tell_status)
        self._twin = session.declare_queryable(key.key(keys.TWIN), self._describe_twin)
        self.look()
        self._alive = session.liveliness().declare_token(key.key(keys.ALIVE))

    # Looks ---------------------------------------------------------------------------------------------

    def look(self) -> bool:
        """Publish new data. Return False if the run has ended and all its data were sent."""
        reader = self.reader
        count = self._publish_new()
        ended = count == 0 and reader.state is Stage.ENDED  # who writes frames lives
        if ended and self._publish_new():  # the last ones came in between
            return True
        if reader.now().next_event > self._event:
            self._publish_events(reader.events(self._event))
        if ended:  # after everything else
            self._publish_last()
        if (now := time.monotonic()) - self._status_at >= STATUS_PAUSE or ended:
            self._status_at = now
            self._publish_status()
        return not ended

    def _publish_new(self) -> int:
        """Publish the frames since the last call, at most `MAX_DELTAS` of them. Return the number of published
        frames."""
        reader, stride = self.reader, self.stride
        head = reader.head
        oldest = max(0, head - reader.slots + 1)
        first = max(self._next, oldest // stride)
        numbers = range(first, min(head // stride, first + MAX_DELTAS))
        if not numbers:
            return 0
        rest, last, count = self._rest_of(), None, 0
        for number in numbers:
            if (data := reader.frame_bytes(number * stride + stride - 1)) is not None:
                self._publish(data, number, rest)
                last = data
                count += 1
        if last is not None:
            self.time = FRAME_HEAD.unpack_from(last)[3]
        return count

    def _publish(self, frame: bytes, number: int, rest: bytes, flags: int = 0) -> None:
        words = self._frames.words_of(frame)
        if self._words is None or number > self._next or number % FULL_EVERY == 0:
            flags |= FULL
        places, changed = self._frames.changed(words, None if flags & FULL else self._words)
        told = rest if rest != self._rest or number % REST_EVERY == 0 or flags else b""
        delta = Delta(self.run, number, flags, places, changed, told, events=self._event)
        data = delta.packed()
        self.kept.add(delta, data)
        self._deltas.put(data)
        self._next, self._words, self._rest = number + 1, words, rest
        self.latest = number, words, rest

    def _publish_last(self) -> None:
        """Publish the last frame of the run, whatever its number, and the end of the run."""
        if (frame := self.reader.latest()) is not None:
            self._publish(frame.tobytes(), self._next, self._rest_of(), LAST)

    def _rest_of(self) -> bytes:
        """Return the metadata in packed form."""
        memory, now = self.reader.live_bytes(0, DESCRIPTION), self.reader.now()
        tunables = self.reader.told_bytes()[-self._tunables :] if self._tunables else b""
        return RunMetadata.of(memoryview(memory).cast("q"), (now.lease, now.holder), tunables).packed()

    def _publish_events(self, events: Sequence[NumberedEvent]) -> None:
        if not events:
            return
        self._event = events[-1].number + 1
        told = [[each.number, *each.event] for each in events]
        self._events.put(json.dumps({"run": self.run.hex(), "events": told}))

    # Queries, of a thread of Zenoh ---------------------------------------------------------------------------

    def _declare(self, query: zenoh.Query) -> None:
        with query:
            number, words, rest = (-1, b"", b"") if self.latest is None else self.latest
            about = {
                "run": self.run.hex(), "number": number, "stride": self.stride, "site": self.key.site,
                "event": self._event, "twin": declares_twin(place_of(self.reader.layout)),
                "head": self.reader.head // self.stride - 1, "age": self._age_of(words),
            }  # fmt: skip
            query.reply(
                self.key.key(keys.DECLARATION),
                packed(json.dumps(about).encode(), without_job(self.reader.layout).describe(), bytes(words), rest),
            )

    def _age_of(self, words: Words | bytes) -> float:
        """Return the time in s since the frame of these words was created, by the clock of this computer."""
        if not len(words):
            return 0.0
        return max(0.0, (time.monotonic_ns() - int(words[self._began])) * 1e-9)

    def described(self) -> bytes:
        """Return the declaration of the run, without values."""
        about = {"run": self.run.hex(), "number": -1, "stride": self.stride, "site": self.key.site, "event": 0}
        return packed(json.dumps(about).encode(), self.reader.layout.describe(), b"", b"")

    def _tell_past(self, query: zenoh.Query) -> None:
        """Answer with earlier data that the caller has missed (`umo.clients.fleet.run_feed`)."""
        with query, suppress(ValueError):  # of a number that is none, or of frames that have just been closed
            asked = query.parameters
            if asked.get("run") != self.run.hex():  # of one that has ended
                return
            head, deltas = self.kept.since(int(asked.get("delta") or 0))
            event = self.reader.now().next_event
            events = self.reader.events(int(asked.get("event") or 0))[:MAX_DELTAS]
            if events:
                event = events[-1].number + 1 if len(events) == MAX_DELTAS else max(event, events[-1].number + 1)
            about = {"head": head, "event": event, "events": [[each.number, *each.event] for each in events]}
            query.reply(self.key.key(keys.PAST), packed(json.dumps(about).encode(), *deltas))

    def _tell_status(self, query: zenoh.Query) -> None:
        with query:
            told = self._status and self._status | {"run_time_s": self.reader.lasted}  # by its own clock
            query.reply(self.key.key(keys.STATUS), json.dumps(told))

    def _describe_twin(self, query: zenoh.Query) -> None:
        with query:
            try:
                twin = twin_of(self.reader.layout, place_of(self.reader.layout))
            except Exception as error:  # of the station's own code
                twin = {"error": text_of(error)}
            query.reply(self.key.key(keys.TWIN), json.dumps(twin))

    def _publish_status(self) -> None:
        about = self._about_status()
        if about == self._status_about and self.reader.state is not Stage.ENDED:
            return
        self._status_about = about
        if (status := status_of(self.reader)) != self._status:
            self._status = status
            self._statuses.put(json.dumps(status))

    def _about_status(self) -> Any:
        """Return the values on which the status depends. A new status, which takes longer, is made only if they have
        changed."""
        if self.latest is None:
            return None
        _, words, rest = self.latest
        data = words.tobytes()
        return rest, self._event, *(data[part] for part in self._status_parts)

    def end(self) -> None:
        """Record the end of the run. Its published data can still be requested."""
        undeclared: list[Any] = [
            self._alive,
            self._declared,
            self._told,
            self._twin,
            self._statuses,
            self._deltas,
            self._events,
        ]
        for each in undeclared:
            each.undeclare()

    def close(self) -> None:
        """Close the publisher; called after `end`."""
        self._past.undeclare()
        self.reader.close()


def run_of(about: dict[str, Any], stride: int) -> bytes:
    """Return 8 bytes that identify a run and the stride of its deltas."""
    text = json.dumps([stride, *(about[key] for key in ("station", "place", "pid", "started", "started_monotonic"))])
    return hashlib.blake2b(text.encode(), digest_size=8).digest()


def status_of(reader: RunReader) -> dict[str, Any]:
    """Return the data of a run that a list of stations shows."""
    about, frame, now = reader.about, reader.latest(), reader.now()
    facts = reader.facts(frame)
    return {
        "station": about["station"], "wiring": about["wiring"], "pid": about["pid"], "since": about["started"],
        "period": about["period"], "state": str(reader.state),
        "mode": None if now.mode is None else str(now.mode), "lease": now.holder, "missed": now.missed,
        "alarms": len(reader.alarms(frame)), "text": facts.get(ALARMS, ""),
        "faults": reader.faults(frame), "states": reader.unit_states(frame), "progress": facts.get("progress", ""),
    }  # fmt: skip

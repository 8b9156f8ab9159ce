"""A mirror shows a station of a fleet as if it ran on this computer. It keeps the frames of the station in a ring of
this process, and passes commands on to the station.

    reader = find("cell7/press")        # like the result of `umo.process.frames.search.find_running`

One thread applies the messages in order, answers the commands in the ring's cells, and marks values that are no longer
fresh. A mirror belongs to one run, and ends with that run.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet import fleet_settings
from umo.clients.fleet.arrival_ages import ArrivalAges
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_rules import USER
from umo.clients.fleet.fleet_session import anybody, opened_client
from umo.clients.fleet.fleet_settings import FleetSettings
from umo.clients.fleet.message_parts import unpacked
from umo.clients.fleet.mirror_commands import MirrorCommands
from umo.clients.fleet.past_queries import PastQueries
from umo.clients.fleet.run_feed import RunFeed
from umo.clients.fleet.run_words import RunMetadata, WordFrame, Words, peek
from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import FramesError, UmoError
from umo.objects import Quality
from umo.process.frames import Reader
from umo.process.frames.layout import Layout, Live
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring_copy import RingCopy
from umo.system.utc import utc
from umo.text import did_you_mean

log = logging.getLogger("umo.fleet")
ANSWER_TIME = 3.0
"""Time in s within which a station must answer with its declaration."""
STALE_AFTER = 1.5
"""Age in s of the last delta at which all values become stale. If 10 periods are longer, they apply instead."""
NONE = -2
"""The number of an image before its first delta."""
CHECK_PAUSE = 0.5
"""Time in s between two queries for the present run."""
LOOK_INTERVAL = 0.02
"""Time in s from one reading of the cells to the next."""


class FleetReader(Reader):
    """A reader of a mirror, which ends when the mirror ends."""

    def __init__(self, path: Path, ends: RunDescriptors, end: Callable[[], None]) -> None:
        super().__init__(path, ends)
        self._end_mirror = end

    def close(self) -> None:
        super().close()
        self._end_mirror()


class FleetMirror:
    """The mirror of one station. Raises FramesError if the station does not answer with its declaration. The mirror
    closes the session at its end."""

    def __init__(self, session: zenoh.Session, key: StationKey, user: str) -> None:
        self.key = key
        self._session = session
        self._incoming: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._subscribers = [
            session.declare_subscriber(key.key(kind), partial(self._put, kind)) for kind in (keys.DELTA, keys.EVENT)
        ]
        self._queries = PastQueries(session, lambda _, run, data: self._incoming.put((keys.PAST, data)))
        asked = time.monotonic_ns()
        about, described, words, rest = unpacked(declaration_of(session, key))
        facts = json.loads(about)
        self._run = bytes.fromhex(facts["run"])
        layout = Layout.parse(described)
        layout.about.update(site=key.site, station=str(key), place="", twin=bool(facts.get("twin")))
        self._words = WordFrame(layout)
        writer, self._readers = RunDescriptors.pair()
        self._ring = RingCopy(layout, writer)
        self._image: Words = np.zeros(self._words.count, np.uint64)
        self._number = int(facts["number"])
        self._events = 0
        """The number of events in the ring."""
        fields = layout.dtype.fields
        assert fields is not None
        self._time, self._began = (fields[name][1] // 8 for name in ("time", "began"))
        self._ages = ArrivalAges()
        (width,) = fields["quality"][0].shape
        self._qualities = slice(fields["quality"][1], fields["quality"][1] + width)
        self._feed = RunFeed(self._run, self._number + 1, max(0, int(facts["event"]) - 1), time.monotonic())
        self.lost = 0
        """Number of deltas that did not arrive."""
        self._ended = threading.Event()
        self._heard = time.monotonic()
        """The earliest time in s at which the shown data may have been created."""
        self._checked = float("-inf")
        self._is_stale = False
        self._limit = max(STALE_AFTER, 10 * float(layout.about["period"]))
        self._commands = MirrorCommands(session, key, user, self._ring, self._tell)
        if words:
            self._compare_clocks(facts, words, asked)
            self._take_image(words, rest)
        self._thread = threading.Thread(target=self._follow, name=f"umo fleet {key}", daemon=True)
        self._thread.start()

    def reader(self) -> Reader:
        return FleetReader(Path(str(self.key)), self._readers, self.close)

    def _put(self, kind: str, sample: zenoh.Sample) -> None:
        self._incoming.put((kind, bytes(sample.payload)))

    # The thread ----------------------------------------------------------------------------------------------

    def _follow(self) -> None:
        while not self._ended.is_set():
            self._step()
        self._finish()

    def _step(self) -> None:
        """Process the next message, and do what is due."""
        try:
            kind, data = self._incoming.get(timeout=LOOK_INTERVAL)
        except queue.Empty:
            kind, data = "", b""
        try:
            if kind:
                self._take(kind, data)
            if (request := self._feed.request(time.monotonic())) is not None:
                self._queries.ask(self.key, request)
            self._go_on()
            self._commands.look()
            if not self._is_stale and time.monotonic() - self._heard > self._limit:
                self._grow_stale()
        except UmoError as error:
            log.warning("%s: %s", self.key, error)
        except Exception as error:
            log.warning("%s: %s", self.key, error, exc_info=error)

    def _take(self, kind: str, data: bytes) -> None:
        """Pass arrived data through the feed."""
        feed, now = self._feed, time.monotonic()
        if kind == keys.PAST:
            feed.take_past(data)
        elif kind == keys.EVENT:
            told = json.loads(data)
            if bytes.fromhex(told["run"]) == self._run:
                feed.take_events(told)
        elif peek(data).run != self._run:
            self._check("a delta of another run has arrived; it was not used")
        elif not feed.take_delta(data, now) and self._is_stale:
            self._check("")

    def _go_on(self) -> None:
        """Use the next events and deltas. The mirror ends with the last delta of the run, even if that delta is
        unusable."""
        self._take_events(self._feed.events())
        deltas = self._feed.deltas()
        if self._feed.is_over:
            self._ended.set()
        for each in deltas:
            self._take_delta(each)

    def _take_delta(self, data: bytes) -> None:
        delta = self._words.parse(data)
        if delta.number <= self._number:  # the image has been taken since
            return
        if delta.number != self._number + 1 and not delta.is_full:
            self._ask_again()
            return
        self._count_lost(delta.number)
        self._number = delta.number
        self._words.apply(delta, self._image)
        if self._image.view(np.uint8)[self._qualities].max(initial=0) > Quality.BAD:
            self._number = NONE
            raise FramesError("a delta contains a quality that does not exist; it was not used")
        if delta.rest:
            self._take_rest(delta.rest)
        self._show()
        if self._is_stale:  # or the last declaration was slow, or a computer has slept since
            self._check("")

    def _check(self, otherwise: str) -> None:
        """Ask the station for its state, because a message does not follow the last one. If the run has ended, the
        mirror ends. If the station's deltas are behind those of the mirror, the mirror takes the present image. In
        other cases `otherwise` is logged."""
        now = time.monotonic()
        if now - self._checked < CHECK_PAUSE:
            return
        self._checked = now
        facts, _, _ = self._declaration()
        if bytes.fromhex(facts["run"]) != self._run:
            self._ended.set()
        elif int(facts["head"]) < self._number:  # not only a gateway that has begun anew, and has not come so far yet
            self._ask_again()
        elif otherwise:
            log.warning("%s: %s", self.key, otherwise)

    def _ask_again(self) -> None:
        """Take the present image of the station, because deltas are missing. Until the answer arrives, all values are
        stale."""
        if not self._is_stale:
            self._grow_stale()
        facts, words, rest = self._declaration()
        if bytes.fromhex(facts["run"]) != self._run or not words:
            return
        self._count_lost(number := int(facts["number"]))
        self._number = number
        self._feed.restart(number + 1)
        self._take_image(words, rest)

    def _declaration(self) -> tuple[dict[str, Any], bytes, bytes]:
        """Ask for the declaration of the station, and compare the clocks. Return its facts, its image and the rest."""
        asked = time.monotonic_ns()
        about, _, words, rest = unpacked(declaration_of(self._session, self.key))
        facts = json.loads(about)
        if words and bytes.fromhex(facts["run"]) == self._run:
            self._compare_clocks(facts, words, asked)
        return facts, words, rest

    def _compare_clocks(self, facts: dict[str, Any], words: bytes, asked: int) -> None:
        """Compare the clocks by the image of a declaration that was asked for at `asked` (ns): its age is known."""
        age = float(facts.get("age", 0.0))  # 0: an older gateway does not send it
        self._ages.know(int(np.frombuffer(words, np.int64)[self._began]), asked - round(age * 1e9))

    def _take_image(self, words: bytes, rest: bytes) -> None:
        """Show the image of a declaration."""
        self._image[:] = np.frombuffer(words, np.uint64)
        self._take_rest(rest)
        self._show()

    def _count_lost(self, number: int) -> None:
        if self._number != NONE:
            self.lost += max(0, number - self._number - 1)

    def _take_rest(self, data: bytes) -> None:
        rest = RunMetadata.parse(data)
        state = min(rest.state, Stage.STOPPING)  # it has ended when its last events are here
        self._ring.live({Live.STATE: state, Live.MODE: rest.mode, Live.MISSED: rest.missed})
        self._ring.lease(rest.lease, rest.holder)
        self._ring.tunables(rest.tunables)

    def _take_events(self, events: list[list[Any]]) -> None:
        for _, at, path, text, who, command, state, asked in events:
            local = self._commands.local(int(command))
            self._tell(Event(at, path, text, who, local, CommandState(state), asked))
            if local and state != CommandState.BEGUN:
                self._commands.has_ended(local)

    def _tell(self, event: Event) -> None:
        """Add an event to the ring. If the event has no time, it gets the present time."""
        now = float(self._image.view("<f8")[self._time]) if not event.time else event.time
        self._ring.event(self._events, event._replace(time=now))
        self._events += 1

    # The ring ------------------------------------------------------------------------------------------------

    def _show(self) -> None:
        """Show the image that has just arrived. An image that arrives late, for example after a loss of the network, is
        stale."""
        now = time.monotonic()
        self._heard = now - self._ages.age(int(self._image.view("<i8")[self._began]))
        self._is_stale = now - self._heard > self._limit
        self._add(Quality.STALE if self._is_stale else Quality.GOOD)

    def _add(self, best: Quality) -> None:
        """Add the image to the ring as a frame. No value gets a better quality than `best`. The frame's time is
        converted from its UTC to the clock of this computer, and its number of taken commands to the numbers of this
        computer."""
        frame = np.frombuffer(bytearray(self._image.tobytes()), self._words.dtype)
        moment = int(frame["began"][0]) + int(frame["utc"][0])
        offset, _ = utc()
        frame["began"] = min(moment - offset, time.monotonic_ns())
        frame["utc"] = moment - frame["began"]
        frame["taken"] = self._commands.taken(int(frame["taken"][0]))
        frame["quality"] = np.maximum(frame["quality"], np.uint8(best))
        self._ring.frame(frame.tobytes())

    def _grow_stale(self) -> None:
        """Mark all values as stale, because nothing has arrived for too long."""
        self._is_stale = True
        self._add(Quality.STALE)

    def _finish(self) -> None:
        for each in self._subscribers:
            each.undeclare()
        self._ring.close()

    def close(self) -> None:
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(ANSWER_TIME)
        with suppress(zenoh.ZError):
            self._session.close()


def declaration_of(session: zenoh.Session, key: StationKey) -> bytes:
    """Return the declaration of a station. Raises FramesError if the station does not answer."""
    return answer_of(session, key, keys.DECLARATION)


def answer_of(session: zenoh.Session, key: StationKey, kind: str) -> bytes:
    """Return a station's answer to a query of one kind. Raises FramesError if the station does not answer."""
    for reply in session.get(key.key(kind), timeout=ANSWER_TIME):
        if reply.ok is not None:
            return bytes(reply.ok.payload)
    raise FramesError(f"{key} does not answer")


def find(name: str, settings: FleetSettings | None = None) -> Reader:
    """Return the frames of a station of the fleet, `SITE/STATION`. The FramesError for an unknown station lists the
    known ones. `settings` defaults to the settings of this user."""
    key = keys.station_key(name)
    settings = fleet_settings.load() if settings is None else settings
    settings.require(USER)
    session = opened_client(settings.network)
    try:
        until = time.monotonic() + ANSWER_TIME
        while key not in (there := anybody(session)):
            if time.monotonic() > until:
                names = [str(each) for each in there]
                running = ", ".join(names) or f"none; {settings.why_none}"
                raise FramesError(f"{name!r} is not in the fleet{did_you_mean(name, names)}; there are: {running}")
            time.sleep(LOOK_INTERVAL)
        return FleetMirror(session, key, settings.user).reader()
    except BaseException:
        session.close()
        raise


def find_named(name: str) -> Reader | None:
    """Return the result of `find` for a name that can belong to a fleet and is not a folder; None for other names."""
    return find(name) if keys.is_station_key(name) and not os.path.isdir(name) else None

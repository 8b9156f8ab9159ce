"""A station, its gateway and a mirror of it under a schedule of their messages, and what must be true of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bench.fleet.rings import PERIOD, layout_of, value
from tools.message_orders.fleet_net import Net, NetSession, virtual_fleet
from tools.message_orders.link_world import Untrue, require
from tools.message_orders.schedules import Schedule
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_mirror import STALE_AFTER, FleetMirror
from umo.clients.fleet.station_publisher import StationPublisher
from umo.cycle.events import CommandState, Event
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.objects import Quality
from umo.process.frames import Reader
from umo.process.frames.layout import Live
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring_copy import RingCopy

SCENARIOS = ("join", "follow", "silence", "stalled", "away", "end")
KEY = StationKey("c1", "made")
OBJECTS = 4
LOOK = 0.05
"""s from one step of gateway and mirror to the next."""
SHORT, LONG = 0.25, 1.2
"""Times in s for which a message is held: two deltas pass, or values are soon not fresh any more."""
AWAY = 14.0
"""Time in s for which a mirror hears nothing: longer than a gateway keeps deltas (`virtual_fleet`)."""
IN_STEP_TIME = 12.0
"""s after the last message that the schedule decides over within which a mirror has all that there is."""
END_TIME = 60.0
"""s after its run, and after the last message that the schedule decides over, within which a mirror ends."""


class Station:
    """A ring in which value k of frame n is known, and its events."""

    def __init__(self) -> None:
        layout = layout_of("made", OBJECTS)
        writer, readers = RunDescriptors.pair()
        self._ring = RingCopy(layout, writer)
        self._ring.live({Live.STATE: Stage.RUNNING})
        self.reader = Reader(Path("made"), readers)
        self._frame: Any = np.zeros(1, layout.dtype)
        self.number = self.events = 0

    def step(self, now: float) -> None:
        frame = self._frame
        frame["number"], frame["time"], frame["began"] = self.number, self.number * PERIOD, round(now * 1e9)
        frame["values"] = value(self.number, OBJECTS)
        self._ring.frame(frame.tobytes())
        self.number += 1
        if self.number % 3 == 0:
            self._tell(now)

    def _tell(self, now: float) -> None:
        self._ring.event(self.events, Event(now, "cell", f"event {self.events}", "", 0, CommandState.DONE, ""))
        self.events += 1

    def end(self, now: float) -> None:
        """Its last event, and the end."""
        self._tell(now)
        self._ring.live({Live.STATE: Stage.ENDED})

    def close(self) -> None:
        self.reader.close()
        self._ring.close()


class FeedWorld:
    """One station, from its first frame on."""

    def __init__(self, net: Net) -> None:
        self.net = net
        net.advance = self.advance
        session: Any = NetSession(net)
        self._session = session
        self.station = Station()
        self.station.step(0.0)
        self.publisher = StationPublisher(session, KEY, self.station.reader, PERIOD)
        self._next_frame, self._next_look = PERIOD, LOOK
        self.mirror: FleetMirror | None = None
        self.reader: Reader
        self._seen = self._next_event = self._event_before = 0
        """Frames and events of the mirror that were looked at, and the number at the station of its first event."""
        self._is_fresh = False
        self._makes_frames, self._published_all = True, False
        self._shown: set[int] = set()
        self._last = -1

    # Time ------------------------------------------------------------------------------------------------

    def advance(self, until: float) -> None:
        """Messages, the station and its gateway; the mirror may wait meanwhile."""
        net = self.net
        while min(self._next_frame, self._next_look) <= until:
            net.carry(min(self._next_frame, self._next_look))
            if self._next_frame <= net.now:
                self._next_frame += PERIOD
                if self._makes_frames:
                    self.station.step(net.now)
            if self._next_look <= net.now:
                self._next_look += LOOK
                if not self._published_all:
                    self._published_all = not self.publisher.look()
        net.carry(until)

    def step(self) -> None:
        """A while of the mirror's thread: all that has come, and a look."""
        self.advance(self.net.now + LOOK)
        mirror = self.mirror
        assert mirror is not None
        for _ in range(1 + len(mirror._incoming)):  # type: ignore[arg-type]
            if not mirror._ended.is_set():
                mirror._step()
            self._look()

    # What the mirror shows -------------------------------------------------------------------------------

    def join(self) -> bool:
        """A mirror begins. False: the station did not answer in time."""
        try:
            self.mirror = FleetMirror(self._session, KEY, "ann")
        except FramesError:
            return False
        self.reader = self.mirror.reader()
        self._dtype = self.reader.layout.dtype
        self._look()
        return True

    def _look(self) -> None:
        reader, now = self.reader, self.net.now
        for number in range(self._seen, reader.head):
            data = reader.frame_bytes(number)
            assert data is not None
            frame = np.frombuffer(data, self._dtype)[0]
            is_fresh = frame["quality"].max() == Quality.GOOD
            self._look_at(round(float(frame["time"]) / PERIOD), frame, is_fresh)
        self._seen = reader.head
        if self._shown and self._is_fresh:
            age = now - self._last * PERIOD
            require(age <= STALE_AFTER + 2 * LOOK, f"values are {age:g} s old, and shown as fresh")
        for number, event in reader.events(self._next_event):
            require(event.text == f"event {number + self._first_event(event)}", "an event is twice, or out of order")
            self._next_event = number + 1

    def _first_event(self, event: Event) -> int:
        """The number at the station of the first event of the mirror."""
        if not self._next_event:
            self._event_before = int(event.text.split()[1])
        return self._event_before

    def _look_at(self, made: int, frame: Any, is_fresh: bool) -> None:
        require(made < self.station.number, f"frame {made} is shown, which there was not")
        require(bool((frame["values"] == value(made, OBJECTS)).all()), f"frame {made} is not shown as it was")
        require(made >= self._last, f"frame {made} is shown after frame {self._last}")
        self._shown.add(made)
        self._last, self._is_fresh = made, is_fresh

    def check_in_step(self) -> None:
        """After a time without losses all is there."""
        mirror = self.mirror
        assert mirror is not None
        until = self.net.now + IN_STEP_TIME
        while self.net.now < until and not self._has_all:
            self.step()
        require(self._has_all, f"the mirror is not in step after {IN_STEP_TIME:g} s")
        missing = self._last - min(self._shown) + 1 - len(self._shown)
        require(missing == mirror.lost, f"{missing} frames are missing, and {mirror.lost} are told as lost")

    @property
    def _has_all(self) -> bool:
        there = self._last >= self.station.number - 2 and self._is_fresh
        return there and self._next_event + self._event_before >= self.station.events - 1

    # Scenarios -------------------------------------------------------------------------------------------

    def run(self, scenario: str) -> None:
        begins = scenario in ("join", "stalled")
        if not begins:
            self._settle()
        self._makes_frames = scenario not in ("stalled", "end")
        if scenario == "away":
            self._be_away(AWAY)
        self.net.counts = True
        if begins and not self.join():
            self.net.counts = False
            require(self.join(), "a station does not answer, whose messages come")
        if scenario == "stalled":
            self._go_silent()
            return
        if scenario == "end":
            self.station.end(self.net.now)
            self._until_ended()
            return
        for _ in range(400):
            if self.net.is_decided:
                break
            self.step()
        self.net.counts = False
        if scenario != "silence":
            self.check_in_step()
        self._go_silent()

    def _settle(self) -> None:
        require(self.join(), "a station does not answer, whose messages come")
        for _ in range(20):
            self.step()

    def _be_away(self, seconds: float) -> None:
        """Nothing comes meanwhile."""
        self.net.is_dead = True
        for _ in range(round(seconds / LOOK)):
            self.step()
        self.net.is_dead = False

    def _go_silent(self) -> None:
        """Nothing comes any more: no value stays fresh."""
        self._be_away(STALE_AFTER + LONG + 0.2)
        require(not self._is_fresh, "nothing comes any more, and values are shown as fresh")

    def _until_ended(self) -> None:
        mirror, decided = self.mirror, -1
        assert mirror is not None
        while not mirror._ended.is_set():
            if self.net.decided != decided:
                decided, until = self.net.decided, self.net.now + END_TIME
            require(self.net.now < until, f"the mirror does not end within {END_TIME:g} s")
            self.step()
        require(self._last == self.station.number - 1, "the mirror ends without the last frame")
        require(self._next_event + self._event_before == self.station.events, "it ends without the last event")

    def close(self) -> None:
        if self.mirror is not None:
            self.reader.close()
            self.mirror._finish()
        self.publisher.close()
        self.station.close()


class FeedRuns:
    """Runs schedules, each with a station, a gateway and a mirror of its own."""

    def run(self, schedule: Schedule) -> str:
        """What is untrue; "": nothing."""
        net = Net(schedule.letters, SHORT, LONG)
        with virtual_fleet(net):
            world = FeedWorld(net)
            try:
                world.run(schedule.scenario)
            except Untrue as error:
                return str(error)
            finally:
                world.close()
        return ""

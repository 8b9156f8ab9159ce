"""The gateway of a computer: publishes every station that runs on it, and passes commands on.

One task looks at all rings, one after the other, because waking up a task costs more than reading a ring. A station is
found within `SEARCH_PAUSE`. An error in one station does not affect the others.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import zenoh

from umo.clients.fleet.fleet_commands import FleetCommands, FleetUsers
from umo.clients.fleet.fleet_keys import StationKey, segment
from umo.clients.fleet.fleet_session import is_present
from umo.clients.fleet.sole_lease import SoleLease
from umo.clients.fleet.station_publisher import StationPublisher
from umo.errors import FramesError, UmoError, text_of
from umo.process.frames import Reader
from umo.process.frames.frame_server import sockets
from umo.process.frames.search import frames_at

if TYPE_CHECKING:
    from umo.clients.fleet.jetstream_publisher import JetStreamPublisher

log = logging.getLogger("umo.fleet")
RATE = 10.0
"""Default largest number of deltas per second of each station."""
SLOWEST, FASTEST = 0.1, 50.0
SEARCH_PAUSE = 0.5
"""Time in s from one search for stations to the next."""
REFUSED_PAUSE = 1.0
"""Time in s after which a station that could not be published is tried again. The token of a gateway that was killed
may still exist until then."""


AFTER_END = 60.0
"""Time in s after the end of a run during which its published data can still be requested."""
MOST_ENDED = 3
"""Largest number of ended runs of one station whose data can still be requested."""
REPORT_ATTEMPT = 2
"""Number of failed attempts after which a notice says that a station cannot be published."""


class UnpublishedStation(NamedTuple):
    """A station that could not be published."""

    tries: int
    until: float
    """Time of the next attempt, in s of the monotonic clock."""


class PublishedStation:
    """A station with its commands."""

    def __init__(self, publisher: StationPublisher, session: zenoh.Session, users: FleetUsers, read_only: bool) -> None:
        self.publisher = publisher
        self._looked = asyncio.Event()
        self._is_over = False
        self._gateway: SoleLease | None = None
        self._read_only = read_only
        self.commands = FleetCommands(session, publisher.key, users, self._ask)

    def look(self) -> bool:
        goes_on = self.publisher.look()
        self._is_over = not goes_on
        if self._gateway is not None:  # somebody may wait
            looked, self._looked = self._looked, asyncio.Event()
            looked.set()
        return goes_on

    async def _wait(self) -> float:
        if not self._is_over:
            await self._looked.wait()
        return inf if self._is_over else self.publisher.time

    def _ask(self) -> SoleLease:
        """Return the gateway for commands to this run. It is created for the first command."""
        if self._gateway is None:
            self._gateway = SoleLease(self.publisher.reader, "fleet", self._wait, is_reader=self._read_only)
        return self._gateway

    async def end(self) -> None:
        await self.commands.close()
        if self._gateway is not None:
            await self._gateway.close()
        self.publisher.end()


class FleetGateway:
    """The gateway. `site`: the first word of the keys of this computer's stations. `say` is called with notices for the
    user. `history` additionally publishes to a JetStream."""

    def __init__(
        self,
        session: zenoh.Session,
        site: str,
        users: FleetUsers,
        *,
        rate: float = RATE,
        read_only: bool = True,
        say: Callable[[str], object] = log.info,
        find: Callable[[], list[Path]] = sockets,
        history: JetStreamPublisher | None = None,
    ) -> None:
        self._session, self._site, self._users = session, site, users
        self._interval, self._read_only, self._say, self._find = 1.0 / rate, read_only, say, find
        self._history = history
        self._stations: dict[Path, PublishedStation] = {}
        self._refused: dict[Path, UnpublishedStation] = {}
        self._ended: list[tuple[float, StationPublisher]] = []
        """Runs that are over, each with the time until which its data can be requested, in s of the monotonic clock."""
        self._searched = -inf

    @property
    def stations(self) -> list[StationKey]:
        return [each.publisher.key for each in self._stations.values()]

    async def run(self) -> None:
        """Publish until cancelled."""
        try:
            while True:
                began = time.monotonic()
                if began - self._searched >= SEARCH_PAUSE:
                    self._searched = began
                    await self._search()
                    self._forget()
                await self._look()
                await asyncio.sleep(max(0.001, began + self._interval - time.monotonic()))
        finally:
            for path in list(self._stations):
                await self._leave(path)
            self._forget(inf)

    async def _look(self) -> None:
        for path, station in list(self._stations.items()):
            try:
                goes_on = station.look()
            except Exception as error:  # of a damaged ring
                self._refuse(path, f"{station.publisher.key}: its frames cannot be published: {text_of(error)}")
                goes_on = False
            if not goes_on:
                await self._leave(path)

    async def _leave(self, path: Path) -> None:
        station = self._stations.pop(path)
        self._say(f"{station.publisher.key} has ended")
        if self._history is not None:
            self._history.end(station.publisher)
        with suppress(zenoh.ZError, UmoError):
            await station.end()
        self._ended.append((time.monotonic() + AFTER_END, station.publisher))

    def _forget(self, now: float | None = None) -> None:
        """Close the runs that ended long ago. Of each station, keep at most the last `MOST_ENDED` runs that have
        ended."""
        now = time.monotonic() if now is None else now
        later: Counter[StationKey] = Counter()
        for ended in reversed(self._ended[:]):
            until, publisher = ended
            later[publisher.key] += 1
            if until <= now or later[publisher.key] > MOST_ENDED:
                self._ended.remove(ended)
                with suppress(zenoh.ZError, UmoError):
                    publisher.close()

    async def _search(self) -> None:
        """Publish the stations that have begun."""
        now = time.monotonic()
        there = self._find()
        self._refused = {path: each for path, each in self._refused.items() if path in there}
        for path in there:
            if path not in self._stations and (path not in self._refused or self._refused[path].until <= now):
                try:
                    reader = await asyncio.to_thread(frames_at, path)
                    await self._begin(path, reader)
                except (UmoError, OSError, zenoh.ZError) as error:
                    self._refuse(path, f"{path.name}: {text_of(error)}")

    def _refuse(self, path: Path, text: str) -> None:
        """Do not try to publish a station again for `REFUSED_PAUSE` s. The user is informed only after `REPORT_ATTEMPT`
        failed attempts, because the station may just have ended."""
        tries = self._refused[path].tries + 1 if path in self._refused else 1
        self._refused[path] = UnpublishedStation(tries, time.monotonic() + REFUSED_PAUSE)
        if tries == REPORT_ATTEMPT:
            self._say(text)

    async def _begin(self, path: Path, reader: Reader) -> None:
        if not reader.alive:
            reader.close()
            raise FramesError("it has ended")
        key = self._key_of(reader)
        if await asyncio.to_thread(is_present, self._session, key):
            reader.close()
            raise FramesError(
                f"{key} is already in the fleet, published by another computer: give this computer another --site"
            )
        publisher = StationPublisher(self._session, key, reader, self._interval)
        self._refused.pop(path, None)
        if self._history is not None:
            self._history.begin(publisher)
        self._stations[path] = PublishedStation(publisher, self._session, self._users, self._read_only)
        self._say(f"{key} (pid {reader.about['pid']})")

    def _key_of(self, reader: Reader) -> StationKey:
        """Return the key of a run. If the name of the station is already published, the key also contains the run's
        pid."""
        name = segment(str(reader.about["station"]))
        key = StationKey(self._site, name)
        return key if key not in self.stations else StationKey(self._site, f"{name}.{reader.about['pid']}")

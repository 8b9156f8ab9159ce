"""Reads the rings of all running stations of this user for all pages, in one task."""

from __future__ import annotations

import asyncio
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from umo.clients.page.watched_run import Watched
from umo.errors import FramesError, text_of
from umo.process.frames import Reader, rings
from umo.text import printable

if TYPE_CHECKING:
    from umo.clients.page.fleet_feed import FleetFeed

RATE = 30.0
"""Number of looks at the rings per second while a page is open."""
IDLE_RATE = 5.0
"""Number of looks at the rings per second while no page is open."""
LOOKS_PER_STATE = 3
"""Number of looks from one state to the next."""
SEARCH_PAUSE = 1.0
"""Time in s from one search for new rings to the next."""
DISK_PAUSE = 1.0
"""Time in s from one check of black boxes and records of ended runs to the next."""
RETRY_PAUSE = 10.0
"""Time in s after which a ring that could not be read is tried again."""
MAX_ENDED = 4
"""Number of ended runs that are kept in memory, so that their end can be inspected."""


class Feed:
    """The runs for all pages, in `watched` by name. A run that has ended stays until its station, in the same folder,
    starts again."""

    def __init__(self, fleet: FleetFeed | None = None, recorded: Watched | None = None) -> None:
        """`fleet`: the fleet whose stations are also shown; `recorded`: a recording that is shown instead of all
        runs."""
        self.fleet = fleet
        self._recorded = recorded
        self.watched: dict[str, Watched] = {} if recorded is None else {recorded.name: recorded}
        self.pages = 0
        """Number of open pages."""
        self._refused: dict[str, float] = {}
        """Names of rings that could not be read, each with the time at which it is tried again, in s of the monotonic
        clock."""
        self._looked = asyncio.Event()

    async def run(self) -> None:
        """Read the rings until cancelled."""
        around = asyncio.create_task(self._look_around())
        try:
            await self._look_at_rings()
        finally:
            around.cancel()

    async def _look_at_rings(self) -> None:
        search = 0.0
        looks = 0
        searching: asyncio.Task[None] | None = None
        while True:
            now = time.monotonic()
            if now >= search and (searching is None or searching.done()):
                search = now + SEARCH_PAUSE
                searching = asyncio.create_task(self.search())
            looks += 1
            self.look(states=looks % LOOKS_PER_STATE == 0)
            await asyncio.sleep(max(0.001, now + 1 / (RATE if self.pages else IDLE_RATE) - time.monotonic()))

    def look(self, states: bool) -> None:
        """Read every ring once, and wake the pages. With `states` they receive a new state. A damaged ring is
        dropped."""
        for watched in list(self.watched.values()):
            try:
                if not watched.over:
                    watched.read()
                watched.number += states
            except Exception as error:  # of a damaged ring: whatever struct, json, numpy, mmap raise
                self.drop(watched, error)
        looked, self._looked = self._looked, asyncio.Event()
        looked.set()

    async def looked(self) -> float:
        """Wait for the next look. Return the time of that look in s of this computer's monotonic clock."""
        await self._looked.wait()
        return time.monotonic()

    async def search(self) -> None:
        """Attach to new rings. This is done in a thread, because a stopped guardian may not answer. The last ended runs
        are kept."""
        if self._recorded is not None:
            return
        known, now = {watched.path for watched in self.watched.values()}, time.monotonic()
        there: list[Path] = []
        with suppress(FramesError):  # no folder: nothing runs
            there = rings()
        self._refused = {path.name: self._refused[path.name] for path in there if path.name in self._refused}
        paths = [path for path in there if path not in known and now >= self._refused.get(path.name, 0.0)]
        for path, watched in await asyncio.to_thread(_opened, paths):
            if isinstance(watched, Exception):
                self._refuse(path, watched)
            elif watched is not None:  # else its guardian is resetting the machine
                self._attach(watched)
        for watched in list(self.watched.values()):
            if self.fleet is not None and watched.is_elsewhere and self.fleet.is_unseen(watched):
                self.watched.pop(watched.name, None)
                await asyncio.to_thread(watched.close)
        ended = [name for name, watched in self.watched.items() if watched.over]
        for name in ended[:-MAX_ENDED]:
            self.watched.pop(name).close()

    async def open_elsewhere(self, name: str) -> None:
        """Watch a station of the fleet. Raises FramesError if the station does not answer."""
        before = self.watched.get(name)
        if self.fleet is None or (before is not None and not before.ended):
            return
        watched = await asyncio.to_thread(self.fleet.watched, name)
        if (before := self.watched.get(name)) is not None and not before.ended:  # another page was quicker
            await asyncio.to_thread(watched.close)
        else:
            self._attach(watched)

    def _attach(self, watched: Watched) -> None:
        before = self.watched.get(watched.name)
        if before is not None and before.ended and before.place == watched.place:
            before.close()
        elif before is not None:
            watched.name = f"{watched.name} (pid {watched.about['pid']})"
        self.watched.pop(watched.name, None)
        self.watched[watched.name] = watched

    def drop(self, watched: Watched, error: Exception) -> None:
        """Drop a run whose ring can no longer be read."""
        self._refuse(watched.path, error)
        self.watched.pop(watched.name, None)
        watched.close()

    def _refuse(self, path: Path, error: Exception) -> None:
        """Do not try to read a ring again for `RETRY_PAUSE` s. The first time, print the error."""
        if path.name not in self._refused and path.exists():
            print(f"umo: {printable(path.name)} is not shown: {printable(text_of(error))}", file=sys.stderr)
        self._refused[path.name] = time.monotonic() + RETRY_PAUSE

    async def _look_around(self) -> None:
        """Read the files of each run in a thread, so that pages and clients never wait for the disk."""
        while True:
            for watched in list(self.watched.values()):
                try:
                    await asyncio.to_thread(watched.look_around)
                except Exception as error:  # of a damaged description
                    if self.watched.get(watched.name) is watched:  # meanwhile it may have started again
                        self.drop(watched, error)
            await asyncio.sleep(DISK_PAUSE)

    def close(self) -> None:
        for watched in self.watched.values():
            watched.close()
        self.watched.clear()
        if self.fleet is not None:
            self.fleet.close()


def _opened(paths: list[Path]) -> list[tuple[Path, Watched | Exception | None]]:
    """Open rings. Return for each path its run, None if the processes of the run are gone, or the error."""
    found: list[tuple[Path, Watched | Exception | None]] = []
    for path in paths:
        try:
            with ExitStack() as opened:
                reader = opened.enter_context(Reader(path))
                reader.skip_older_half()
                is_alive = reader.alive
                found.append((path, Watched(reader) if is_alive else None))
                if is_alive:
                    opened.pop_all()
        except Exception as error:  # of another version, damaged, or gone
            found.append((path, error))
    return found

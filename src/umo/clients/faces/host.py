"""The host of faces: finds the run of a station, reads its frames, and calls each face with the changes.

    host = FaceHost("ztheta", [("prometheus", Prometheus(port=9464))])
    asyncio.run(host.run())

One look reads all new frames for all faces. Each face has a separate task, which receives the changes since its last
call, so a face that is slow or fails does not disturb the others. When the run ends or falls silent, every value
becomes stale; when the station runs again, each face begins again.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType

from umo.clients.faces.face import Face
from umo.clients.faces.face_image import ChangeFilter, FaceImage
from umo.clients.faces.gateway import Gateway
from umo.cycle.stage import Stage
from umo.errors import FramesError, UmoError, text_of
from umo.operation.commands.roles import Roles
from umo.process.frames import Reader, RunReader
from umo.process.frames.machine_items import Declaration, declaration_of
from umo.process.frames.run_reader import SILENCE
from umo.process.frames.search import find_running

log = logging.getLogger("umo.faces")
RATE = 10.0
"""Default number of looks at the frames per second."""
SLOWEST, FASTEST = 0.1, 100.0
SEARCH_PAUSE = 1.0
"""Time in s from one search for the station to the next."""
FIRST_PAUSE, MAX_PAUSE = 1.0, 30.0
"""Time in s after which a failed face is started again: the first one and the longest one. It doubles after each
failure."""
END_TIMEOUT = 5.0
"""Time in s within which a face must end."""
Find = Callable[[], Reader]


@dataclass
class Run:
    """One run of the station, as all faces use it."""

    reader: Reader
    machine: Declaration
    image: FaceImage
    over: str = ""
    """The reason why the run is over; "" while it runs."""
    looked: asyncio.Event = field(default_factory=asyncio.Event)


class FaceHost:
    """Serves one station. `faces`: pairs of name and face. `station`: the name, folder or pid of the station; None
    means the only running one. `read_only`: no face accepts commands."""

    def __init__(
        self,
        station: str | None,
        faces: Sequence[tuple[str, Face]],
        *,
        rate: float = RATE,
        read_only: bool = True,
        dead_bands: Mapping[str, float] = MappingProxyType({}),
        say: Callable[[str], object] = log.info,
        find: Find | None = None,
        opened: Callable[[], object] = lambda: None,
        roles: Callable[[], Roles] = Roles.load,
    ) -> None:
        """`opened` is called when every face can be reached; `roles` returns the present roles of users."""
        self._find: Find = (lambda: find_running(station)) if find is None else find
        self._faces, self._interval, self._read_only = faces, 1.0 / rate, read_only
        self._dead_bands, self._say, self._opened, self._roles = dead_bands, say, opened, roles
        self.told = 0
        """Number of calls of `frames` so far, of all faces."""
        self._run: Run | None = None
        self._found = asyncio.Event()

    async def run(self) -> None:
        """Serve the faces until cancelled. Raises UmoError if a face cannot open its server at the start."""
        opened: list[Face] = []
        try:
            for name, face in self._faces:
                try:
                    await face.open()
                except UmoError as error:
                    raise UmoError(f"{name}: {error}") from error
                opened.append(face)
            self._opened()
            tasks = [asyncio.create_task(self._serve(name, face)) for name, face in self._faces]
            try:
                await self._look()
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            for face in opened:
                with suppress(Exception):
                    await asyncio.wait_for(face.close(), END_TIMEOUT)
            if self._run is not None:
                self._run.reader.close()

    # Frames --------------------------------------------------------------------------------------------

    async def _look(self) -> None:
        told = ""
        while True:
            try:
                reader = await asyncio.to_thread(self._find)
            except UmoError as error:
                if str(error) != told:
                    told = str(error)
                    self._say(f"{told}; waiting for the station")
                await asyncio.sleep(SEARCH_PAUSE)
                continue
            told = ""
            await self._follow(reader)

    async def _follow(self, reader: Reader) -> None:
        """Look at one run until it is over."""
        try:
            machine = declaration_of(reader)
            run = Run(reader, machine, FaceImage(reader, machine))
        except Exception as error:
            reader.close()
            self._say(f"its frames cannot be served: {text_of(error)}")
            await asyncio.sleep(SEARCH_PAUSE)
            return
        self._say(f"{reader.title} (pid {reader.about['pid']})")
        self._run = run
        self._found.set()
        silent_after, heard = max(SILENCE, 10 * machine.period), time.monotonic()
        while not run.over:
            now = time.monotonic()
            try:
                ended = reader.state is Stage.ENDED  # before the frames: the last ones are among them
                if run.image.look():
                    heard = now
                elif now - heard > silent_after:
                    run.image.grow_stale()
            except Exception as error:  # of a damaged ring
                ended, run.over = True, f"its frames cannot be read: {text_of(error)}"
            if ended:
                run.over = run.over or _end_of(reader)
                self._found.clear()
            looked, run.looked = run.looked, asyncio.Event()
            looked.set()
            if not run.over:
                await asyncio.sleep(max(0.001, now + self._interval - time.monotonic()))
        self._say(f"{machine.station} has ended: {run.over}")

    # Faces ---------------------------------------------------------------------------------------------

    async def _serve(self, name: str, face: Face) -> None:
        """Serve one face over all runs, also after it has failed."""
        pause = FIRST_PAUSE
        while True:
            await self._found.wait()
            run = self._run
            assert run is not None
            try:
                await self._serve_run(name, face, run)
                pause = FIRST_PAUSE
            except Exception as error:
                log.debug("%s", name, exc_info=error)
                self._say(f"{name} has failed, and starts again in {pause:g} s: {text_of(error)}")
                await asyncio.sleep(pause)
                pause = min(2 * pause, MAX_PAUSE)

    async def _serve_run(self, name: str, face: Face, run: Run) -> None:
        async def looked() -> float:
            if not run.over:
                await run.looked.wait()
            await asyncio.sleep(0)  # the face is told first
            return inf if run.over else run.image.time

        is_reader = self._read_only or not face.takes_commands
        gateway = Gateway(run.reader, name, looked, is_reader=is_reader, roles=self._roles)
        event, why = run.reader.now().next_event, "the face has ended"  # those while it begins are told, too
        try:
            await face.begin(run.machine, gateway)
            await self._tell(face, run, event)
            why = run.over
        finally:
            try:
                async with asyncio.timeout(END_TIMEOUT):
                    await face.end(why)
            finally:
                await gateway.close()

    async def _tell(self, face: Face, run: Run, event: int) -> None:
        """Notify a face of new data until the run is over. `event`: the number of the first event to send."""
        changes = ChangeFilter(run.image, run.machine, self._dead_bands)
        over = ""
        while not over:
            over, waiting = run.over, run.looked  # before the look: the last one is told, too
            if (new := changes.take()) is not None:
                await face.frames(new)
                self.told += 1
            if events := run.reader.events(event):
                event = events[-1].number + 1
                await face.events(events)
            if not over:
                await waiting.wait()


def _end_of(reader: RunReader) -> str:
    with suppress(FramesError):
        if (event := reader.end) is not None:
            return event.text or "it has ended"
    return "its processes are gone"

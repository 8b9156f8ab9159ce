"""`umo face`: serve a running station in other protocols."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from umo.errors import FramesError, text_of
from umo.faces.face import Face
from umo.faces.face_settings import FaceSettings, faces_of, options_from, settings_of
from umo.faces.host import FaceHost
from umo.process.station import Station
from umo.remote.search import find_running
from umo.system.realtime import drop_realtime
from umo.wiring import source

from .console import out, say

NICENESS = 5
"""By how much its priority is below that of a usual program."""


@dataclass(frozen=True)
class FaceOptions:
    """What the command line gives; None: what the settings say."""

    names: Sequence[str]
    station: str | None = None
    commands: bool | None = None
    rate: float | None = None
    options: Sequence[str] = ()


def serve(chosen: FaceOptions) -> int:
    """Serve until Ctrl-C or SIGTERM, also while the station does not run."""
    given = settings_of(_table(chosen.station))
    settings = FaceSettings(
        given.rate if chosen.rate is None else chosen.rate,
        given.commands if chosen.commands is None else chosen.commands,
        given.dead_bands,
        given.options,
    )
    faces = faces_of(settings, chosen.names, options_from(chosen.options))
    host = FaceHost(
        chosen.station,
        faces,
        rate=settings.rate,
        read_only=not settings.commands,
        dead_bands=settings.dead_bands,
        say=say,
        opened=lambda: _tell(faces, settings),
    )
    drop_realtime()
    with suppress(OSError):
        os.nice(NICENESS)
    asyncio.run(_until_stopped(host))
    say("the faces have ended; stations that run go on")
    return 0


def _table(station: str | None) -> dict[str, object]:
    """The table `[faces]` of the wiring with which the station runs; empty where that cannot be read, which is said."""
    try:
        with find_running(station) as reader:
            place, wiring = Path(reader.about["place"]), str(reader.about.get("wiring", ""))
        file = Station(place.name, place).wiring(wiring or None)
        found = source.read({} if file is None else file)
        for mistake in found.mistakes:
            if mistake.key in ("", "faces"):
                say(f"no table [faces] is read from the wiring, only the options given here count: {mistake}")
        return found.faces
    except FramesError:  # the host says so
        say("no table [faces] is read from a wiring, as no station runs: only the options given here count")
    except Exception as error:  # its files have changed
        say(f"no table [faces] is read from the wiring, only the options given here count: {text_of(error)}")
    return {}


def _tell(faces: Sequence[tuple[str, Face]], settings: FaceSettings) -> None:
    """Where each face is reached, and what it may."""
    for name, face in faces:
        may = "reading and commands" if settings.commands and face.takes_commands else "reading only"
        out.print(f"{name}: {face.address}  ({may})", soft_wrap=True, highlight=False, markup=False)


async def _until_stopped(host: FaceHost) -> None:
    serving = asyncio.create_task(host.run())
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, serving.cancel)
    with suppress(asyncio.CancelledError):
        await serving

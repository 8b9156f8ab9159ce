"""`umo connect face`: serves a running station in other protocols. Run as a program, this module serves the faces of a
wiring for `umo run`. The table of the faces arrives on its standard input."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from umo.clients.faces.face import Face
from umo.clients.faces.face_settings import FaceSettings, faces_of, faces_settings, options_from
from umo.clients.faces.host import FaceHost
from umo.errors import FramesError, UmoError, text_of
from umo.exit_status import ExitStatus
from umo.process.frames.search import find_running
from umo.process.station import Station
from umo.system import calls
from umo.system.processes import name_process
from umo.system.realtime import drop_realtime
from umo.system.streams import keep_open, limit_waits
from umo.wiring import source
from umo_command.background import step_back, until_stopped
from umo_command.console import out, say
from umo_command.shared import import_from_here


@dataclass(frozen=True)
class FaceOptions:
    """The options of the command line. None means the value in the settings."""

    names: Sequence[str]
    station: str | None = None
    commands: bool | None = None
    rate: float | None = None
    options: Sequence[str] = ()


def serve(chosen: FaceOptions) -> int:
    """Serve until Ctrl-C or SIGTERM, even while the station does not run."""
    settings = faces_settings(*_table(chosen.station), {"rate": chosen.rate, "commands": chosen.commands})
    if any(":" in name for name in chosen.names):
        import_from_here()
    faces = faces_of(settings, chosen.names, options_from(chosen.options))
    step_back()
    _serve(chosen.station, settings, faces, say)
    say("the faces have ended; running stations continue")
    return 0


def serve_beside(parent: int, station: int, wiring: str, table: Mapping[str, Any]) -> int:
    """Serve the faces in the table of a wiring for one run (the pid of its control process), until SIGTERM or the end
    of `parent`. Notices are printed on stdout, one per line. Return 2 for an error, which is also printed on stdout."""
    calls.die_with_parent(parent, signal.SIGKILL)
    name_process("umo face")
    drop_realtime(niceness=0)
    try:
        settings = faces_settings(table, wiring)
        _serve(str(station), settings, faces_of(settings, [], {}), partial(print, flush=True))
    except UmoError as error:
        print(error, flush=True)
        return ExitStatus.MISTAKE
    return 0


def _serve(
    station: str | None, settings: FaceSettings, faces: Sequence[tuple[str, Face]], tell: Callable[[str], object]
) -> None:
    host = FaceHost(
        station,
        faces,
        rate=settings.rate,
        read_only=not settings.commands,
        dead_bands=settings.dead_bands,
        say=tell,
        opened=lambda: _tell(faces, settings),
    )
    asyncio.run(until_stopped(host.run()))


def _table(station: str | None) -> tuple[dict[str, Any], str]:
    """Return the table `[faces]` of the wiring with which the station runs, and the file of this wiring. If it cannot
    be read, print the reason, and return an empty table."""
    try:
        with find_running(station) as reader:
            place, wiring = Path(reader.about["place"]), str(reader.about.get("wiring", ""))
        file = Station(place.name, place).wiring(wiring or None)
        found = source.read({} if file is None else file)
        for mistake in found.mistakes:
            if mistake.key in ("", "faces"):
                say(
                    f"the table [faces] of the wiring cannot be read, so only the options given here are used: "
                    f"{mistake}"
                )
        return found.faces, "wiring" if file is None else str(file)
    except FramesError:  # the host of the faces reports it
        say("no station runs, so no table [faces] is read from a wiring, and only the options given here are used")
    except Exception as error:  # the files of the station have changed
        say(
            f"the table [faces] of the wiring cannot be read, so only the options given here are used: {text_of(error)}"
        )
    return {}, "wiring"


def _tell(faces: Sequence[tuple[str, Face]], settings: FaceSettings) -> None:
    """Print where each face is reached, and what it permits."""
    for name, face in faces:
        may = "reading and commands" if settings.commands and face.takes_commands else "reading only"
        out.print(f"{name}: {face.address}  ({may})", soft_wrap=True, highlight=False, markup=False)


if __name__ == "__main__":
    keep_open()
    limit_waits()
    sys.exit(serve_beside(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], json.load(sys.stdin)))

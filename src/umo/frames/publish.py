"""Publishing the frames of a connected machine."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from umo.cycle import connect
from umo.cycle.phases import Phases
from umo.frames import folder
from umo.frames.layout import Layout, describe_objects
from umo.frames.ring import Ring, State


@contextmanager
def published(
    connection: connect[Any], station: str, wiring: str = "", path: Path | None = None, *, place: Path | None = None
) -> Iterator[Ring]:
    """Publish every period of a connected machine while the block lasts.

        connection = umo.connect(machine, wiring)
        with connection as m, umo.published(connection, "press"):
            ...

    `umo ps` and `umo watch press` then find it. `path` is the ring's file, by itself a new one in the user's
    folder; `place` the station's. FramesError where there is no room.
    """
    phases = Phases(connection.image, connection.wired.drivers)
    layout = Layout(
        describe_objects(connection.image.items),
        tuple(phases.names),
        {
            "station": station,
            "wiring": wiring,
            "place": "" if place is None else str(place),
            "devices": connection.wired.devices,
            "pid": os.getpid(),
            "started": time.time(),
            "started_monotonic": time.monotonic_ns(),
            "period": connection.wired.period or 0.0,
        },
    )
    ring = Ring(connection.image, phases, layout, path or new_path(station))
    ring.watch(connection.root)
    ring.state(State.RUNNING)
    connection.machine.observers.append(ring)
    try:
        yield ring
    finally:
        if ring in connection.machine.observers:
            connection.machine.observers.remove(ring)
        ring.close()


def new_path(station: str) -> Path:
    """A file for a new ring, in the user's folder."""
    name = re.sub(r"[^\w-]", "_", station)
    return folder.folder() / f"{name}-{os.getpid()}-{time.monotonic_ns():x}{folder.SUFFIX}"

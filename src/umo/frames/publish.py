"""Publishing the frames of a connected machine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from umo.cycle import connect
from umo.cycle.phases import Phases
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.frames.folder import new_path
from umo.frames.layout import Layout, describe_objects
from umo.frames.ring import Ring


@contextmanager
def published(connection: connect[Any], station: str, wiring: str = "", path: Path | None = None) -> Iterator[Ring]:
    """Publish every period of a connected machine while the block lasts.

        connection = umo.connect(machine, wiring)
        with connection as m, umo.published(connection, "press"):
            ...

    `umo ps` and `umo watch press` then find it, in a new file in the user's folder. Who chooses `path` instead finds
    the last frames in it when the block has ended, and removes it. FramesError where there is no room, and where this
    connection is being published already.
    """
    if connection.image.journal is not None:
        raise FramesError(f"{station} is being published already; a connection has one ring of frames at a time")
    about = {
        "station": station,
        "wiring": wiring,
        "pid": os.getpid(),
        "started": time.time(),
        "started_monotonic": time.monotonic_ns(),
        "period": connection.wired.period or 0.0,
    }
    observers = connection.machine.observers
    with _timed(connection) as phases:
        layout = Layout(describe_objects(connection.image.items), tuple(phases.names), about)
        ring = Ring(connection.image, phases, layout, path or new_path(station))
        try:
            ring.watch(connection.root)
            ring.state(Stage.RUNNING)
            observers.append(ring)
            yield ring
        finally:
            if ring in observers:
                observers.remove(ring)
            ring.close()
            if path is None:
                with suppress(OSError):  # then whoever looks next removes it
                    ring.path.unlink(missing_ok=True)


@contextmanager
def _timed(connection: connect[Any]) -> Iterator[Phases]:
    """What each phase takes, while the block lasts: then the drivers stand bare again."""
    image = connection.image
    blocks = [(block, block.driver) for block in (*image.inputs, *image.outputs)]
    wires = list(image.wires)
    try:
        yield Phases(image, connection.wired.drivers)
    finally:
        for block, driver in blocks:
            block.driver = driver
        image.wires[:] = wires

"""Publishing the frames of a connected machine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from umo.cycle import connect
from umo.cycle.phases import Phases
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.frames.folder import new_path
from umo.frames.layout import Layout, describe_objects, describe_signals
from umo.frames.ring import Ring
from umo.objects import actions_of, tunables_of


@contextmanager
def published(
    connection: connect[Any],
    station: str,
    wiring: str = "",
    path: Path | None = None,
    *,
    place: Path | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[Ring]:
    """Publish every period of a connected machine while the block lasts.

        connection = umo.connect(machine, wiring)
        with connection as m, umo.published(connection, "press"):
            ...

    `umo ps` and `umo watch press` then find it. Default: a new file in the user's folder, removed at the end. A file
    given as `path` keeps the last frames after the block; the caller removes it. `place` is the station's folder,
    `options` those with which its machine was made.
    FramesError if there is not enough memory, or if this connection is already published.
    """
    if connection.image.transfer.journal is not None:
        raise FramesError(f"{station} is already published; a connection can publish only one ring of frames")
    about = {
        "station": station,
        "wiring": wiring,
        "place": "" if place is None else str(place),
        "options": dict(options),
        "devices": connection.wired.devices,
        "pid": os.getpid(),
        "started": time.time(),
        "started_monotonic": time.monotonic_ns(),
        "period": connection.wired.period or 0.0,
    }
    if connection.wired.injection is not None:
        about["injected_faults"] = list(connection.wired.injection.texts)
    observers = connection.machine.observers
    phases = Phases(connection.image, connection.wired.drivers)
    try:
        machine = connection.machine
        tunables = list(tunables_of(machine.root).values())
        layout = Layout(
            describe_objects(machine.image.items),
            tuple(phases.names),
            about,
            describe_signals(machine.frame.signals),
            tuple(machine.commands.reasons),
            tuple(each.describe() for each in actions_of(machine.root).values()),
            tuple(each.describe() for each in tunables),
        )
        ring = Ring(machine, phases, layout, path or new_path(station), tunables=tunables)
        try:
            ring.state(Stage.RUNNING)
            observers.append(ring)
            yield ring
        finally:
            connection.machine.finish_period()  # a period that raised is one of the frames
            if ring in observers:
                observers.remove(ring)
            ring.close()
            if path is None:
                with suppress(OSError):  # then whoever looks next removes it
                    ring.path.unlink(missing_ok=True)
    finally:
        phases.remove()

"""Publishing the frames of a connected machine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from umo.cycle import connect
from umo.cycle.machine import ConnectedMachine
from umo.cycle.phases import Phases
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.frames.ending import tell_end
from umo.frames.folder import new_path
from umo.frames.layout import Layout, describe_objects, describe_signals
from umo.frames.ring import Ring


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
    machine = connection.machine
    about = {"station": station, "wiring": wiring, "place": "" if place is None else str(place)}
    phases = Phases(machine.image, connection.wired.drivers)
    try:
        layout = _layout(machine, phases, about | {"options": dict(options)} | _about(connection))
        ring = Ring(machine, phases, layout, path or new_path(station), tunables=list(machine.tunables.values()))
        error: BaseException | None = None
        try:
            ring.state(Stage.RUNNING)
            machine.observers.append(ring)
            yield ring
        except BaseException as caught:
            error = caught
            raise
        finally:
            end = partial(_end, connection, ring, path is None, error)
            if machine.period_open or error is not None:  # it is shown when the actuators have been reset
                connection.afterwards.append(end)
            else:
                end()
    finally:
        phases.remove()


def _about(connection: connect[Any]) -> dict[str, Any]:
    """What the frames tell of this run."""
    wired = connection.wired
    about = {
        "devices": wired.devices,
        "pid": os.getpid(),
        "started": time.time(),
        "started_monotonic": time.monotonic_ns(),
        "period": wired.period or 0.0,
        "realtime": wired.realtime,
    }
    return about if wired.injection is None else about | {"injected_faults": list(wired.injection.texts)}


def _layout(machine: ConnectedMachine, phases: Phases, about: dict[str, Any]) -> Layout:
    return Layout(
        describe_objects(machine.image.items),
        tuple(phases.names),
        about,
        describe_signals(machine.frame.signals),
        tuple(machine.commands.reasons),
        tuple(each.describe() for each in machine.actions.values()),
        tuple(each.describe() for each in machine.tunables.values()),
    )


def _end(connection: connect[Any], ring: Ring, remove: bool, error: BaseException | None) -> None:
    machine = connection.machine
    tell_end(connection, error)
    if ring in machine.observers:
        machine.observers.remove(ring)
    ring.close()
    if remove:
        with suppress(OSError):  # then whoever looks next removes it
            ring.path.unlink(missing_ok=True)

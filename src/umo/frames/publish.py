"""Publishing the frames of a connected machine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from umo.cycle import connect
from umo.cycle.machine import ConnectedMachine
from umo.cycle.phases import Phases
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.frames.folder import new_path
from umo.frames.frame_server import FrameServer
from umo.frames.last_event import tell_end
from umo.frames.layout import Layout, describe_objects, describe_signals
from umo.frames.memory import RunDescriptors
from umo.frames.ring import Ring


@contextmanager
def published(
    connection: connect[Any],
    station: str,
    wiring: str = "",
    *,
    place: Path | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
    ends: RunDescriptors | None = None,
) -> Iterator[Ring]:
    """Publish every period of a connected machine while the block lasts.

        connection = umo.connect(machine, wiring)
        with connection as m, umo.published(connection, "press"):
            ...

    `umo ps` and `umo watch press` then find it: a thread of this process answers them. `place` is the station's folder,
    `options` those with which its machine was made. With `ends`, the writer's descriptors of empty memory, this process
    only writes: who has given them answers those who look for the station.
    FramesError if there is not enough memory, or if this connection is already published.
    """
    if connection.image.transfer.journal is not None:
        raise FramesError(f"{station} is already published; a connection can publish only one ring of frames")
    machine = connection.machine
    about = {"station": station, "wiring": wiring, "place": "" if place is None else str(place)}
    with ExitStack() as undo:  # if it cannot be published
        memory = undo.enter_context(ExitStack())
        server = None
        if ends is None:
            ends, server = _own_memory(station, memory)
        phases = Phases(machine.image, connection.wired.drivers)
        undo.callback(phases.remove)
        layout = _layout(machine, phases, about | {"options": dict(options)} | _about(connection))
        ring = Ring(machine, phases, layout, ends, tunables=list(machine.tunables.values()))
        undo.callback(ring.close)
        if server is not None:
            server.listen()
            server.start()
            ring.path = server.path
        undo.pop_all()
    error: BaseException | None = None
    try:
        ring.state(Stage.RUNNING)
        machine.observers.append(ring)
        yield ring
    except BaseException as caught:
        error = caught
        raise
    finally:
        end = partial(_end, connection, ring, memory, error)
        if machine.period_open or error is not None:  # it is shown when the actuators have been reset
            connection.afterwards.append(end)
        else:
            end()
        phases.remove()


def _own_memory(station: str, memory: ExitStack) -> tuple[RunDescriptors, FrameServer]:
    """New memory: the writer's descriptors, and a server of the readers'. `memory` closes them."""
    ends, readers = RunDescriptors.pair()
    memory.callback(ends.close)
    memory.callback(readers.close)
    server = FrameServer(new_path(station), readers)
    memory.callback(server.close)
    return ends, server


def _about(connection: connect[Any]) -> dict[str, Any]:
    """The facts about this run that stand in its frames."""
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


def _end(connection: connect[Any], ring: Ring, memory: ExitStack, error: BaseException | None) -> None:
    machine = connection.machine
    with memory:
        tell_end(connection, error)
        if ring in machine.observers:
            machine.observers.remove(ring)
        ring.close()

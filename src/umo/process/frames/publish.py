"""Functions that publish the frames of a connected machine and the last event of its run, with the reason of its
end."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from math import isfinite
from pathlib import Path
from types import MappingProxyType, WrapperDescriptorType
from typing import Any
from weakref import WeakKeyDictionary

from umo.cycle.connect import connect
from umo.cycle.events import END, CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.phase_times import PhaseTimes
from umo.cycle.showing import frame_of
from umo.cycle.stage import Stage
from umo.drivers.contract import Direction
from umo.drivers.optional import Inspects
from umo.errors import FramesError, text_of
from umo.objects import Atomic, MachineNumber
from umo.objects.description import described
from umo.operation.alarms.alarming import ALARMS, engine_of
from umo.process.frames.frame_server import FrameServer, new_path
from umo.process.frames.layout import Layout, describe_signals
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring import Ring
from umo.system.processes import HASH_SEED
from umo.system.signal_handling import signal_name
from umo.text import in_brackets, place_of
from umo.user_code import attempt
from umo.wiring.wired import Wire

PLAIN_TYPES = (str, int, float, bool, type(None))
"""Types of arguments of exceptions whose text can be made without calling the user's code."""


@contextmanager
def published(
    connection: connect[Any],
    station: str,
    wiring: str = "",
    *,
    place: Path | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
    job: Mapping[str, Any] = MappingProxyType({}),
    ends: RunDescriptors | None = None,
) -> Iterator[Ring]:
    """Publish every period of a connected machine while the block lasts.

        connection = umo.connect(machine, wiring)
        with connection as m, umo.published(connection, "press"):
            ...

    `umo show stations` and `umo show values press` then find the machine: a thread of this process answers them.
    `place` is the station's folder, `options` are the options with which the machine was made, `job` is the plain data
    with which the run can be repeated. With `ends`, the writer's descriptors of empty memory, this process only writes,
    and the process that made them answers clients that look for the station. Raises FramesError if there is not enough
    memory, or if this connection is already published.
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
        phases = PhaseTimes(machine.image, connection.wired.drivers, machine.groups.parts)
        undo.callback(phases.remove)
        alarms = engine_of(machine)
        layout = Layout(
            tuple(map(_object, machine.image.items, machine.image.wires)),
            tuple(phases.names),
            about | {"options": dict(options)} | _about(connection) | ({"job": dict(job)} if job else {}),
            describe_signals(frame_of(machine).signals, machine.directory.kept),
            tuple(machine.claims.reasons),
            tuple(each.describe() for each in machine.directory.actions.values()),
            tuple(each.describe() | {"start": _start(each)} for each in machine.directory.tunables.values()),
            tuple(each.describe() for each in machine.equipment.all),
            axes=tuple(dict(each.describe_axis()) for each in machine.directory.axes),
            alarms=() if alarms is None else tuple(each.describe() for each in alarms.declared),
            units=tuple(dict(each.describe()) for each in machine.directory.units),
            books=tuple({"path": path, **each.describe()} for path, each in machine.directory.books.items()),
        )
        ring = Ring(machine, phases, layout, ends, tunables=list(machine.directory.tunables.values()))
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
        if machine.phases.open or error is not None:  # it is shown when the actuators have been reset
            connection.afterwards.append(end)
        else:
            end()
        phases.remove()


def _object(item: Atomic, wire: Wire) -> dict[str, Any]:
    """Return the description of an object. `inspected` is in it if the driver of a number can show the content of its
    circuit. The driver does this only on request, never in a period."""
    is_number = item.direction is Direction.INPUT and not item._has_states
    tells = is_number and isinstance(wire.driver, Inspects)
    return {**described(item).plain, **({"inspected": True} if tells else {})}


def _start(number: MachineNumber) -> float | None:
    """Return the value of a tunable number at the start; a later value that differs was tuned. None if the number has
    no value."""
    value = number.read()
    return value if isfinite(value) else None


def _own_memory(station: str, memory: ExitStack) -> tuple[RunDescriptors, FrameServer]:
    """Make new memory. Return the writer's descriptors, and a server that gives the readers' descriptors. `memory`
    closes both."""
    ends, readers = RunDescriptors.pair()
    memory.callback(ends.close)
    memory.callback(readers.close)
    server = FrameServer(new_path(station), readers)
    memory.callback(server.close)
    _pipes[server] = ends.alive
    _watch_forks()
    return ends, server


_pipes: WeakKeyDictionary[FrameServer, int] = WeakKeyDictionary()
"""The writing end of the pipe of each run that this process has published."""


@cache
def _watch_forks() -> None:
    os.register_at_fork(after_in_child=_leave)


def _leave() -> None:
    """Release the pipes and sockets of runs in a process that the program has forked. That process does not write the
    frames, and must not hide the end of the run from readers. The descriptor of a pipe stays open, because it is closed
    with the memory. A process that this process forks does not release them again: the descriptor may belong to another
    file."""
    pipes = dict(_pipes)
    _pipes.clear()
    for server, pipe in pipes.items():
        if not server.is_closed:
            nothing = os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)
            os.dup2(nothing, pipe, inheritable=False)
            os.close(nothing)
            server.leave()


def _about(connection: connect[Any]) -> dict[str, Any]:
    """Return the facts about this run that its frames contain."""
    wired = connection.wired
    about: dict[str, Any] = {
        "devices": wired.devices,
        "pid": os.getpid(),
        "started": time.time(),
        "started_monotonic": time.monotonic_ns(),
        "period": wired.period or 0.0,
        "realtime": wired.realtime,
        "initial": {
            "raws": connection.image.columns.raws.tolist(),
            "entries": connection.first_entries.hex(),
            "kept": dict(connection.kept),
            "alarms": dict(connection.states.get(ALARMS, {})),
            "seed": connection.seed,
            "hash_seed": os.environ.get(HASH_SEED, "random"),
        },
    }
    if wired.rates:
        about["rates"] = [{"path": each.part._path, "every": each.every, "phase": each.phase} for each in wired.rates]
    return about if wired.injection is None else about | {"injected_faults": list(wired.injection.texts)}


def _end(connection: connect[Any], ring: Ring, memory: ExitStack, error: BaseException | None) -> None:
    machine = connection.machine
    with memory:
        tell_end(connection, error)
        if ring in machine.observers:
            machine.observers.remove(ring)
        ring.close()


def tell_end(connection: connect[Any], error: BaseException | None) -> None:
    """Add the last event, unless the run has one already. `error`: the error that ended the run, if it failed."""
    machine = connection.machine
    if machine.events and machine.events[-1].is_end:
        return
    if error is not None:
        text, failed = attempt(_text, error)
        tell(machine, CommandState.FAILED, text if failed is None else type(error).__name__)
    elif connection.stop.requested:
        tell(machine, CommandState.CANCELLED, f"stopped by {_stopper(connection)}")
    else:
        tell(machine, CommandState.DONE, "the application has ended")


def tell(machine: ConnectedMachine, state: CommandState, text: str) -> None:
    machine.events.add(Event(machine.clock.now, "", text, state=state, asked=END))


def _stopper(connection: connect[Any]) -> str:
    """Return the name of the client, the signal, or the time limit that has requested the stop, or else "the
    program"."""
    stops = (event for event in reversed(connection.machine.events) if event.asked == "stop")
    who = next((event.who for event in stops if event.state is CommandState.DONE), "")
    signal = connection.stop.signal
    program = "its time limit" if connection.stop.time_over else "the program"
    return who or (program if signal is None else signal_name(signal))


def _text(error: BaseException) -> str:
    """Return the text of an exception. If this would call code of the user, return only its class and place, because
    the outcome is not reported yet."""
    written, plain = type(error).__str__, all(type(arg) in PLAIN_TYPES for arg in error.args)
    if not plain or not (isinstance(written, WrapperDescriptorType) or written.__module__.startswith("umo.")):
        return type(error).__name__ + in_brackets(place_of(error))
    return text_of(error)

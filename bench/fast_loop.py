"""A machine at a high rate in a process of its own, prepared as a control process is: slice by slice of its times."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from timeit import repeat
from typing import Any

from umo.cycle import connect
from umo.cycle.cache_warming import wait_busily
from umo.drivers.simulated import Simulated
from umo.latency.loop import ONE_THREAD, slice_of
from umo.latency.native import Slice
from umo.objects import Compound, DigitalSensor, atoms
from umo.system import realtime
from umo.wiring import resolve
from umo.wiring.wired import Wired

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the helpers import one another from there
LOOKS = 1_000
"""Calls that are measured together."""
START = "import sys; from bench.fast_loop import serve; serve(*sys.argv[1:])"


def machine_of(name: str) -> Compound:
    if name == "converter":
        from helpers.converter import converter

        return converter()
    from umo.process.station import find

    return find(name).machine()


class FastLoop:
    """The process. `priority` and `cpu` are what it was granted; `state` is that of its compiled laws."""

    def __init__(self, name: str, period: float, compiled: bool) -> None:
        self._here, there = Pipe()
        with there:
            words = [there.fileno(), name, period, int(compiled)]
            self._process = subprocess.Popen(
                [sys.executable, "-c", START, *map(str, words)],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | ONE_THREAD,
            )
        self.priority, self.cpu = self._here.recv()

    def run(self, periods: int, busy_wait: float) -> Slice:
        self._here.send((periods, busy_wait))
        return Slice.of(self._here.recv_bytes())

    def close(self) -> tuple[str, float]:
        """The state of the compiled laws, and what a look at what they take as known takes, to a period."""
        self._here.send(None)
        state, share = self._here.recv()
        self._here.close()
        self._process.wait()
        return str(state), float(share)


def _set_in_range(wired: Wired) -> None:
    """Each sensor reads the middle of its range."""
    for wire in wired.wires:
        if isinstance(wire.item, DigitalSensor) and isinstance(wire.driver, Simulated):
            wire.driver.set(wire.channel.text, wire.raw((wire.item.minimum + wire.item.maximum) / 2))


def _share_of_look(machine: Any, laws: Any) -> float:
    """The time of a look at what compiled laws take as known, to that of a period without its timer."""

    def period() -> None:
        machine.sample()
        machine.control()
        machine.update()

    takes = [min(repeat(call, number=LOOKS, repeat=9)) for call in (laws._watch.look, period)]
    return takes[0] / takes[1]


def serve(file: str, name: str, period: str, compiled: str) -> None:
    """The process: slices as they are asked for, until it is told to end."""
    from umo.generate.compiled_laws import CompiledLaws, prepare

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    realtime.die_with_parent(os.getppid(), signal.SIGKILL)
    there = Connection(int(file))
    machine: Any = machine_of(name)
    wire: dict[str, Any] = {item.path: {"driver": "simulated"} for item in atoms(machine)}
    wire["timer"] = {"driver": "timerfd", "period": float(period)}
    wired = resolve(machine, {"wire": wire})
    _set_in_range(wired)
    prepared = prepare(machine, wired) if int(compiled) else None
    connection = connect(machine, wired)
    with suppress(EOFError, ConnectionError), connection as m:
        laws = None if prepared is None else CompiledLaws(prepared, connection.machine)
        ticker = connection.wired.drivers["timerfd"].ticker  # type: ignore[attr-defined]
        realtime.prepare(80, None)
        there.send(realtime.granted())
        while (asked := there.recv()) is not None:
            periods, busy_wait = asked
            wait_busily(connection.wired, busy_wait)
            there.send_bytes(slice_of(m, ticker, periods).tobytes())
        there.send(("python", 0.0) if laws is None else (laws.state, _share_of_look(m, laws)))
    os._exit(0)  # nothing of a process without garbage collection is to be told

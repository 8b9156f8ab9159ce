"""A machine at a high rate in a process of its own, prepared as a control process is: slice by slice of its times."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from statistics import median
from time import monotonic_ns, perf_counter_ns, thread_time_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.commissioning.latency.loop import ONE_THREAD, slice_of
from umo.commissioning.latency.native import Slice
from umo.cycle.cache_warming import wait_busily
from umo.cycle.connect import connect
from umo.drivers.simulated import Simulated
from umo.objects import Compound, DigitalSensor, atoms
from umo.system import calls, realtime
from umo.wiring import resolve
from umo.wiring.wired import Wired

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the helpers import one another from there
PERIODS, TURNS = 500, 41
"""Periods that are measured together, and how often with and without a look at what is taken as known."""
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
        """The state of the compiled laws, and a period with the looks at what they take as known, to one without."""
        self._here.send(None)
        state, ratio = self._here.recv()
        self._here.close()
        self._process.wait()
        return str(state), float(ratio)


def _set_in_range(wired: Wired) -> None:
    """Each sensor reads the middle of its range."""
    for wire in wired.wires:
        if isinstance(wire.item, DigitalSensor) and isinstance(wire.driver, Simulated):
            wire.driver.set(wire.channel.text, wire.raw((wire.item.minimum + wire.item.maximum) / 2))


def _with_looks(machine: Any, laws: Any) -> float:
    """A period with the looks at what compiled laws take as known, to one without them, in turns; without the timer."""

    def takes(look: Any) -> int:
        laws._machine.phases.before_laws = [] if look is None else [look]
        for each in laws._conditions._native[:1]:
            each.guard(look)
        begin = perf_counter_ns()
        for _ in range(PERIODS):
            machine.sample()
            machine.control()
            machine.update()
        return perf_counter_ns() - begin

    look = laws._watch.look
    return median(takes(look) / takes(None) for _ in range(TURNS))


def slice_in_c(period: Any, ticker: Any, periods: int) -> npt.NDArray[np.int64]:
    """As `slice_of`, of a machine whose period is carried out in C."""
    rows = np.full((periods, 3), -1, np.int64)  # touched before the loop
    for _ in range(2):  # the ticks between the slices
        period.run(1, None)
    began = thread_time_ns(), monotonic_ns()
    count = place = 0
    while place < periods:
        first = count
        count += period.run(periods - count, rows[first:])
        place += int(np.maximum(rows[first:count, 0], 1).sum())
    took = thread_time_ns() - began[0], monotonic_ns() - began[1]
    missed, begun, ended = rows[:count].T
    places = np.cumsum(np.maximum(missed, 1)) - 1
    due = ticker.due - (places[-1] - places) * round(ticker.period * 1e9)
    times = np.full((periods + 1, 2), -1, np.int64)
    in_time = (missed == 0) & (places < periods)
    times[places[in_time]] = np.stack([begun - due, ended - begun], 1)[in_time]
    times[periods] = took
    return times


def _state(laws: Any, period: Any) -> str:
    left = ", ".join(f"{phase} by Python: {why}" for phase, why in period.reasons.items())
    return f"{laws.state}, {left or 'the period in C'}"


def serve(file: str, name: str, period: str, compiled: str) -> None:
    """The process: slices as they are asked for, until it is told to end."""
    from umo.generate.compiled_laws import CompiledLaws, prepare
    from umo.generate.period_in_c import PeriodInC

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    calls.die_with_parent(os.getppid(), signal.SIGKILL)
    there = Connection(int(file))
    machine: Any = machine_of(name)
    wire: dict[str, Any] = {item.path: {"driver": "circuit"} for item in atoms(machine)}
    wire["timer"] = {"driver": "timerfd", "period": float(period)}
    wired = resolve(machine, {"drivers": {"circuit": {"type": "simulated", "history": 0}}, "wire": wire})
    _set_in_range(wired)
    prepared = prepare(machine, wired) if int(compiled) else None
    connection = connect(machine, wired)
    with suppress(EOFError, ConnectionError), connection as m:
        laws = None if prepared is None else connection.machine.attach(CompiledLaws(prepared))
        in_c = None if prepared is None else connection.machine.attach(PeriodInC())
        ticker = connection.wired.drivers["timerfd"].ticker  # type: ignore[attr-defined]
        realtime.prepare(80, None)
        there.send(realtime.granted())
        while (asked := there.recv()) is not None:
            periods, busy_wait = asked
            ticker.close()
            ticker.start()  # the ticks since the last slice are nobody's
            wait_busily(connection.wired, busy_wait)
            found = slice_of(m, ticker, periods) if in_c is None else slice_in_c(in_c, ticker, periods)
            there.send_bytes(found.tobytes())
        there.send(("python", 1.0) if laws is None or in_c is None else (_state(laws, in_c), _with_looks(m, laws)))
    os._exit(0)  # nothing of a process without garbage collection is to be told

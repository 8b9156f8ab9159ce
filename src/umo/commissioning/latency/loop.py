"""The loop of umo in a process that is prepared like a control process. It runs one slice at a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from time import monotonic_ns, thread_time_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.commissioning.latency import native
from umo.commissioning.latency.native import Slice
from umo.cycle.cache_warming import wait_busily
from umo.cycle.connect import connect
from umo.drivers.timerfd import Ticker
from umo.errors import DriverError
from umo.objects import BinaryActuator, Compound, DigitalActuator, DigitalSensor, atoms
from umo.states import OnOff
from umo.system import calls, realtime

START_TIMEOUT = 60.0
"""Timeout in s for the start of the process, which imports umo."""
END_TIMEOUT = 5.0
"""The timeout in s for the end of the process."""


class Example(Compound):
    """A machine of 13 objects, as many as the z-theta manipulator has."""

    timer: DigitalSensor
    sensors: list[DigitalSensor]
    motors: list[DigitalActuator]
    valves: list[BinaryActuator[OnOff]]

    def control(self) -> None:
        for sensor, motor in zip(self.sensors, self.motors, strict=True):
            motor.write(0.1 * sensor.read())
        for valve in self.valves:
            valve.write(OnOff.ON)


def example() -> Example:
    return Example(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        sensors=[DigitalSensor("um", minimum=-1e6, maximum=1e6, resolution=0.5) for _ in range(4)],
        motors=[DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01) for _ in range(4)],
        valves=[BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(4)],
    )


ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""The environment of a control process, in which numpy starts no threads."""
START = "import sys; from umo.commissioning.latency.loop import serve; serve(*sys.argv[1:])"


class Loop:
    """A separate process with the loop. `run` returns the times of one slice.

    The process is a new Python, not a fork, because the present process has other threads, at least those of numpy.
    """

    def __init__(self, period: float, priority: int = 80) -> None:
        self._period = period
        self._here, there = Pipe()
        with there:
            words = [there.fileno(), period, priority]
            self._process = subprocess.Popen(
                [sys.executable, "-c", START, *map(str, words)],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C ends the measurement, which ends the loop
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | ONE_THREAD,
            )
        self.refusals: list[realtime.Refusal]
        self.priority: int
        """The granted priority; 0 for none."""
        self.cpu: int | None
        try:
            self._await(START_TIMEOUT)
            self.refusals, self.priority, self.cpu = self._here.recv()
        except EOFError:
            self.close()
            raise DriverError(
                "the measuring process ended before it started measuring; see the message above"
            ) from None

    @property
    def granted(self) -> bool:
        """True if SCHED_FIFO and a reserved core were granted."""
        return self.priority > 0 and self.cpu is not None

    def run(self, periods: int, busy_wait: float = 0.0) -> Slice:
        """Measure one slice, like `native.run`."""
        self._here.send((periods, busy_wait))
        self._await(native.time_limit(self._period, periods))
        return Slice.of(self._here.recv_bytes())

    def _await(self, limit: float) -> None:
        """Wait for the next answer. Raises DriverError after `limit` s, because the process may have been stopped."""
        if not self._here.poll(limit):
            self._process.kill()
            raise DriverError(f"the measuring process has not answered for {limit:g} s; it may have been stopped")

    def close(self) -> None:
        self._here.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)


def serve(file: str, period: str, priority: str) -> None:
    """Measure slices on request until the other end is closed. This is the function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    calls.die_with_parent(os.getppid(), signal.SIGKILL)
    there = Connection(int(file))
    machine = example()
    wire: dict[str, Any] = {item.path: {"driver": "simulated"} for item in atoms(machine)}
    wire["timer"] = {"driver": "timerfd", "period": float(period)}
    connection = connect(machine, {"wire": wire})
    with suppress(EOFError, ConnectionError), connection as m:
        ticker = connection.wired.drivers["timerfd"].ticker  # type: ignore[attr-defined]
        there.send((realtime.prepare(int(priority), None), *realtime.granted()))
        while True:
            periods, busy_wait = there.recv()
            wait_busily(connection.wired, busy_wait)
            there.send_bytes(slice_of(m, ticker, periods).tobytes())


def slice_of(m: Example, ticker: Ticker, periods: int, end: Callable[[], int] = monotonic_ns) -> npt.NDArray[np.int64]:
    """Run a number of periods, and return the rows for `Slice.of`. `end` returns the time at which the work of a period
    had ended."""
    times = np.full((periods + 1, 2), -1, np.int64)
    m.timer.read()  # the ticks between the slices
    m.timer.read()
    began = thread_time_ns(), monotonic_ns()
    i = 0
    while i < periods:
        missed = int(m.timer.read())
        i += max(missed - 1, 0)
        if i >= periods:
            break
        m.sample()
        m.control()
        m.update()
        times[i] = -1 if missed else ticker.woke - ticker.due, end() - ticker.woke
        i += 1
    times[periods] = thread_time_ns() - began[0], monotonic_ns() - began[1]
    return times

"""The z-theta loop in real time in its own process, with company, beside a bare C loop in turns."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import umo
from bench import at_tick
from umo.commissioning.latency import Samples, native
from umo.commissioning.latency.loop import Loop, example, slice_of
from umo.commissioning.latency.measure import BUSY_PROGRAM
from umo.drivers.simulated import Simulated
from umo.process.frames import Reader
from umo.system.realtime import busy_wait_for

PERIOD = 0.001
NAIVE_PERIODS = 5000
ENOUGH = 0.02
"""s between two looks of a reader."""
READER = f"""
import time
from umo.process.frames import Reader, rings
reader = Reader(rings()[-1])
while True:
    reader.read()
    time.sleep({ENOUGH})
"""


@dataclass
class Loops:
    """z-theta as `umo run` runs it, and with a process that sleeps until the tick; the C loop, which sleeps, and one
    that waits busily as long as umo's. None without a compiler."""

    umo: Samples
    asleep: Samples
    c: Samples | None
    c_busy: Samples | None


def measure(periods: int) -> Loops:
    """z-theta at 1 ms for at least so many periods, with `umo show values`, three more readers and a busy process
    beside it; after each run of one part the C loops, as long each, with the same company, as far as it goes on when
    the station has ended, and then the loop that sleeps."""
    found = Loops(Samples(), Samples(), None, None)
    with native.compiled() as program, _busy():
        if program is not None:
            found.c, found.c_busy = Samples(), Samples()
        while (count := _count(found.umo)) < periods:
            with _station(found.umo, "auto"):
                if program is not None and found.c is not None and found.c_busy is not None:
                    as_long, loop = _count(found.umo) - count, _granted()
                    busy_wait = busy_wait_for(PERIOD) if loop.granted else 0.0
                    found.c.add(native.run(program, PERIOD, as_long, loop.priority, loop.cpu))
                    found.c_busy.add(native.run(program, PERIOD, as_long, loop.priority, loop.cpu, busy_wait))
            with _station(found.asleep, 0, most=5000):
                pass
    return found


def _count(samples: Samples) -> int:
    return len(samples.wake) + samples.missed


@contextmanager
def _station(
    found: Samples, busy_wait: str | int, most: int = 10**9, compiled: bool = False, after: int = 0
) -> Iterator[None]:
    """One part, from homing to placing, or so many periods; then the block, in which its readers are still there. The
    first `after` periods are left out."""
    wiring = tomllib.loads(_wiring().read_text("utf-8")) | {"process": {"busy_wait": busy_wait, "compile": compiled}}
    with umo.start("ztheta", wiring, parts=1, realtime=True, acknowledge=True) as started:
        while started.frames is None and started.outcome is None:
            started.poll(0.1)
        if started.frames is None:
            raise RuntimeError(f"the station did not start: {started.outcome}")
        company, begun = [*_readers(str(started.pid))], _count(found)
        left_out = Samples()
        while started.outcome is None and _count(left_out) < after:
            started.poll(ENOUGH)
            take(started.frames, left_out)
        first = last = _processor(started.pid) or (0, 0)
        try:
            while started.outcome is None and _count(found) - begun < most:
                started.poll(ENOUGH)
                take(started.frames, found)
                last = _processor(started.pid) or last
            take(started.frames, found)
            found.processor += last[0] - first[0]
            found.elapsed += last[1] - first[1]
            yield
        finally:
            for process in company:
                process.kill()
                process.communicate()


def take(reader: Reader, found: Samples) -> None:
    """The frames that are new."""
    frames = reader.read()
    times = np.stack([frames["wake"], frames["execution"]], 1)
    times[frames["missed"] > 0] = -1
    found.add(native.Slice(times, 0, 0))
    found.missed += int(np.maximum(frames["missed"] - 1, 0).sum())


def _processor(pid: int | None) -> tuple[int, int] | None:
    """Processor time of a process so far and the time now, ns; None if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]), time.monotonic_ns()
    except (OSError, IndexError):
        return None


def _readers(pid: str) -> Iterator[subprocess.Popen[bytes]]:
    """`umo show values` on a terminal of its own (script), and three that read every frame."""
    watch = f"{Path(sys.executable).with_name('umo')} watch {pid}"
    yield subprocess.Popen(["script", "-qec", watch, "/dev/null"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    for _ in range(3):
        yield subprocess.Popen([sys.executable, "-c", READER], stderr=subprocess.DEVNULL)


@contextmanager
def _busy() -> Iterator[None]:
    process = subprocess.Popen([sys.executable, "-c", BUSY_PROGRAM])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _granted() -> Loop:
    """A loop that has ended: it knows the priority and the core that the control process gets here."""
    loop = Loop(PERIOD)
    loop.close()
    return loop


def naive() -> Samples:
    """13 objects in one process with one busy Python thread beside the loop, for comparison."""
    found, stop = Samples(), threading.Event()

    def spin() -> None:
        while not stop.is_set():
            pass

    plant = example()
    connection = umo.connect(plant, at_tick.wiring(plant, Simulated()))
    threading.Thread(target=spin, daemon=True).start()
    try:
        with connection as m:
            ticker = connection.wired.drivers["timerfd"].ticker  # type: ignore[attr-defined]
            found.add(native.Slice.of(slice_of(m, ticker, NAIVE_PERIODS).tobytes()))
    finally:
        stop.set()
    return found


def _wiring() -> Path:
    return Path(umo.__file__).parent / "stations" / "ztheta" / "wiring" / "simulated.toml"


def memory() -> float:
    """MB resident in the control process of z-theta over Modbus, while it homes."""
    command = [str(Path(sys.executable).with_name("umo")), "plant", "ztheta", "--port", "0"]
    served = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert served.stdout is not None
        port = served.stdout.readline().rpartition(":")[2].strip()
        text = _wiring().with_name("modbus.toml").read_text().replace("port = 5020", f"port = {port}")
        with tempfile.TemporaryDirectory() as folder:
            wiring = Path(folder) / "modbus.toml"
            wiring.write_text(text)
            with umo.start("ztheta", wiring, parts=1, acknowledge=True) as started:
                while started.outcome is None and (started.frames is None or started.frames.head < 500):
                    started.poll(0.05)
                status = Path(f"/proc/{started.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024
    finally:
        served.kill()
        served.communicate()

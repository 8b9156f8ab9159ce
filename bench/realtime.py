"""The z-theta loop in real time in its own process, with company, beside a bare C loop in turns."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import umo
from umo.frames import Reader
from umo.latency import Samples, native
from umo.latency.measure import BUSY
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine

PERIOD = 0.001
NAIVE_PERIODS = 1000
ENOUGH = 0.02
"""s between two looks of a reader."""
READER = f"""
import time
from umo.frames import Reader, rings
reader = Reader(rings()[-1])
while True:
    reader.read()
    time.sleep({ENOUGH})
"""


@dataclass
class Loops:
    """umo's loop and the C loop, us; the naive one alone."""

    umo: Samples
    c: Samples | None
    lost: int


def measure(periods: int) -> Loops:
    """z-theta at 1 ms for at least so many periods, with `umo watch`, three more readers and a busy process beside it;
    after each run of one part the C loop for as long, with the same busy process."""
    found = Loops(Samples(), Samples(), 0)
    with native.compiled() as program, _busy():
        if program is None:
            found.c = None
        while len(found.umo.wake) + found.umo.missed < periods:
            begun = len(found.umo.wake)
            _station(found)
            if program is not None and found.c is not None:
                count = len(found.umo.wake) - begun
                found.c.add(native.run(program, PERIOD, count, *_granted()))
    return found


def _station(found: Loops) -> None:
    """One part, from homing to placing."""
    with umo.start("ztheta", parts=1, realtime=True, acknowledge=True) as started:
        while started.frames is None and started.outcome is None:
            started.poll(0.1)
        if started.frames is None:
            raise RuntimeError(f"the station did not start: {started.outcome}")
        company = [*_readers(str(started.pid))]
        try:
            while started.outcome is None:
                started.poll(ENOUGH)
                take(started.frames, found)
            take(started.frames, found)
        finally:
            for process in company:
                process.kill()
                process.communicate()
        found.lost += started.frames.lost


def take(reader: Reader, found: Loops) -> None:
    frames = reader.read()
    times = np.stack([frames["wake"], frames["execution"]], 1)
    times[frames["missed"] > 0] = -1
    found.umo.add(times)
    found.umo.missed += int(np.maximum(frames["missed"] - 1, 0).sum())


def _readers(pid: str) -> Iterator[subprocess.Popen[bytes]]:
    """`umo watch` on a terminal of its own (script), and three that read every frame."""
    watch = f"{Path(sys.executable).with_name('umo')} watch {pid}"
    yield subprocess.Popen(["script", "-qec", watch, "/dev/null"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    for _ in range(3):
        yield subprocess.Popen([sys.executable, "-c", READER], stderr=subprocess.DEVNULL)


@contextmanager
def _busy() -> Iterator[None]:
    process = subprocess.Popen([sys.executable, "-c", BUSY])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _granted() -> tuple[int, int | None]:
    """Priority and core that the control process gets here: as `umo.latency` finds out."""
    from umo.latency.loop import Loop

    loop = Loop(PERIOD, 80, None)
    loop.close()
    return loop.priority, loop.cpu


def naive() -> Samples:
    """z-theta in one process with one busy Python thread beside the loop, for comparison."""
    found, stop = Samples(), threading.Event()

    def spin() -> None:
        while not stop.is_set():
            pass

    connection = umo.connect(machine(), _wiring(), realtime=True)
    threading.Thread(target=spin, daemon=True).start()
    rows: list[tuple[int, float]] = []
    try:
        with connection as m:
            ticker = connection.wired.timer_wire.driver.ticker  # type: ignore[union-attr]
            task = m.start(main(m))
            while m.running and not task.done and len(rows) < NAIVE_PERIODS:
                missed = m.timer.read()
                woke = ticker.woke
                m.sample()
                m.control()
                m.update()
                found.missed += int(missed)
                rows.append((-1 if missed else woke - ticker.due, time.monotonic_ns() - woke))
    except umo.UmoError:
        pass  # a busy station fails at its work; its times are what is looked at
    finally:
        stop.set()
    missed = found.missed
    found.add(np.array(rows, np.int64))
    found.missed = missed
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

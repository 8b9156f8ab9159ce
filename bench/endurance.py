"""z-theta at 1 ms for minutes with all that may stand beside it: does anything grow?

In manual mode: a program that is attached moves z up and down. Beside it: two pages that show traces, `umo show
values`, and a black box is asked for after each move. After each move the resident memory, the descriptors and the
threads of each process are read, and the memory that the computer shares between processes.
"""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import umo
from bench.open_page import UMO, expect_running, pages, running_station, served
from bench.report import Doing, Target

TITLE = "Minutes of z-theta with everything beside it"
EVERY = 5.0
"""s from the end of a move to the next reading."""
SETTLED = 0.25
"""The share of the readings from which on nothing is to grow."""
GROWTH = 1.02
"""Times as much memory at the end as then, at most."""
HEIGHTS = 60_000.0, 100_000.0
"""um, between which z moves."""

Reading = dict[str, float]


def measure(minutes: float, doing: Doing) -> Iterator[Target]:
    """A row for each process and reading: when all had settled, and at the end."""
    readings: list[dict[str, Reading]] = []
    with (
        running_station(parts=1, manual=True) as started,
        served() as server,
        _watcher() as watcher,
        umo.attach("ztheta") as station,
        pages(server.address, ["z.encoder", "theta.encoder"], 2),
        station.lease("endurance"),
    ):
        pids = {
            "control process": started.pid,
            "guardian": started.guardian,
            "standby": started.standby,
            "umo show page": server.pid,
            "umo show values": watcher,
        }
        station.home()
        end = time.monotonic() + 60.0 * minutes
        while time.monotonic() < end:
            doing(f"{max(end - time.monotonic(), 0.0) / 60.0:.1f} min left")
            with suppress(umo.TaskFailed):  # its cause is that of the end
                station.z.move_to(HEIGHTS[len(readings) % 2])
            started.poll(EVERY)
            expect_running(started)
            started.keep_black_box()
            try:
                readings.append({name: _reading(pid) for name, pid in pids.items()} | {"computer": _shared()})
            except FileNotFoundError as error:
                raise RuntimeError(f"one of {pids} has ended; the run told: {started.notices}") from error
    yield from _rows(readings)


def _rows(readings: list[dict[str, Reading]]) -> Iterator[Target]:
    """The median of a tenth of the readings, each."""
    few = max(len(readings) // 10, 1)
    begin = int(SETTLED * len(readings))
    early, late = readings[begin : begin + few], readings[-few:]
    for process, what in [(process, what) for process, reading in readings[0].items() for what in reading]:
        before, after = (sorted(each[process][what] for each in some)[few // 2] for some in (early, late))
        limit = GROWTH if what.endswith("MB") else 1.0
        verdict = "met" if after <= limit * before else "grew"
        yield Target(f"{process}, {what}", f"at most {limit:g} times", f"{before:.1f}, then {after:.1f}", verdict)


def _reading(pid: int | None) -> Reading:
    status = Path(f"/proc/{pid}/status").read_text()
    fields = dict(line.split(":", 1) for line in status.splitlines())
    files = len(list(Path(f"/proc/{pid}/fd").iterdir()))
    return {"MB": int(fields["VmRSS"].split()[0]) / 1000, "descriptors": files, "threads": int(fields["Threads"])}


def _shared() -> Reading:
    """Memory files, wherever they are, and tmpfs (proc_meminfo(5), Shmem)."""
    fields = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    return {"shared MB": int(fields["Shmem"].split()[0]) / 1000}


@contextmanager
def _watcher() -> Iterator[int]:
    """`umo show values` on a terminal, its pid."""
    screen, terminal = os.openpty()
    threading.Thread(target=_emptied, args=(screen,), daemon=True).start()
    command = [*UMO, "show", "values", "ztheta"]
    with subprocess.Popen(command, stdin=terminal, stdout=terminal) as process:
        os.close(terminal)
        try:
            yield process.pid
        finally:
            process.terminate()


def _emptied(screen: int) -> None:
    with suppress(OSError):  # nobody writes any more
        while os.read(screen, 1 << 16):
            pass

"""A bench that publishes its frames, in this process or in another."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from helpers.machines import Bench, bench, wired
from umo import connect, published
from umo.cycle.journal import Kind
from umo.process.frames import Ring
from umo.testing import Scripted, VirtualTimer


@contextmanager
def running(box: Scripted | None = None, *, missed: Any = (), **changes: Any) -> Iterator[tuple[Bench, Ring, Any]]:
    """A bench of five objects that publishes."""
    m = bench(**changes)
    connection = connect(m, wired(m, box or Scripted(), clock=VirtualTimer(missed)))
    with connection, published(connection, "bench") as ring:
        yield m, ring, connection


def write(ring: Ring, frame: Any, number: int, entries: int) -> None:
    """A frame with so many entries, all of which hold its number."""
    for _ in range(entries):
        ring.journal.add(0, Kind.WRITE, number, -number)
    frame.number = number
    ring(frame)


def without_times(entries: Any) -> list[tuple[int, ...]]:
    """Entries of a journal: slot, kind, error, raw, before."""
    found: list[tuple[int, ...]] = entries[["slot", "kind", "error", "raw", "before"]].tolist()
    return found


WRITER = """
import sys
from array import array
sys.path.insert(0, sys.argv[1])
from helpers.publishing import running
from umo.cycle.showing import frame_of
from umo.testing import periods
with running() as (m, ring, connection):
    periods(m, 3)
    print(ring.path, flush=True)
    frame, image = frame_of(connection.machine), connection.image
    number = 0
    while sys.argv[2] == "fast":
        number += 1
        frame.number, frame.time = number, float(number)
        image.values[:] = array("d", [float(number)] * len(image.items))
        image.columns.raws.fill(number)
        ring.journal.add(0, 0, number, -number)
        ring(frame)
    sys.stdin.read()
"""


@contextmanager
def writer(how: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Another process that publishes, at full speed or not at all."""
    command = [sys.executable, "-c", WRITER, str(Path(__file__).parents[1]), how]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, Path(process.stdout.readline().strip())
    finally:
        process.kill()
        process.communicate()

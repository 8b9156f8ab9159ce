"""What publishing a frame and looking for commands cost, and whether a reader at full speed ever sees a torn frame."""

from __future__ import annotations

import os
import tempfile
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np

from bench.driver import Fill
from bench.machine import machine, wiring
from bench.mix import layout
from umo import connect, published
from umo.cycle.hands import Hands
from umo.frames import Reader, Ring
from umo.frames.folder import QUEUE
from umo.remote.queue import HEAD, Receiver

BATCH = 200
PERIOD = 0.001


@dataclass
class Torn:
    """A writer at full speed, every number of a frame the same; a reader at full speed checks each."""

    read: int
    torn: int
    lost: int


def publishing(count: int, batches: int) -> tuple[float, float, float]:
    """us to publish one frame of so many objects: the least of some batches, their median, and the least of what the
    counters of the operating system alone take of it."""
    plan = layout(count)
    plant = machine(plan)
    connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
    with (
        tempfile.TemporaryDirectory() as folder,
        connection as m,
        published(connection, "bench", path=Path(folder) / "bench.frames") as ring,
    ):
        m.sample()
        m.update()
        frame = connection.machine.frame
        times = [_batch(ring, frame) for _ in range(batches)]
        counting = min(_batch(lambda _: ring.usage.read(), None) for _ in range(batches))
    return min(times), float(np.median(times)), counting


def looking(batches: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """us of the look for commands from outside in a period of 1 ms, where there are none: the least of some batches and
    their median; and the same of one `os.pread` of 8 bytes of the queue, in turns with it."""
    plan = layout(13)
    plant = machine(plan)
    connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
    with (
        connection,
        published(connection, "bench") as ring,
        closing(Receiver(ring.path.with_suffix(QUEUE), ring.bell, PERIOD)) as receiver,
        receiver.path.open("rb") as queue,
    ):
        hands, file = Hands(connection.machine, receiver), queue.fileno()
        looks, reads = [], []
        for _ in range(batches):
            looks.append(_batch(lambda _: hands.look(), None))
            reads.append(_batch(lambda _: os.pread(file, 8, HEAD), None))
    return (min(looks), float(np.median(looks))), (min(reads), float(np.median(reads)))


def _batch(work: Any, frame: Any) -> float:
    start = perf_counter_ns()
    for _ in range(BATCH):
        work(frame)
    return (perf_counter_ns() - start) / BATCH * 1e-3


def torn(frames: int) -> Torn:
    """Read so many frames of 13 objects."""
    plan = layout(13)
    plant = machine(plan)
    connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
    with (
        tempfile.TemporaryDirectory() as folder,
        connection,
        published(connection, "bench", path=Path(folder) / "bench.frames") as ring,
    ):
        writer = os.fork()
        if writer == 0:
            _write(connection, ring)
        try:
            return _read(ring.path, frames)
        finally:
            os.kill(writer, 9)
            os.waitpid(writer, 0)


def _write(connection: connect[Any], ring: Ring) -> None:
    """Never returns: each frame holds its own number everywhere."""
    try:
        image, frame = connection.image, connection.machine.frame
        count, number = len(image.items), 0
        while True:
            number += 1
            frame.number, frame.time = number, float(number)
            image.values[:] = [float(number)] * count
            image.transfer.raws_array.fill(number)
            ring(frame)
    finally:
        os._exit(1)


def _read(path: Path, frames: int) -> Torn:
    found = Torn(0, 0, 0)
    with Reader(path) as reader:
        while found.read < frames:
            seen = reader.read()
            number = seen["number"]
            same = (seen["time"] == number) & (seen["values"] == number[:, None]).all(1)
            same &= (seen["raws"] == number[:, None]).all(1)
            found.read += len(seen)
            found.torn += int((~same).sum())
        found.lost = reader.lost
    return found

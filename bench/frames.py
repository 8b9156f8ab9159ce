"""The cost of publishing a frame and of looking for commands, and whether a reader at full speed ever sees a torn
frame."""

from __future__ import annotations

import os
from array import array
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Any

import numpy as np

from bench.driver import Fill
from bench.machine import machine, wiring
from bench.mix import layout
from umo import Compound, connect, published
from umo.cycle.frame import Frame
from umo.cycle.showing import frame_of
from umo.operation.commands.client_control import ClientControl
from umo.process.frames import Reader, Ring
from umo.process.frames.client_memory import HEAD, ClientMemory
from umo.process.frames.command_queue import Receiver

BATCH = 200


@dataclass
class Torn:
    """A writer at full speed, every number of a frame the same; a reader at full speed checks each."""

    read: int
    torn: int
    lost: int


@dataclass
class Published:
    """us to publish one frame, of batches the least and the median."""

    alone: tuple[float, float]
    """One frame after the other."""
    in_period: tuple[float, float]
    """In the periods of a machine, which use the processor's caches for other things too."""
    counting: float
    """The least of what reading the counters of the operating system takes."""


def publishing(count: int, batches: int) -> Published:
    """A machine with so many objects."""
    plan = layout(count)
    plant = machine(plan)
    connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
    with connection as m, published(connection, "bench") as ring:
        stopwatch, journal = Stopwatch(ring), ring.journal

        def publish(frame: Any) -> None:
            journal.sampled = journal.updated = 0  # as sample and update leave it
            ring(frame)

        connection.machine.observers[:] = [stopwatch]
        in_period = [stopwatch.batch(m) for _ in range(batches)]
        alone = [_batch(publish, frame_of(connection.machine)) for _ in range(batches)]
        counting = min(_batch(lambda _: ring.usage.read(), None) for _ in range(batches))
    return Published(_least(alone), _least(in_period), counting)


def _least(times: list[float]) -> tuple[float, float]:
    return min(times), float(np.median(times))


class Stopwatch:
    """An observer in the place of a ring, which it calls: how long that takes in the periods of a machine."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._ns = 0

    def __call__(self, frame: Frame) -> None:
        began = perf_counter_ns()
        self._ring(frame)
        self._ns += perf_counter_ns() - began

    def batch(self, m: Compound) -> float:
        """us of one call, the mean of `BATCH` periods."""
        self._ns = 0
        for _ in range(BATCH):
            m.timer.read()  # type: ignore[attr-defined]
            m.sample()
            m.update()
        return self._ns / BATCH / 1000


def looking(batches: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """us of the look for commands from outside in a period of 1 ms, where there are none: the least of some batches and
    their median; and the same of one `os.pread` of 8 bytes of the queue, in turns with it."""
    plan = layout(13)
    plant = machine(plan)
    connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
    with connection, published(connection, "bench") as ring, Reader(ring.path) as reader:
        assert reader.ends is not None
        file = reader.ends.cells
        cells = ClientMemory(file, reader.layout)
        clients = connection.machine.attach(ClientControl(Receiver(cells), cells))
        looks, reads = [], []
        for _ in range(batches):
            looks.append(_batch(lambda _: clients.look(), None))
            reads.append(_batch(lambda _: os.pread(file, 8, HEAD), None))
        cells.close()
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
    with connection, published(connection, "bench") as ring, Reader(ring.path) as reader:
        writer = os.fork()
        if writer == 0:
            _write(connection, ring)
        try:
            return _read(reader, frames)
        finally:
            os.kill(writer, 9)
            os.waitpid(writer, 0)


def _write(connection: connect[Any], ring: Ring) -> None:
    """Never returns: each frame holds its own number everywhere."""
    try:
        image, frame = connection.image, frame_of(connection.machine)
        count, number = len(image.items), 0
        while True:
            number += 1
            frame.number, frame.time = number, float(number)
            image.values[:] = array("d", [float(number)] * count)
            image.columns.raws.fill(number)
            ring(frame)
    finally:
        os._exit(1)


def _read(reader: Reader, frames: int) -> Torn:
    found = Torn(0, 0, 0)
    while found.read < frames:
        seen = reader.read()
        number = seen["number"]
        same = (seen["time"] == number) & (seen["values"] == number[:, None]).all(1)
        same &= (seen["raws"] == number[:, None]).all(1)
        found.read += len(seen)
        found.torn += int((~same).sum())
    found.lost = reader.lost
    return found

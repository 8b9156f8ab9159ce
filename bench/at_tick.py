"""Outputs at the next tick: how long after its tick the last output has been handed to its driver, beside a C loop."""

from __future__ import annotations

import argparse
import signal
import struct
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from time import monotonic_ns
from typing import Any

from umo import Compound
from umo.commissioning.latency import Samples, native
from umo.commissioning.latency.loop import example, slice_of
from umo.cycle.cache_warming import wait_busily
from umo.cycle.connect import connect
from umo.drivers.contract import Channel, IntArray
from umo.drivers.simulated import Simulated
from umo.objects import atoms
from umo.system import realtime

PERIOD = 0.001
SLICE = 500
"""Periods."""
GRANTED = struct.Struct("<qq")


class Stamped(Simulated):
    """Notes when it has been handed its outputs."""

    def __init__(self) -> None:
        super().__init__()
        self.handed = 0
        """ns of CLOCK_MONOTONIC"""

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        super().write_many(channels, raws)
        self.handed = monotonic_ns()


def measure(seconds: float) -> tuple[Samples, Samples | None]:
    """From the tick to the last output, as `total`; and the C loop, which sleeps until the tick, in turns with it."""
    handed = Samples()
    command = [sys.executable, "-m", "bench.at_tick"]
    with (
        native.compiled() as program,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        c = None if program is None else Samples()
        priority, core = GRANTED.unpack(process.stdout.read(GRANTED.size))
        for _ in range(max(1, round(seconds / PERIOD / SLICE))):
            process.stdin.write(b"x")
            process.stdin.flush()
            handed.add(native.Slice.of(process.stdout.read(16 * (SLICE + 1))))
            if program is not None and c is not None:
                c.add(native.run(program, PERIOD, SLICE, priority, core if core >= 0 else None))
        process.stdin.close()
    return handed, c


def wiring(machine: Compound, box: Simulated) -> dict[str, Any]:
    """Everything on `box`, the timer in real time."""
    wire: dict[str, Any] = {item.path: {"driver": "box"} for item in atoms(machine)}
    wire["timer"] = {"driver": "timerfd", "period": PERIOD}
    return {"drivers": {"box": box}, "wire": wire}


def serve() -> None:
    """The process: a slice for each byte."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    machine, box = example(), Stamped()
    connection = connect(machine, wiring(machine, box) | {"process": {"outputs": "at next tick"}})
    with suppress(BrokenPipeError), connection as m:
        realtime.prepare()
        priority, core = realtime.granted()
        ticker = connection.wired.drivers["timerfd"].ticker  # type: ignore[attr-defined]
        wait_busily(connection.wired, realtime.default_busy_wait(PERIOD))
        sys.stdout.buffer.write(GRANTED.pack(priority, -1 if core is None else core))
        sys.stdout.buffer.flush()
        slice_of(m, ticker, 1, lambda: box.handed)  # in the first period nothing is sent
        while sys.stdin.buffer.read(1):
            sys.stdout.buffer.write(slice_of(m, ticker, SLICE, lambda: box.handed).tobytes())
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    serve()

"""A living Modbus device at 5 ms beside a dead one, against the living one alone, in turns: how many periods are
missed? Both are made with libmodbus, in processes of their own; the dead one's is stopped (SIGSTOP), so its connections
are accepted and nothing is answered."""

from __future__ import annotations

import gc
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import sqrt
from typing import Any

from bench.report import Doing, Target
from tests.helpers.peers.modbus_device import device
from umo import Compound, DigitalActuator, DigitalSensor, connect
from umo.drivers.modbus import Modbus
from umo.errors import DriverError

TITLE = "A living Modbus device beside a dead one"
PERIOD = 0.005
TIMEOUT = 10 * PERIOD
BLOCK = 20.0
"""Duration in s of a block."""
BEFORE = 1.0
"""Time in s from the beginning of a block until the device is dead."""
OBJECTS = 8
FIRST = round(TIMEOUT / PERIOD) + 1
"""Periods that the first timeout may cost."""


class Pair(Compound):
    timer: DigitalSensor
    near_in: list[DigitalSensor]
    near_out: list[DigitalActuator]
    far_in: list[DigitalSensor]
    far_out: list[DigitalActuator]


class Counted(Modbus):
    """Counts its transfers and its looks."""

    transfers = looks = 0

    def read_many(self, channels: Any, out: Any) -> None:
        self.transfers += 1
        super().read_many(channels, out)

    def write_many(self, channels: Any, raws: Any) -> None:
        self.transfers += 1
        super().write_many(channels, raws)

    def look(self) -> bool | None:
        self.looks += 1
        return super().look()


@dataclass
class Missed:
    """The missed periods of the blocks of one kind."""

    periods: int = 0
    missed: list[int] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    """Those of the first timeout."""
    transfers: int = 0
    """Transfers of the dead device that were tried."""
    looks: int = 0


def measure(minutes: float, doing: Doing) -> Iterator[Target]:
    alone, beside = Missed(), Missed()
    end = time.monotonic() + 60.0 * minutes
    while time.monotonic() < end:
        doing(f"{max(end - time.monotonic(), 0.0) / 60.0:.1f} min left")
        _block(alone, dead=False)
        _block(beside, dead=True)
    yield Target("missed periods, alone", "", _shown(alone, alone.missed), "")
    later = [all_ - first for all_, first in zip(beside.missed, beside.first, strict=True)]
    few = 3.0 * sqrt(sum(later) + sum(alone.missed) + 1)  # what two equal counts may differ by
    verdict = "" if sum(later) <= sum(alone.missed) + few else "more than alone"
    yield Target("missed periods, beside, after the first timeout", "as alone", _shown(beside, later), verdict)
    worst = max(beside.first, default=0)
    yield Target(
        "missed periods by the first timeout, worst", f"{FIRST}", f"{worst}", "" if worst <= FIRST else "missed"
    )
    blocks = len(beside.missed)
    tried = f"{beside.transfers} in {blocks} blocks, {beside.looks} looks"
    yield Target("transfers of the dead device", "1 a block", tried, "" if beside.transfers == blocks else "missed")


def _shown(of: Missed, missed: list[int]) -> str:
    return f"{sum(missed)} of {of.periods:,} ({', '.join(map(str, missed))})"


def _block(found: Missed, dead: bool) -> None:
    """One block of either kind: without the other device, or with it, dead after a second."""
    with device("quiet-") as near, device("quiet-") as far:
        driver = Counted(port=far.port)
        connection = connect(_machine(OBJECTS * dead), _wiring(near.port, driver, OBJECTS * dead))
        # the dead device is told at the end if it is late with its resets; a block that was cut short has no figures
        with suppress(DriverError), connection as m, _no_collector():
            clock = connection.machine.clock
            _run(m, BEFORE)
            missed, period, tried = clock.missed_in_all, clock.number, driver.transfers
            if dead:
                os.kill(far.process.pid, signal.SIGSTOP)
                _run(m, TIMEOUT + 4 * PERIOD)  # the next tick tells what the timeout has cost
                found.first.append(clock.missed_in_all - missed)
            _run(m, BLOCK - BEFORE)
            found.missed.append(clock.missed_in_all - missed)
            found.periods += clock.number - period
            if dead:
                found.transfers += driver.transfers - tried
                found.looks += driver.looks
                os.kill(far.process.pid, signal.SIGCONT)


def _run(m: Pair, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        m.timer.read()
        m.sample()
        m.control()
        m.update()


@contextmanager
def _no_collector() -> Iterator[None]:
    """As in the control process."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _machine(others: int) -> Pair:
    whole: dict[str, Any] = {"minimum": 0.0, "maximum": 65_535.0, "resolution": 1.0}
    hold, retry = ({"on_error": each, "max_age": "1 h"} for each in ("hold", "retry"))
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False)
    return Pair(
        timer=timer,
        near_in=[DigitalSensor("count", **whole) for _ in range(OBJECTS)],
        near_out=[DigitalActuator("count", default=0.0, **whole) for _ in range(OBJECTS)],
        far_in=[DigitalSensor("count", **whole, **hold) for _ in range(others)],
        far_out=[DigitalActuator("count", default=0.0, **whole, **retry) for _ in range(others)],
    )


def _wiring(port: int, far: Modbus, others: int) -> dict[str, Any]:
    wire: dict[str, Any] = {"timer": {"driver": "timerfd", "period": f"{PERIOD} s"}}
    for driver, count in (("near", OBJECTS), ("far", others)):
        for number in range(count):
            wire[f"{driver}_in.{number}"] = {"driver": driver, "channel": f"input:{number}"}
            wire[f"{driver}_out.{number}"] = {"driver": driver, "channel": f"holding:{number}"}
    near = {"type": "modbus", "port": port, "timeout": "1 s"}  # a busy computer may hold its process up
    return {"drivers": {"near": near, "far": {"type": far, "timeout": f"{TIMEOUT} s"}}, "wire": wire}

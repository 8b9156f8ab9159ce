"""A thousand alarms while nothing happens: a period of a machine with them against the same machine without, in turns.

python -m bench --alarms ROUNDS
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter_ns
from typing import Any

import numpy as np

import umo
from bench.report import Doing, Target
from umo import Compound, DigitalSensor
from umo.alarms import Alarm, Bad, High, Low
from umo.objects import atoms
from umo.testing import VirtualTimer

TITLE = "1,000 alarms while nothing happens"
COUNT = 1_000
BATCH = 200
"""Periods that are timed together."""
LIMIT = 60.0
"""us a period."""


class Plain(Compound):
    timer: DigitalSensor
    sensors: list[DigitalSensor]


def _data(machine: Any) -> dict[str, Alarm]:
    """Of each of 250 sensors four: too high, far too high, too low, BAD."""
    alarms = {}
    for number in range(COUNT // 4):
        path = f"sensors.{number}"
        alarms[f"high{number}"] = Alarm(High(path, 80.0, deadband=2.0), "high", on_delay="1 s")
        alarms[f"higher{number}"] = Alarm(High(path, 90.0), "higher", latch=True)
        alarms[f"low{number}"] = Alarm(Low(path, -50.0), "low", off_delay="1 s")
        alarms[f"bad{number}"] = Alarm(Bad(path), "bad")
    return alarms


class Data(Plain, alarms=_data):
    pass


class Functions(Plain, alarms={f"f{number}": Alarm(lambda m: m.dt > 1.0, "slow") for number in range(COUNT)}):
    pass


KINDS: dict[str, type[Plain]] = {"without": Plain, "data": Data, "functions": Functions}


def measure(rounds: int, doing: Doing) -> Iterator[Target]:
    """So many batches of each kind, in turns."""
    machines = {kind: _connected(cls) for kind, cls in KINDS.items()}
    times: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(rounds):
        doing(f"round {number + 1} of {rounds}")
        for kind, (_, machine) in machines.items():
            times[kind].append(_batch(machine))
    for connection, _ in machines.values():
        connection.__exit__(None, None, None)
    yield Target("a period without alarms", "", _shown(times["without"]), "")
    for kind in ("data", "functions"):
        more, usual = (each(times[kind]) - each(times["without"]) for each in (min, np.median))
        shown, decides = f"{more:.1f} us, of medians {usual:.1f} us", kind == "data"
        verdict = "missed" if decides and more > LIMIT else ""
        yield Target(f"more for 1,000 alarms, {kind}", f"{LIMIT:g} us" if decides else "", shown, verdict)


def _connected(cls: type[Plain]) -> tuple[Any, Any]:
    sensors = [DigitalSensor("mm", minimum=-100.0, maximum=100.0, resolution=0.5) for _ in range(COUNT // 4)]
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False)
    machine = cls(timer=timer, sensors=sensors)
    wire: dict[str, Any] = {item.path: {"driver": "simulated"} for item in atoms(machine)}
    wire["timer"] = {"driver": "clock", "period": "1 ms"}
    connection = umo.connect(machine, {"drivers": {"clock": VirtualTimer()}, "wire": wire})
    return connection, connection.__enter__()


def _batch(m: Any) -> float:
    """us a period."""
    began = perf_counter_ns()
    for _ in range(BATCH):
        m.timer.read()
        m.sample()
        m.control()
        m.update()
    return (perf_counter_ns() - began) / BATCH / 1e3


def _shown(times: Any) -> str:
    return f"{min(times):.1f} us, median {np.median(times):.1f} us"

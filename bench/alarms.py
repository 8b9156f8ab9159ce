"""A thousand alarms while nothing happens: a period of a machine with them against the same machine without, in turns.
Ten thousand that all come and go in every period: a look at them against one while nothing happens, in turns.

python -m bench --alarms ROUNDS
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter_ns, process_time_ns
from typing import Any

import numpy as np

import umo
from bench.report import Doing, Target
from umo import Compound, DigitalSensor
from umo.objects import atoms
from umo.operation.alarms import Alarm, Bad, High, Low
from umo.operation.alarms.alarming import engine_of
from umo.testing import VirtualTimer

TITLE = "1,000 alarms while nothing happens"
COUNT = 1_000
BATCH = 200
"""Periods that are timed together."""
LIMIT = 60.0
"""us a period."""
CHATTER_ROUNDS = 10
MANY = 10_000
CHATTER_LIMIT = 1_000.0
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


class Many(Plain, alarms=lambda m: {f"a{n}": Alarm(High(f"sensors.{n}", 80.0), "high") for n in range(MANY)}):
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
    yield _chattering(min(rounds, CHATTER_ROUNDS), doing)


def _chattering(rounds: int, doing: Doing) -> Target:
    connection, _ = _connected(Many, MANY)
    alarms, image = engine_of(connection.machine), connection.machine.image
    assert alarms is not None
    still: list[float] = []
    swinging: list[float] = []
    for number in range(rounds):
        doing(f"{MANY:,} alarms that chatter, round {number + 1} of {rounds}")
        for times, values in (still, (0.0, 0.0)), (swinging, (90.0, 0.0)):
            began = process_time_ns()
            for period in range(BATCH):
                image.clock.now += 1e-3
                image.columns.values[:] = values[period % 2]
                alarms.look()
            times.append((process_time_ns() - began) / BATCH / 1e3)
    connection.__exit__(None, None, None)
    more = float(np.median(swinging) - np.median(still))
    shown = f"{more:.0f} us, beside {np.median(still):.0f} us"
    name = f"more for {MANY:,} alarms that come and go in every period"
    return Target(name, f"{CHATTER_LIMIT:g} us", shown, "missed" if more > CHATTER_LIMIT else "")


def _connected(cls: type[Plain], count: int = COUNT // 4) -> tuple[Any, Any]:
    sensors = [DigitalSensor("mm", minimum=-100.0, maximum=100.0, resolution=0.5) for _ in range(count)]
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

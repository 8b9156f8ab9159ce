"""The fast part of a machine of three rates (1 ms, 10 ms, 1 s), against the same part alone, in turns: how long after
the tick are its outputs at the driver, and how many periods are missed? The slow parts compute for a good share of a
period."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import umo
from bench.against import Row
from bench.report import Doing, Target
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import next_period
from umo.drivers import Channel, Direction, Driver
from umo.objects import atoms

TITLE = "A part of 1 ms with parts of 10 ms and of 1 s beside it"
BLOCK = 10.0
"""Duration in s of a block."""
SETTLING = 0.5
"""Time in s at the beginning of a block that is not counted."""
OBJECTS = 8
"""Sensors, and actuators, of each part."""
COMPUTES = {"middle": 100e-6, "slow": 400e-6}
"""Time in s for which the law of each slow part computes."""
LIMIT = 1.05
NS = 1_000_000_000


class Part(Compound):
    inputs: list[DigitalSensor]
    outputs: list[DigitalActuator]

    def control(self) -> None:
        for sensor, actuator in zip(self.inputs, self.outputs, strict=True):
            actuator.write(min(sensor.read() + 1.0, 1000.0))


class Computing(Part):
    def control(self) -> None:
        super().control()
        end = time.perf_counter() + COMPUTES[self._name]
        while time.perf_counter() < end:
            pass


class Middle(Computing, every="10 ms"):
    pass


class Slow(Computing, every="1 s"):
    pass


class Alone(Compound):
    timer: DigitalSensor
    sent: DigitalSensor
    """The time at which the last outputs of the fast part were sent, ns within a second of CLOCK_MONOTONIC."""
    fast: Part


class Three(Alone):
    middle: Middle
    slow: Slow


class Clocked(Driver):
    """Channels in memory. `sent` is the time at which the outputs were written last."""

    def __init__(self) -> None:
        self._sent = 0

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.OUTPUT if "outputs" in text else Direction.INPUT, 63)

    def read_many(self, channels: Sequence[Channel], out: Any) -> None:
        out[:] = [self._sent if channel.text == "sent" else 1 for channel in channels]

    def write_many(self, channels: Sequence[Channel], raws: Any) -> None:
        self._sent = time.monotonic_ns() % NS

    def write(self, channel: Channel, raw: int) -> None:
        pass


def _part(kind: type[Part]) -> Any:
    whole: dict[str, Any] = {"minimum": 0.0, "maximum": 1000.0, "resolution": 1.0}
    return kind(
        inputs=[DigitalSensor("count", **whole) for _ in range(OBJECTS)],
        outputs=[DigitalActuator("count", default=0.0, **whole) for _ in range(OBJECTS)],
    )


def _first() -> dict[str, Any]:
    return {
        "timer": DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
        "sent": DigitalSensor("count", minimum=0.0, maximum=float(NS), resolution=1.0),
        "fast": _part(Part),
    }


def alone() -> Alone:
    return Alone(**_first())


def three() -> Three:
    return Three(**_first(), middle=_part(Middle), slow=_part(Slow))


async def application(m: Alone) -> None:
    while True:
        await next_period()


def _wiring(machine: Compound) -> dict[str, Any]:
    """The slow parts have a driver of their own."""
    fast = ("sent", "fast")
    wire: dict[str, Any] = {
        item.path: {"driver": "clocked" if item.path.startswith(fast) else "simulated"} for item in atoms(machine)
    }
    wire["timer"] = {"driver": "timerfd", "period": "1 ms"}
    return {"drivers": {"clocked": {"type": "bench.several_rates:Clocked"}}, "wire": wire}


KINDS: dict[str, Any] = {"alone": alone, "three rates": three}
ALONE, BESIDE = KINDS


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    """So many blocks of each kind, in turns."""
    late: dict[str, list[float]] = {kind: [] for kind in KINDS}
    missed = dict.fromkeys(KINDS, 0)
    periods = dict.fromkeys(KINDS, 0)
    for pair in range(pairs):
        for kind, machine in KINDS.items():
            doing(f"pair {pair + 1} of {pairs}: {kind}")
            times, count = _block(machine)
            late[kind].append(float(np.percentile(times, 99)))
            missed[kind] += count
            periods[kind] += len(times)
    for kind in KINDS:
        p99 = np.median(late[kind]) / 1e3
        shown = f"{missed[kind]} of {periods[kind]:,}; outputs of 1 ms at p99 {p99:.0f} us after the tick"
        yield Target(f"missed periods, {kind}", "", shown, "")
    row = Row(BESIDE, list(zip(late[BESIDE], late[ALONE], strict=True)))
    low, high = row.interval
    shown = f"{np.median(row.ratios):.3f} ({low:.3f} to {high:.3f})"
    yield Target(f"p99 of the part of 1 ms, {BESIDE}, to {ALONE}", f"{LIMIT}", shown, "missed" if low > LIMIT else "")


def _block(machine: Any) -> tuple[Any, int]:
    """The times in ns from the tick to the fast outputs, of each period of a block; the number of those missed."""
    times: list[Any] = []
    missed = 0
    with umo.start(machine, _wiring(machine()), application, acknowledge=True) as started:
        while started.frames is None and started.outcome is None:
            started.poll(0.1)
        if started.frames is None:
            raise RuntimeError(f"the machine did not start: {started.outcome}")
        begin, end = time.monotonic() + SETTLING, time.monotonic() + SETTLING + BLOCK
        while time.monotonic() < end:
            started.poll(0.02)
            frames = started.frames.read()
            if time.monotonic() >= begin and len(frames) > 1:
                times.append(_sent_after(frames, started.frames.layout))
                missed += int(np.maximum(frames["missed"] - 1, 0).sum())
        started.stop()
    return np.concatenate(times), missed


def _sent_after(frames: Any, layout: Any) -> Any:
    """What a frame reads as `sent` is of the period before it."""
    slot = [entry["path"] for entry in layout.objects].index("sent")
    ticks = frames["began"][:-1] - np.maximum(frames["wake"][:-1], 0)
    known = frames["wake"][:-1] >= 0
    return ((frames["raws"][1:, slot] - ticks) % NS)[known]

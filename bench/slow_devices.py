"""A loop of 1 ms with slow devices off the cycle beside it, against the same loop without them, in turns: how many
periods are missed, and how long after the tick does one end? Without them their objects are on simulated channels."""

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

TITLE = "Slow devices beside a loop of 1 ms"
BLOCK = 10.0
"""Duration in s of a block."""
SETTLING = 0.5
"""Time in s at the beginning of a block that is not counted."""
FAST, SLOW = 8, 4
"""Objects of each kind on the loop's own driver, and on each slow device."""
LIMIT = 1.05
ALONE = "without"
KINDS: dict[str, dict[str, tuple[str, float, str]]] = {
    ALONE: {},
    "50 ms and 100 ms": {"a": ("Waits", 0.05, "60 ms"), "b": ("Waits", 0.1, "120 ms")},
    "5 ms of Python": {"a": ("Works", 0.005, "10 ms")},
}
"""The devices of each kind of block: class, time of a transfer in s, period."""


class Loop(Compound):
    timer: DigitalSensor
    inputs: list[DigitalSensor]
    outputs: list[DigitalActuator]
    slow_inputs: list[DigitalSensor]
    slow_outputs: list[DigitalActuator]

    def control(self) -> None:
        for sensor, actuator in zip(self.inputs, self.outputs, strict=True):
            actuator.write(min(sensor.read() + 1.0, 1000.0))


class Slow(Driver):
    """A device whose transfers take their time."""

    def __init__(self, *, takes: float) -> None:
        self.takes = takes

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.INPUT if text.startswith("in") else Direction.OUTPUT, 32, signed=True)

    def take(self) -> None:
        raise NotImplementedError

    def read_many(self, channels: Sequence[Channel], out: Any) -> None:
        self.take()
        out[:] = time.monotonic_ns() // 1_000_000 % 1000

    def write_many(self, channels: Sequence[Channel], raws: Any) -> None:
        pass

    def write(self, channel: Channel, raw: int) -> None:
        pass


class Waits(Slow):
    """Its transfers wait."""

    def take(self) -> None:
        time.sleep(self.takes)


class Works(Slow):
    """Its transfers compute, in Python."""

    def take(self) -> None:
        end = time.monotonic() + self.takes
        while time.monotonic() < end:
            pass


def machine() -> Loop:
    whole: dict[str, Any] = {"minimum": 0.0, "maximum": 1000.0, "resolution": 1.0}
    return Loop(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
        inputs=[DigitalSensor("count", **whole) for _ in range(FAST)],
        outputs=[DigitalActuator("count", default=0.0, **whole) for _ in range(FAST)],
        slow_inputs=[DigitalSensor("count", on_error="mark", **whole) for _ in range(2 * SLOW)],
        slow_outputs=[DigitalActuator("count", default=0.0, **whole) for _ in range(2 * SLOW)],
    )


async def application(m: Loop) -> None:
    while True:
        for actuator in m.slow_outputs:
            actuator.write(m.now % 1000.0)
        await next_period()


def _wiring(devices: dict[str, tuple[str, float, str]]) -> dict[str, Any]:
    wire: dict[str, Any] = {"timer": {"driver": "timerfd", "period": "1 ms"}}
    wire |= {f"{kind}.{n}": {"driver": "simulated"} for kind in ("inputs", "outputs") for n in range(FAST)}
    drivers: dict[str, Any] = {"other": {"type": "simulated"}}
    for n in range(2 * SLOW):
        wire |= {f"{kind}.{n}": {"driver": "other"} for kind in ("slow_inputs", "slow_outputs")}
    for number, (name, (kind, takes, period)) in enumerate(devices.items()):
        drivers[name] = {
            "type": f"bench.slow_devices:{kind}",
            "takes": takes,
            "off_cycle": True,
            "period": period,
            "max_age": "10 s",
        }
        for n in range(number * SLOW, (number + 1) * SLOW):
            wire[f"slow_inputs.{n}"] = {"driver": name, "channel": f"in:{n}"}
            wire[f"slow_outputs.{n}"] = {"driver": name, "channel": f"out:{n}"}
    return {"drivers": drivers, "wire": wire}


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    """So many blocks of each kind, in turns."""
    late: dict[str, list[float]] = {kind: [] for kind in KINDS}
    missed = dict.fromkeys(KINDS, 0)
    periods = dict.fromkeys(KINDS, 0)
    for pair in range(pairs):
        for kind, devices in KINDS.items():
            doing(f"pair {pair + 1} of {pairs}: {kind}")
            ends, count = _block(devices)
            late[kind].append(float(np.percentile(ends, 99)))
            missed[kind] += count
            periods[kind] += len(ends)
    for kind in KINDS:
        shown = f"{missed[kind]} of {periods[kind]:,}; p99 {np.median(late[kind]) / 1e3:.0f} us after the tick"
        yield Target(f"missed periods, {kind}", "", shown, "")
    for kind in list(KINDS)[1:]:
        row = Row(kind, list(zip(late[kind], late[ALONE], strict=True)))
        low, high = row.interval
        shown = f"{np.median(row.ratios):.3f} ({low:.3f} to {high:.3f})"
        yield Target(f"p99 beside {kind}, to without", f"{LIMIT}", shown, "missed" if low > LIMIT else "")


def _block(devices: dict[str, tuple[str, float, str]]) -> tuple[Any, int]:
    """The times in ns from the tick to the end of each period of a block; the number of those missed."""
    ends: list[Any] = []
    missed = 0
    with umo.start(machine, _wiring(devices), application, acknowledge=True) as started:
        while started.frames is None and started.outcome is None:
            started.poll(0.1)
        if started.frames is None:
            raise RuntimeError(f"the machine did not start: {started.outcome}")
        begin, end = time.monotonic() + SETTLING, time.monotonic() + SETTLING + BLOCK
        while time.monotonic() < end:
            started.poll(0.02)
            frames = started.frames.read()
            if time.monotonic() >= begin:
                ends.append(frames["wake"] + frames["execution"])
                missed += int(np.maximum(frames["missed"] - 1, 0).sum())
        started.stop()
    return np.concatenate(ends), missed

"""A row of the table: one driver with a number of channels, and the bare library with the same channels."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Any

import numpy as np

from umo.drivers.contract import Channel, Driver

SIZES = (2, 13, 100)
"""Numbers of channels, inputs and outputs together."""
WARM_UP = 3
IN_KERNEL = os.environ.get("UMO_KERNEL") == "1"
"""This is the test kernel. Modules with `NEEDS_KERNEL` are measured there, the others outside of it."""


class NotHere(Exception):
    """The rows of this driver cannot be measured on this computer; says why in one sentence."""


@dataclass
class Case:
    """One row. A cycle reads all inputs and writes all outputs once.

    `by_hand` does a cycle with the bare library: the same channels, on an equal device, as a person would write it; the
    values read may be left in whatever form the library gives. It must raise if the device answers wrongly.
    """

    driver: str
    """The driver and its bus, such as "modbus, TCP"."""
    library: str
    """The bare library, such as "pymodbus"."""
    channels: int
    umo: Callable[[], object]
    """A cycle through the driver; `cycle` makes it."""
    by_hand: Callable[[], object]
    transfers: int | None
    """Transfers on the wire in a cycle of the driver, counted by the counterpart; None: no transfer, or not counted."""
    times: dict[str, list[float]] = field(default_factory=lambda: {"umo": [], "by_hand": []})
    """us for each cycle, by `measure`."""

    def measure(self, cycles: int) -> None:
        """Some cycles of either, each after some that are not counted: what ran before was another row."""
        for name, run in (("umo", self.umo), ("by_hand", self.by_hand)):
            for _ in range(WARM_UP):
                run()
            for _ in range(cycles):
                start = perf_counter_ns()
                run()
                self.times[name].append((perf_counter_ns() - start) * 1e-3)


def cycle(driver: Driver[Any], inputs: Sequence[Channel], outputs: Sequence[Channel]) -> Callable[[], None]:
    """A cycle of an open driver as the process image calls it; the outputs change from cycle to cycle."""
    inputs, outputs = tuple(inputs), tuple(outputs)
    read = np.zeros(len(inputs), np.int64)
    written = [np.full(len(outputs), value, np.int64) for value in (0, 1)]
    turn = 0

    def run() -> None:
        nonlocal turn
        turn = 1 - turn
        if inputs:
            driver.read_many(inputs, read)
        if outputs:
            driver.write_many(outputs, written[turn])

    return run


def without_clock(module: Any, stack: ExitStack) -> None:
    """The module's `monotonic` costs nothing. In user-mode Linux the clock is a system call of 25 us, as long as a
    transfer; elsewhere it takes 0.05 us."""
    stack.callback(setattr, module, "monotonic", module.monotonic)
    module.monotonic = float


@contextmanager
def counted(owner: Any, *names: str) -> Iterator[list[str]]:
    """The names of the calls of these functions of a class or module, within the block."""
    calls: list[str] = []
    kept = {name: getattr(owner, name) for name in names}

    def counting(name: str) -> Callable[..., object]:
        return lambda *arguments: (calls.append(name), kept[name](*arguments))[1]

    for name in kept:
        setattr(owner, name, counting(name))
    try:
        yield calls
    finally:
        for name, function in kept.items():
            setattr(owner, name, function)


def split(channels: int) -> tuple[int, int]:
    """How many inputs and outputs: half and half, of an odd number one input less."""
    return channels // 2, channels - channels // 2

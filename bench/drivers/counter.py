"""The kernel's interrupt-counter: its count is read, its `enable` is written; by hand: the same files, kept open. A
transfer is a system call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from bench.drivers.case import Case, NotHere, counted, cycle
from umo.drivers.counter import DEVICES, Counter

NEEDS_KERNEL = True


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    if channels > 2:
        raise NotHere("interrupt-counter has 2 channels")
    driver = Counter(device="counter0")
    stack.callback(driver.close)
    driver.open()
    count, enable = map(driver.channel, ("count:0", "enable:0"))
    driver.initialize(count, None)
    driver.initialize(enable, 0)
    run = cycle(driver, [count], [enable])
    with counted(os, "pread", "pwrite") as transfers:
        run()
    yield Case(
        "counter, interrupt-counter", "bare files", 2, run, _hand(DEVICES / "counter1/count0", stack), len(transfers)
    )


def _hand(folder: Path, stack: ExitStack) -> Callable[[], None]:
    count, enable = os.open(folder / "count", os.O_RDONLY), os.open(folder / "enable", os.O_WRONLY)
    for file in (count, enable):
        stack.callback(os.close, file)
    turn = 0

    def run() -> None:
        nonlocal turn
        turn = 1 - turn
        int(os.pread(count, 64, 0))
        os.pwrite(enable, b"%d" % turn, 0)

    return run

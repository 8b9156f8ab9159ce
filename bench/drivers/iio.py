"""The kernel's IIO dummy, without a trigger; by hand: its files in sysfs, kept open. A transfer is a system call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from bench.drivers.case import Case, NotHere, counted, cycle, without_clock
from umo.drivers.iio import Iio
from umo.drivers.iio import driver as timed
from umo.drivers.iio.sysfs import find

NEEDS_KERNEL = True
CONFIGFS = Path("/sys/kernel/config/iio/devices/dummy")
INPUTS, OUTPUT = ("in_voltage0", "in_voltage1-voltage2", "in_voltage3-voltage4", "in_accel_x"), "out_voltage0"


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    """Of 2 channels, and of all."""
    if channels > 13:
        raise NotHere("the IIO dummy has 5 channels")
    without_clock(timed, stack)
    inputs = INPUTS[: channels - 1]
    own, hand = names = (f"bench-own-{channels}", f"bench-hand-{channels}")
    for name in names:
        (CONFIGFS / name).mkdir()
        stack.callback((CONFIGFS / name).rmdir)
    driver = Iio(device=own)
    stack.callback(driver.close)
    driver.open()
    run = cycle(driver, list(map(driver.channel, inputs)), [driver.channel(OUTPUT)])
    with counted(os, "pread", "pwrite") as transfers:
        run()
    yield Case("iio, IIO dummy", "bare files", len(inputs) + 1, run, _hand(find(hand), inputs, stack), len(transfers))


def _hand(folder: Path, inputs: tuple[str, ...], stack: ExitStack) -> Callable[[], None]:
    read = [os.open(folder / f"{name}_raw", os.O_RDONLY) for name in inputs]
    written = os.open(folder / f"{OUTPUT}_raw", os.O_WRONLY)
    for file in (*read, written):
        stack.callback(os.close, file)
    turn = 0

    def run() -> None:
        nonlocal turn
        turn = 1 - turn
        [int(os.pread(file, 64, 0)) for file in read]
        os.pwrite(written, b"%d" % turn, 0)

    return run

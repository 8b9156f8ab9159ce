"""Lines of the kernel's gpio-sim; by hand: one request of gpiod for the inputs and one for the outputs. A transfer is a
system call."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import gpiod
from gpiod.line import Direction, Value

from bench.drivers.case import Case, counted, cycle, split
from tests.kernel.gpio_sim import Chip
from umo.drivers.gpio import Gpio

NEEDS_KERNEL = True


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    own, hand = (Chip(f"bench-{who}-{channels}", channels) for who in ("own", "hand"))
    for chip in (own, hand):
        stack.callback(chip.remove)
    run = _own(own, channels, stack)
    with counted(gpiod.LineRequest, "get_values", "set_values") as calls:
        run()
    yield Case("gpio, gpio-sim", "gpiod", channels, run, _hand(hand, channels, stack), len(calls))


def _own(chip: Chip, channels: int, stack: ExitStack) -> Callable[[], None]:
    inputs, _ = split(channels)
    driver = Gpio(chip=chip.path)
    stack.callback(driver.close)
    lines = [driver.channel(f"line:{number}") for number in range(channels)]
    driver.open()
    for number, line in enumerate(lines):
        driver.initialize(line, None if number < inputs else 0)
    return cycle(driver, lines[:inputs], lines[inputs:])


def _hand(chip: Chip, channels: int, stack: ExitStack) -> Callable[[], None]:
    inputs, _ = split(channels)
    read, written = tuple(range(inputs)), tuple(range(inputs, channels))
    source = gpiod.request_lines(chip.path, {read: gpiod.LineSettings(direction=Direction.INPUT)})
    sink = gpiod.request_lines(chip.path, {written: gpiod.LineSettings(direction=Direction.OUTPUT)})
    for request in (source, sink):
        stack.callback(request.release)
    levels = [[value] * len(written) for value in (Value.INACTIVE, Value.ACTIVE)]
    turn = 0

    def run() -> None:
        nonlocal turn
        turn = 1 - turn
        source.get_values()
        sink.set_values(dict(zip(written, levels[turn], strict=True)))

    return run

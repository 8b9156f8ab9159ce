"""Lines of the kernel's gpio-sim; by hand: one request of gpiod for the inputs and one for the outputs. A transfer is a
system call. In the test kernel only: tests/kernel/boot python -m bench --drivers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import gpiod
from gpiod.line import Direction, Value
from tests.kernel.gpio_sim import Chip

from bench.drivers.case import Case, NotHere, cycle, split
from umo.drivers.gpio import Gpio


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    if os.environ.get("UMO_KERNEL") != "1":
        raise NotHere("it needs the test kernel: tests/kernel/boot python -m bench --drivers")
    own, hand = (Chip(f"bench-{who}-{channels}", channels) for who in ("own", "hand"))
    for chip in (own, hand):
        stack.callback(chip.remove)
    run = _own(own, channels, stack)
    with _counted() as calls:
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


@contextmanager
def _counted() -> Iterator[list[str]]:
    """The names of the transfers that gpiod makes."""
    calls: list[str] = []
    kept = {name: getattr(gpiod.LineRequest, name) for name in ("get_values", "set_values")}

    def counting(name: str) -> Callable[..., object]:
        return lambda *arguments: (calls.append(name), kept[name](*arguments))[1]

    for name in kept:
        setattr(gpiod.LineRequest, name, counting(name))
    try:
        yield calls
    finally:
        for name, function in kept.items():
            setattr(gpiod.LineRequest, name, function)


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

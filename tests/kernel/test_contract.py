"""The conformance kit on the drivers gpio and counter."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from umo.drivers.counter import Counter
from umo.drivers.gpio import Gpio

from .gpio_sim import Chip, Trace, connected, fixed

kit = pytest.importorskip("umo.testing.conformance")
CYCLES = 600
"""tracemalloc makes a cycle 100 times slower in the guest; test_gpio.py repeats 15,000 without it."""


def proved(subject: Any) -> None:
    certificate = kit.conform(subject, cycles=CYCLES)
    if folder := os.environ.get("UMO_KERNEL_RESULTS"):
        certificate.save(Path(folder))
    print(certificate)
    assert certificate.passed, certificate


class Recorder:
    """The levels that the outputs of a chip had, from the kernel's trace."""

    def __init__(self, chip: Chip, trace: Trace, outputs: Mapping[str, tuple[int, ...]]) -> None:
        self._chip, self._trace, self._outputs = chip, trace, outputs
        self._seen: dict[str, list[int]] = {text: [self._now(text)] for text in outputs}

    def _now(self, text: str) -> int:
        return sum(self._chip.line(line).value << i for i, line in enumerate(self._outputs[text]))

    def levels(self, text: str) -> list[int]:
        """Since the last call. Of a group the first and the last: its lines change one after the other, within one call
        of the kernel."""
        events = self._trace.taken()
        for other, lines in self._outputs.items():
            if len(lines) == 1:
                self._seen[other] += [int(what[-1]) for line, what in events if line == lines[0] and what[:3] == "set"]
        levels, now = self._seen[text], self._now(text)
        self._seen[text] = [now]
        return levels if levels[-1] == now else [*levels, now]


def test_gpio_keeps_the_contract(gpio_chip: Callable[..., Chip]) -> None:
    chip = gpio_chip(lines=16, names={3: "PUMP"}, hogs={15: "kernel"})
    outputs = {"line:0": (0,), "line:1": (1,), "lines:4-7": (4, 5, 6, 7)}

    @contextmanager
    def gone() -> Iterator[None]:
        chip.go()
        try:
            yield
        finally:
            chip.come()

    with Trace(chip.label) as trace, connected(chip, {0: 2, 1: 3, 4: 8, 5: 9, 6: 10, 7: 11}):
        proved(
            kit.Subject(
                name="gpio",
                make=lambda: Gpio(chip=chip.label),
                device="gpio-sim of Linux 6.12",
                outputs=(
                    kit.Output("line:0", default=0, least=0, greatest=1),
                    kit.Output("line:1", default=1, least=0, greatest=1),
                    kit.Output("lines:4-7", default=5, least=0, greatest=15),
                ),
                inputs=(
                    kit.Input("line:2", steady=False),
                    kit.Input("line:PUMP", steady=False),
                    kit.Input("lines:8-11", steady=False),
                    kit.Input("edges:12:both"),
                ),
                loopbacks=(("line:0", "line:2"), ("line:1", "line:PUMP"), ("lines:4-7", "lines:8-11")),
                gone=gone,
                levels=Recorder(chip, trace, outputs).levels,
            )
        )


def test_counter_keeps_the_contract() -> None:
    driver = Path("/sys/bus/platform/drivers/interrupt-cnt")
    fixed(0).pull(0)

    @contextmanager
    def gone() -> Iterator[None]:
        (driver / "unbind").write_text("counter-0")
        try:
            yield
        finally:
            (driver / "bind").write_text("counter-0")

    proved(
        kit.Subject(
            name="counter",
            make=lambda: Counter(device="counter-0", bits=31),
            device="interrupt-counter of Linux 6.12 on gpio-sim",
            outputs=(kit.Output("enable:0", default=0, least=0, greatest=1),),
            inputs=(kit.Input("count:0"),),
            refused=("preset:0",),
            gone=gone,
        )
    )

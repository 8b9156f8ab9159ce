"""The conformance kit on the drivers gpio and counter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from umo.drivers.counter import Counter
from umo.drivers.gpio import Gpio
from umo.testing.conformance import Input, Output, Subject

from .gpio_sim import Chip, Trace, connected, fixed
from .proof import proved


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
            Subject(
                name="gpio",
                make=lambda: Gpio(chip=chip.label),
                device="gpio-sim of Linux 6.12",
                outputs=(
                    Output("line:0", default=0, least=0, greatest=1),
                    Output("line:1", default=1, least=0, greatest=1),
                    Output("lines:4-7", default=5, least=0, greatest=15),
                ),
                inputs=(
                    Input("line:2", steady=False),
                    Input("line:PUMP", steady=False),
                    Input("lines:8-11", steady=False),
                    Input("edges:12:both"),
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
        Subject(
            name="counter",
            make=lambda: Counter(device="counter-0", bits=31),
            device="interrupt-counter of Linux 6.12 on gpio-sim",
            outputs=(Output("enable:0", default=0, least=0, greatest=1),),
            inputs=(Input("count:0"),),
            refused=("preset:0",),
            gone=gone,
        )
    )

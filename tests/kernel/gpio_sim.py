"""Simulated GPIO chips of the kernel (gpio-sim): made, driven and seen without the driver under test.

An input is driven by the `pull` of its line; the level of an output is seen in its `value`. Source:
Documentation/admin-guide/gpio/gpio-sim.rst of the Linux kernel. Every change of any line is seen in the kernel's trace.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from time import sleep

CONFIGFS = Path("/sys/kernel/config/gpio-sim")
TRACING = Path("/sys/kernel/tracing")
TICK = 0.012
"""s. User-mode Linux passes an interrupt of the simulator on at its next tick, 100 times a second; until then further
edges of the line are one with it."""
POLL = 0.002
"""s between two looks of the process that copies levels."""


class Line:
    """One line, seen from the circuit's side."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def pull(self, level: int) -> None:
        """The level that an input sees."""
        (self.folder / "pull").write_text("pull-up" if level else "pull-down")

    @property
    def pulled(self) -> int:
        return int((self.folder / "pull").read_text() == "pull-up\n")

    @property
    def value(self) -> int:
        """The level on the line: an output's, or the pull."""
        return int((self.folder / "value").read_text())

    def pulse(self, times: int = 1) -> None:
        """Rising and falling edges, each of which makes an interrupt."""
        for _ in range(times):
            for level in (1, 0):
                self.pull(level)
                sleep(TICK)


class Chip:
    """One chip; `device` is its folder in configfs. `go` and `come` take it away and bring it back, as a plug does."""

    def __init__(
        self,
        name: str,
        lines: int,
        names: Mapping[int, str] = {},
        hogs: Mapping[int, str] = {},
        label: str = "",
    ) -> None:
        self.device = CONFIGFS / name
        self.device.mkdir()
        self._bank = self.device / "bank0"
        self._bank.mkdir()
        self.label = label or name
        self.count = lines
        (self._bank / "num_lines").write_text(str(lines))
        (self._bank / "label").write_text(self.label)
        for number in names.keys() | hogs.keys():
            (self._bank / f"line{number}").mkdir()
        for number, text in names.items():
            (self._bank / f"line{number}" / "name").write_text(text)
        for number, consumer in hogs.items():  # lines that a driver of the kernel uses
            hog = self._bank / f"line{number}" / "hog"
            hog.mkdir()
            (hog / "name").write_text(consumer)
            (hog / "direction").write_text("input")
        self.come()

    def come(self) -> None:
        (self.device / "live").write_text("1")

    def go(self) -> None:
        (self.device / "live").write_text("0")

    @property
    def path(self) -> str:
        """Its device file, such as /dev/gpiochip1."""
        return "/dev/" + (self._bank / "chip_name").read_text().strip()

    def line(self, number: int) -> Line:
        return _line(self.device, number)

    def levels(self) -> list[int]:
        return [self.line(number).value for number in range(self.count)]

    def remove(self) -> None:
        if (self.device / "live").read_text().strip() == "1":
            self.go()
        for folder in sorted(self._bank.glob("line*/hog")) + sorted(self._bank.glob("line*")):
            if folder.is_dir():
                folder.rmdir()
        self._bank.rmdir()
        self.device.rmdir()


def _line(device: Path, number: int) -> Line:
    """A line of a chip of configfs. A chip that comes back while a driver still holds it is another one to the kernel,
    with another folder."""
    platform = (device / "dev_name").read_text().strip()
    chip = (device / "bank0" / "chip_name").read_text().strip()
    return Line(Path(f"/sys/devices/platform/{platform}/{chip}/sim_gpio{number}"))


@contextmanager
def connected(chip: Chip, wires: Mapping[int, int]) -> Iterator[None]:
    """Wires from outputs to inputs of a chip: a level comes through within some ms, also after the chip was away. A
    process of its own, so that it does not share the interpreter with the driver under test."""
    numbers = [str(number) for wire in wires.items() for number in wire]
    with subprocess.Popen([sys.executable, __file__, str(chip.device), *numbers]) as process:
        try:
            yield
        finally:
            process.kill()


def _copy(device: Path, wires: Sequence[tuple[int, int]]) -> None:
    while True:
        sleep(POLL)
        with suppress(OSError, ValueError), ExitStack() as files:  # the chip is away
            _copy_until_it_goes(
                [
                    (files.enter_context((_line(device, output).folder / "value").open("rb", 0)), _line(device, line))
                    for output, line in wires
                ]
            )


def _copy_until_it_goes(pairs: Sequence[tuple[FileIO, Line]]) -> None:
    """The files stay open: those of a chip that was away cannot be read any more, also if it came back at once under
    the same name."""
    levels: dict[Line, bytes] = {}
    while True:
        for output, line in pairs:
            if (level := os.pread(output.fileno(), 1, 0)) != levels.get(line):
                line.pull(int(level))
                levels[line] = level
        sleep(POLL)


def fixed(number: int) -> Line:
    """A line of the chip in the kernel's device tree (devices.dts)."""
    (chip,) = (path.parent for path in Path("/sys/devices/platform/gpio-sim").glob("gpiochip*/sim_gpio0"))
    return Line(chip / f"sim_gpio{number}")


class Trace:
    """What the drivers of the kernel did to the lines of a chip within the block, as the kernel's trace tells it."""

    def __init__(self, label: str) -> None:
        chips = Path("/sys/class/gpio").glob("gpiochip*")
        self._base = next(int(path.name[8:]) for path in chips if (path / "label").read_text().strip() == label)

    def __enter__(self) -> Trace:
        (TRACING / "trace").write_text("")
        (TRACING / "events/gpio/enable").write_text("1")
        return self

    def __exit__(self, *_: object) -> None:
        (TRACING / "events/gpio/enable").write_text("0")

    def events(self) -> list[tuple[int, str]]:
        """The line with "set 0", "set 1", "get 0", "get 1", "in" or "out", in order."""
        found = re.findall(
            r": gpio_(?:value|direction): +(\d+) +(set \d|get \d|in|out)", (TRACING / "trace").read_text()
        )
        return [(int(number) - self._base, what) for number, what in found if int(number) >= self._base]

    def taken(self) -> list[tuple[int, str]]:
        """The events since the last call. The kernel keeps the last ones only, some thousands."""
        events = self.events()
        (TRACING / "trace").write_text("")
        return events


if __name__ == "__main__":
    numbers = list(map(int, sys.argv[2:]))
    _copy(Path(sys.argv[1]), list(zip(numbers[::2], numbers[1::2], strict=True)))

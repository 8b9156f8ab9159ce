"""Emulated boards that run a generated controller: a period is a line in, and a line out."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from helpers.peers.text_devices import CannotRun, simavr_flags

PEERS = Path(__file__).parent / "peers" / "controllers"
TOOLS = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi and libnewlib-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "avr-gcc": "gcc-avr and avr-libc",
    "simavr": "simavr",
    "cc": "gcc",
    "pkg-config": "pkg-config",
    "make": "make",
}
"""Debian's package of each tool."""
M3 = {"CPU": "-mcpu=cortex-m3 -mthumb"}
M4F = {"CPU": "-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16"}
MEASURED = "-DUMO_MEASURE"


def need(*tools: str) -> None:
    """Raises CannotRun, with the package to install."""
    for tool in tools:
        if shutil.which(tool) is None:
            raise CannotRun(f"a test of boards needs {tool}: Debian's {TOOLS[tool]}")


def firmware(folder: Path, **variables: str) -> Path:
    """The trial of a generated folder. Warnings are errors."""
    shutil.copy(PEERS / "trial.c", folder)
    given = [f"{name}={value}" for name, value in variables.items()]
    trial = f"TRIAL={variables.get('TRIAL', MEASURED)} -Werror"
    subprocess.run(["make", "-s", "-C", folder, "trial.elf", *given, "MAIN=trial.c", trial], check=True)
    return folder / "trial.elf"


@dataclass
class Trial:
    """A controller on a board: takes the raw integers of a period, and gives those of the outputs."""

    process: subprocess.Popen[bytes]
    cycles: list[int] = field(default_factory=list)
    """The cycles of the processor that each step took; of an emulated Arm those of a clock of 25 MHz at which an
    instruction takes 32 ns."""

    def step(self, ticks: int, raws: Sequence[int], failed: Sequence[bool]) -> tuple[int, list[int]]:
        """The fault, and the raw integers of the outputs."""
        words, _, cycles = self._said(ticks, raws, failed).partition("; ")
        fault, *outputs = map(int, words.split())
        self.cycles.append(int(cycles))
        return fault, outputs

    def acknowledge(self, raws: Sequence[int], failed: Sequence[bool]) -> None:
        """What is latched is acknowledged, between two periods."""
        self._said(0, raws, failed)

    def _said(self, ticks: int, raws: Sequence[int], failed: Sequence[bool]) -> str:
        each = ["x" if no else str(raw) for raw, no in zip(raws, failed, strict=True)]
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(f"{ticks} {' '.join(each)}\n".encode())
        self.process.stdin.flush()
        return self.process.stdout.readline().decode()


@contextmanager
def emulated(*command: str | Path) -> Iterator[Trial]:
    """A board with its serial port on standard input and output."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            yield Trial(process)
        finally:
            process.kill()


def mps2(elf: Path, board: str = "mps2-an385") -> list[str | Path]:
    """The command of an emulated Arm MPS2 board, on which an instruction takes 32 ns."""
    clock = ["-icount", "shift=5,align=off,sleep=off"]
    port = ["-display", "none", "-monitor", "none", "-serial", "stdio"]
    return ["qemu-system-arm", "-M", board, *clock, *port, "-kernel", elf]


def avr(elf: Path, folder: Path) -> list[str | Path]:
    """The command of an emulated ATmega328P; it is compiled into the folder. Raises CannotRun."""
    flags = simavr_flags()
    board = folder / "board"
    warnings = ["-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", "-O2", *warnings, "-o", board, PEERS / "avr.c", *flags], check=True)
    return [board, elf]

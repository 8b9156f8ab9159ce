"""Generated controllers on emulated boards: the cycles of a period, the memory they take, and whether they command what
Python commands, over random periods with missed ticks and channels that fail.

An emulated AVR counts the cycles of the processor. An emulated Arm counts instructions: at 32 ns each, as if a clock of
31.25 MHz took one for each.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from bench.report import Doing, Target

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the helpers import one another from there

TITLE = "Generated controllers on emulated boards"
CASE_TAKES = 8.0
"""Time in s, about, of a machine on a board."""
PERIODS = 2_000
SIZES = {"avr": "avr-size", "cortex-m": "arm-none-eabi-size"}
PER_CYCLE = {"avr": 1.0, "cortex-m": 32.0 * 25e6 / 1e9}
"""Ticks of the counter of the board for a cycle, or for an instruction."""


def takes() -> float:
    from helpers.controllers import TRIALS

    return CASE_TAKES * len(TRIALS)


def measure(doing: Doing) -> Iterator[Target]:
    """A row for each machine on each board."""
    from helpers.controllers import BOARDS, MACHINES, TRIALS
    from helpers.peers.text_devices import CannotRun

    logging.disable()  # every interlock and fault would be told
    for board, name in TRIALS:
        doing(f"{name} on {board}")
        try:
            yield _row(name, board, BOARDS[board], MACHINES[name])
        except CannotRun as error:
            yield Target(f"{board}: {name}", "-", str(error), "not run")


def _row(name: str, board: str, kind: object, tried: object) -> Target:
    from helpers.controllers import command_of, run_beside

    with tempfile.TemporaryDirectory() as folder:
        command = command_of(kind, tried, Path(folder))
        flash, ram = _size(Path(folder), kind.target, board)
        ran = run_beside(tried, command, kind.allowed, PERIODS)
    cycles = [each / PER_CYCLE[kind.target] for each in ran.cycles]
    unit = "cycles" if kind.target == "avr" else "instructions"
    text = f"{median(cycles):,.0f} {unit}, at most {max(cycles):,.0f}; flash {flash:,} B, RAM {ram:,} B"
    equal = "to the bit" if ran.differ == 0 else f"{ran.differ} of {PERIODS:,} periods by one raw step"
    return Target(f"{board}: {name}", "-", text, equal)


def _size(folder: Path, target: str, board: str) -> tuple[int, int]:
    """Flash and static RAM in bytes of the controller with `main.c` and an empty board."""
    from helpers.boards import M3, M4F

    given = {"Cortex-M3": M3, "Cortex-M4F": M4F}.get(board.split()[0], {})
    make = ["make", "-s", "-C", str(folder), "machine.elf", *(f"{name}={value}" for name, value in given.items())]
    subprocess.run(make, check=True)
    said = subprocess.run([SIZES[target], folder / "machine.elf"], check=True, capture_output=True, text=True)
    text, data, bss = map(int, said.stdout.splitlines()[1].split()[:3])
    return text + data, data + bss

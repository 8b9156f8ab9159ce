"""The rows of drivers for interfaces of the kernel, measured in the test kernel (tests/kernel) if it is built."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.drivers.table import Figures, from_json

FOLDER = Path(__file__).parents[2] / "tests" / "kernel"
COMMAND = "tests/kernel/boot python -m bench --drivers"


def measured(names: list[str], quick: bool) -> tuple[list[Figures], list[str]]:
    """The rows, and one line if they are missing."""
    listed = ", ".join(names)
    if subprocess.run([FOLDER / "build", "--is-built"], capture_output=True).returncode:
        return [], [f"{listed}: not measured: they need the test kernel: make kernel, then {COMMAND}"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "rows.json")
        words = [FOLDER / "boot", sys.executable, "-m", "bench", "--drivers", "--json", file, *["--quick"] * quick]
        done = subprocess.run(words, env=os.environ | {"UMO_KERNEL_RESULTS": folder}, capture_output=True, text=True)
        if done.returncode:
            why = (done.stderr or done.stdout).strip().rpartition("\n")[2]
            return [], [f"{listed}: not measured: {COMMAND} failed: {why}"]
        found = json.loads(file.read_text())
    return from_json(found["drivers"]), found["missing"]

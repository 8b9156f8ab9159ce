"""The cells of the file that box, machine and campaign map: 64-bit integers. `box.c` has the first part of the list."""

from __future__ import annotations

import mmap
import os
from typing import Any

PORT, FAULT, VALUE, UNTIL, REQUESTS, MET = range(6)
CONTROL, GUARDIAN, PERIODS, WRONG, MAX_AGE = range(6, 11)
"""Reports of the machine: the pids of its control process and of that one's parent, the periods in which it wrote its
outputs, and how many readings were good and yet not the box's, or older than `MAX_AGE`, in ms."""
CLOCK = 8_000_000
"""ns for each count of the box's clock, its last input register."""
NAME, OUTPUT, CELLS = 12, 16, 64
FILE = "KILLS_BOX"
"""The environment variable that names the file."""
KEPT = "KILLS_KEPT"
"""The one that is set where the machine has kept numbers: to `OPERATED` where it has all that can be kept."""
OPERATED = "operated"


def cells() -> Any:
    """The cells of this machine's box."""
    with open(os.environ[FILE], "r+b") as file:
        return memoryview(mmap.mmap(file.fileno(), 8 * CELLS)).cast("q")

"""Runs for so many periods, or until it is stopped. Tells the campaign which processes run it."""

from __future__ import annotations

import os

from umo.control import until

from .cells import CONTROL, GUARDIAN, PERIODS, cells
from .objects import Machine


async def main(m: Machine, periods: int = 0) -> None:
    m.cells = cells()
    m.cells[GUARDIAN] = os.getppid()
    m.cells[CONTROL] = os.getpid()
    await until(lambda: periods > 0 and m.cells[PERIODS] >= periods)

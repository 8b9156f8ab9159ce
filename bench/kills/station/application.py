"""Runs for so many periods, or until it is stopped; after so many it forks, or loops for ever. Tells the campaign which
processes run it."""

from __future__ import annotations

import os

from umo.control import until

from .cells import CONTROL, GUARDIAN, PERIODS, cells
from .objects import Machine


async def main(m: Machine, periods: int = 0, fork: int = 0, loop: int = 0) -> None:
    m.cells = cells()
    m.cells[GUARDIAN] = os.getppid()
    m.cells[CONTROL] = os.getpid()
    m.begin()
    await until(lambda: m.cells[PERIODS] >= (fork or loop or periods) > 0)
    if fork:
        os.fork()  # the child goes on with all that follows
        await until(lambda: False)
    while loop:
        pass

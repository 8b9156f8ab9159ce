"""The journal of a machine: what it has at the end of each period, in memory that outlives it, for the campaign.

It is read from the machine itself, not from its frames: numbers, states of units, states of alarms.
"""

from __future__ import annotations

import json
import mmap
import os
from enum import EnumMeta
from pathlib import Path
from time import monotonic
from typing import Any

from umo import Compound, Frame
from umo.objects import numbers_of
from umo.objects.laws import laws_in
from umo.objects.numbers import MachineNumber, number_in
from umo.operation.alarms.alarming import engine_of
from umo.operation.unit_states import UnitStates

FILE = "KILLS_JOURNAL"
"""The environment variable that names the file."""
ROWS, COLUMNS = 4096, 128
"""Rows of the file, the first one apart; 64-bit floats of a row."""
NUMBER, MOMENT, FIRST = 0, 1, 2
"""Columns of a row: the number of the period, 0: not whole; CLOCK_MONOTONIC in s; from the third on the values of which
the names are in the file beside it."""
SIZE = 8 * COLUMNS * (ROWS + 1)
TAKEN_OVER = 0
"""The first row: what the machine has taken over from its last run, before it changes any of it."""


class Journal:
    """An observer that writes one row for each period."""

    def __init__(self, root: Compound) -> None:
        self._numbers = {path: each for path, each in numbers_of(root).items() if each.declared.kept}
        self._units = {path: law for _, path, law in laws_in(root) if isinstance(law, UnitStates)}
        self._alarms: Any = engine_of(root._machine.whole)  # type: ignore[attr-defined]
        file = Path(os.environ[FILE])
        names = {"numbers": [*self._numbers], "states": [*self._units], "alarms": self._alarms.paths}
        file.with_suffix(".json").write_text(json.dumps(names))
        with file.open("r+b") as opened:
            self._cells = memoryview(mmap.mmap(opened.fileno(), SIZE)).cast("d")
        self._write(TAKEN_OVER, 1)

    def __call__(self, frame: Frame) -> None:
        self._write(1 + frame.number % ROWS, frame.number)

    def _write(self, row: int, number: int) -> None:
        values = [_number(each) for each in self._numbers.values()]
        values += [float(unit.state) for unit in self._units.values()]
        values += self._alarms.states.tolist()
        cells, at = self._cells, row * COLUMNS
        cells[at + NUMBER] = 0.0
        cells[at + MOMENT] = monotonic()
        for place, value in enumerate(values, at + FIRST):
            cells[place] = value
        cells[at + NUMBER] = float(number)


def _number(each: MachineNumber) -> float:
    """Of an Enum the place of its member."""
    value = each.value
    return float(number_in(each.kind, value) if isinstance(each.kind, EnumMeta) else value)

"""What is kept over a restart: whether it is one moment of the run, not too long ago, and what the next run takes."""

from __future__ import annotations

import json
import mmap
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

from bench.kills.station.journal import COLUMNS, FIRST, MOMENT, NUMBER, ROWS, SIZE, TAKEN_OVER
from umo.operation.alarms.alarm_states import SHELVED_STATES
from umo.process import kept_file
from umo.process.kept_file import KeptValues
from umo.states import OnOff

MAX_LATE = 200
"""Periods of 5 ms between the last one and that of the kept values at most."""
MAX_AGE = 1.0
"""s: the age of what is kept at most, where every process is killed at once, beside the time of a slow disk."""
CALLS = 10
"""The calls of a disk of each write, about."""
MOST_SAID = 200
"""Characters of what is wrong at most."""
Row = dict[str, dict[str, float]]


def file_in(folder: Path) -> Path | None:
    """The file of kept values of a run in this folder; None: there is none."""
    return next(iter(folder.glob("state/*/kept/*.json")), None)


def read(folder: Path) -> KeptValues | str | None:
    """What is kept, or what is wrong with the file; None: nothing was kept."""
    if (file := file_in(folder)) is None:
        return None
    try:
        return kept_file.read(file)
    except kept_file.KeptFileError as error:
        return f"the file of kept values: {error}"


# A machine whose kept numbers are all functions of one ------------------------------------------------------


def wrong_numbers(values: KeptValues | str | None, periods: int, keeper_killed: bool) -> str:
    """What is wrong with what is kept of `Keeping`; "": nothing."""
    if values is None:
        return "" if keeper_killed and periods <= MAX_LATE else "nothing was kept"
    if isinstance(values, str):
        return values
    found = {path: entry["value"] for path, entry in values.numbers.items()}
    count = int(found["count"])
    odd = count % 2 == 1
    one_moment = {"count": count, "double": 2.0 * count, "odd": odd, "state": "ON" if odd else "OFF"}
    if found != one_moment:
        return f"kept values of several moments: {found}"
    late = periods - count
    return f"kept values of {late} periods before the end" if late > MAX_LATE else ""


# A machine with a journal -----------------------------------------------------------------------------------


class Journal:
    """The journal of an operated machine, as the campaign reads it."""

    def __init__(self, file: Path) -> None:
        self.file = file
        file.write_bytes(bytes(SIZE))
        with file.open("r+b") as opened:
            self._map = mmap.mmap(opened.fileno(), SIZE)
        self._cells = memoryview(self._map).cast("d")

    def close(self) -> None:
        self._cells.release()
        self._map.close()

    @property
    def begun(self) -> bool:
        return bool(self._cells[TAKEN_OVER * COLUMNS + NUMBER])

    @property
    def taken_over(self) -> Row:
        """What the run has taken over from the one before."""
        return self._sections(TAKEN_OVER)

    def last(self) -> tuple[int, float]:
        """Number and moment of the last period that is whole."""
        cells = self._cells
        return max((int(cells[row * COLUMNS + NUMBER]), cells[row * COLUMNS + MOMENT]) for row in range(1, ROWS + 1))

    def first_moment(self) -> float:
        return self._cells[TAKEN_OVER * COLUMNS + MOMENT]

    def at(self, number: int) -> tuple[float, Row] | None:
        """Moment and content of a period; None: it is not there."""
        row = 1 + number % ROWS
        if self._cells[row * COLUMNS + NUMBER] != number:
            return None
        return self._cells[row * COLUMNS + MOMENT], self._sections(row)

    def _sections(self, row: int) -> Row:
        names = json.loads(self.file.with_suffix(".json").read_text())
        rest = iter(self._cells[row * COLUMNS + FIRST : (row + 1) * COLUMNS].tolist())
        return {section: {path: next(rest) for path in paths} for section, paths in names.items()}


def age(values: KeptValues | str | None, journal: Journal) -> float:
    """s from the period of what is kept to the last one; 0 where there is no such."""
    found = journal.at(values.period) if isinstance(values, KeptValues) else None
    return 0.0 if found is None else journal.last()[1] - found[0]


def wrong_moment(values: KeptValues | str | None, journal: Journal, allowed: float) -> str:
    """What is wrong with what is kept of an operated machine. `allowed`: the age in s that it may have; 0: it is of the
    last period."""
    if not journal.begun:
        return ""
    last, moment = journal.last()
    if values is None:
        return "" if not last or moment - journal.first_moment() < allowed else "nothing was kept"
    if isinstance(values, str):
        return values
    if (found := journal.at(values.period)) is None:
        return f"kept values of the period {values.period}, which the machine did not have"
    _, expected = found
    if wrong := _difference(_of_file(values), expected, stops=last - values.period <= 1):
        return f"kept values are not those of their period: {wrong}"
    if allowed:
        old = age(values, journal)
        return f"kept values {old:.2f} s old" if old > allowed else ""
    return f"kept values of {last - values.period} periods before the last" if last - values.period > 1 else ""


def wrong_start(values: KeptValues | str | None, journal: Journal) -> str:
    """What the next run has not taken over."""
    if values is None or isinstance(values, str):
        return ""
    expected = _of_file(values)
    alarms = {path: 0.0 if state in SHELVED_STATES else state for path, state in expected["alarms"].items()}
    found = journal.taken_over
    wrong = _difference({"numbers": expected["numbers"], "alarms": alarms, "states": {}}, {**found, "states": {}})
    return f"the next run has not taken over: {wrong}" if wrong else ""


def _of_file(values: KeptValues) -> dict[str, Any]:
    """As a row of the journal: states by their names still."""
    numbers = {path: _number(entry["value"]) for path, entry in values.numbers.items()}
    return {"numbers": numbers, **{name: values.sections.get(name, {}) for name in ("alarms", "states")}}


def _number(value: Any) -> float:
    if isinstance(value, str):
        return float([*OnOff].index(OnOff[value]))
    return float("nan") if value is None else float(value)


def _difference(found: Mapping[str, Mapping[str, Any]], expected: Row, stops: bool = False) -> str:
    """The values that are not the same, in words; "": all are. `stops`: the run may have been stopped between the two
    looks at this period, from when on a unit says that it is stopped."""
    from umo.operation import PackMLState, ProcedureState
    from umo.operation.model import title

    told = []
    for section, row in expected.items():
        there = found[section]
        for path in sorted({*row, *there}):
            wanted: Any = row.get(path)
            if section == "states" and wanted is not None:
                wanted = title((PackMLState if path.startswith("filler") else ProcedureState)(int(wanted)))
                if stops and "stopped" in (wanted, there.get(path)):
                    continue
            if there.get(path, 0.0 if section == "alarms" else None) != wanted:
                told.append(f"{section} {path} {there.get(path)} in place of {wanted}")
    return ", ".join(told)[:MOST_SAID]


# A power cut ------------------------------------------------------------------------------------------------


def cut_power(folder: Path, certain: Path, moments: Random) -> None:
    """Leave of the file of kept values what a power cut may leave: what was synced, or what was written, and any
    beginning of the file that was being written."""
    for new in folder.glob("state/*/kept/.*.new"):
        new.write_bytes(new.read_bytes()[: moments.randrange(1 + new.stat().st_size)])
    if moments.random() < 0.25:  # everything came to the disk
        return
    for file in folder.glob("state/*/kept/*.json"):
        file.unlink()
        if (synced := certain / file.name).exists():
            file.write_bytes(synced.read_bytes())

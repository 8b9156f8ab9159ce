"""Recorded responses: the trace of a run (CSV), or a recording (MCAP)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.errors import OptionError, PathError
from umo.objects.quality import NOT_GOOD, is_good
from umo.objects.scaling import FloatArray
from umo.system.packages import how_to_install
from umo.text import did_you_mean

TIME = "time_s"
"""The column of the time in a trace."""


def recorded_response(
    file: Path, columns: Sequence[str], start: float | None = None, stop: float | None = None
) -> MeasuredResponse:
    """Return the response between these times in s, from these columns (`LawFacts.columns`). Samples with a value that
    is not GOOD are left out. Raises OptionError if the file cannot be read. Raises PathError for an object that the
    file does not contain. Raises RangeError if there are too few samples."""
    if not file.is_file():
        raise OptionError(f"--file {file}: {'is a folder' if file.is_dir() else 'there is no such file'}")
    low, high = -np.inf if start is None else start, np.inf if stop is None else stop
    if file.suffix == ".mcap":
        return MeasuredResponse.of_rows(_of_recording(file, columns, low, high))
    rows = _of_trace(file, columns)
    return MeasuredResponse.of_rows(rows[(rows[:, 0] >= low) & (rows[:, 0] <= high)])


def _of_trace(file: Path, paths: Sequence[str]) -> FloatArray:
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            heads = next(csv.reader(lines), [])
            columns = {head.partition("[")[0]: place for place, head in enumerate(heads)}
            if TIME not in columns:
                raise OptionError(f"--file {file}: the file is not a trace of a run: it has no column {TIME}")
            places = [columns[TIME], *(_place(columns, each, file) for each in paths)]
            marks = columns.get(NOT_GOOD)
            rows = [
                [row[place] for place in places]
                for row in csv.reader(lines)
                if len(row) == len(heads) and (marks is None or all(is_good(row[marks], each) for each in paths))
            ]
            return np.array(rows, np.float64).reshape(-1, len(places))
    except (OSError, UnicodeError, ValueError, csv.Error) as error:
        raise OptionError(f"--file {file}: the file cannot be read: {error}") from None


def _place(columns: dict[str, int], path: str, file: Path) -> int:
    if path not in columns:
        raise PathError(f"{file} has no {path}{did_you_mean(path, columns)}")
    return columns[path]


def _of_recording(file: Path, paths: Sequence[str], start: float, stop: float) -> FloatArray:
    try:
        from umo.recording.recording import Recording
        from umo.recording.tables.recorded_values import RecordedValues
    except ImportError:
        raise OptionError(f"a recording needs mcap: {how_to_install('record')}") from None
    with Recording(file) as recording:
        values = RecordedValues(recording, paths, start, float(np.nextafter(stop, np.inf)))
        rows = [np.column_stack([frames["time"], values.good(frames)]) for frames, _ in values.parts()]
    return np.concatenate([np.empty((0, 1 + len(paths))), *rows])

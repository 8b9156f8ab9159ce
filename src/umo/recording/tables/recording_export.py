"""Exports a recording as a file of another kind: Parquet, CSV or NumPy. The file is written completely or not at
all."""

from __future__ import annotations

import csv
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from umo.errors import FramesError, OptionError
from umo.objects.quality import NOT_GOOD, told_not_good
from umo.recording.tables.recorded_values import RecordedValues, TellTime
from umo.system.folders import replaced
from umo.text import reason_of

SUFFIXES = (".parquet", ".csv", ".npz")
BEFORE = ("time_s", "utc", "missed", "execution_us")
"""The columns of a CSV file that stand before those of objects and signals."""
PIECE_ROWS = 4096
"""Number of rows that are formatted in one step."""


def export(values: RecordedValues, path: Path, progress: TellTime) -> int:
    """Write the values in the format of the suffix. Return the number of periods. Raises FramesError if the file cannot
    be written, and ImportError for Parquet without pyarrow."""
    if path.suffix not in SUFFIXES:
        raise OptionError(f"{path.name}: the suffix must be one of {', '.join(SUFFIXES)}")
    if path.exists() and path.samefile(values.recording.path):
        raise OptionError(f"{path} is the recording itself")
    write = _write_csv if path.suffix == ".csv" else _write_npz if path.suffix == ".npz" else _write_parquet
    with replacing(path) as file:
        return write(values, file, progress)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Return a context with a new file next to a path, which replaces the file at that path when it is complete. Raises
    FramesError if the new file cannot be created."""
    try:
        with replaced(path) as file:
            yield file
    except OSError as error:
        raise FramesError(f"{path} could not be written: {reason_of(error)}") from None


# CSV -------------------------------------------------------------------------------------------------------


def _write_csv(values: RecordedValues, file: Path, progress: TellTime) -> int:
    forms = ["{}", "{}", "{}", "{:.3f}", *(each.file_form if each.is_object else "{}" for each in values.entries), "{}"]
    form, count = ",".join(forms) + "\r\n", 0
    with file.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream:
        csv.writer(stream).writerow([*BEFORE, *(each.heading for each in values.entries), NOT_GOOD])
        for frames, _ in values.parts():
            for first in range(0, len(frames), PIECE_ROWS):
                _write_rows(values, frames[first : first + PIECE_ROWS], form, stream)
            count += len(frames)
            progress(float(frames["time"][-1]))
    return count


def _write_rows(values: RecordedValues, frames: Any, form: str, stream: IO[str]) -> None:
    columns = values.columns(frames)
    moments = np.datetime_as_string(columns.utc.astype("datetime64[ns]"))
    not_good = told_not_good(values.object_paths, columns.quality)
    told = (columns.time, moments, columns.missed, columns.execution, columns.values)
    stream.writelines(
        form.format(round(time, 9), f"{moment}Z", late, spent, *row, marks)  # the clock counts ns
        for time, moment, late, spent, row, marks in zip(*(each.tolist() for each in told), not_good, strict=True)
    )


# NumPy -----------------------------------------------------------------------------------------------------


def _write_npz(values: RecordedValues, file: Path, progress: TellTime) -> int:
    """Write an uncompressed array for each column, like `numpy.savez`. The rows are first collected in temporary files
    in the same folder, so that memory does not grow with the length of the recording."""
    arrays = [("time", "<f8"), ("utc", "<i8"), ("number", "<i8"), ("missed", "<i8")]
    columns = [(name, "<f8") for name in values.names]
    qualities = [(name, "|u1") for name in values.quality_names]
    with tempfile.TemporaryDirectory(prefix=f".{file.name}.", dir=file.parent) as folder:
        kinds = {"plain": arrays, "values": columns, "quality": qualities}
        with ExitStack() as opened:
            parts = {name: opened.enter_context(Path(folder, name).open("wb")) for name in kinds}
            count = _collect(values, parts, progress)
        with zipfile.ZipFile(file, "w") as archive:
            for name, columns in kinds.items():
                _write_arrays(archive, Path(folder, name), columns, count)
    return count


def _collect(values: RecordedValues, parts: Mapping[str, IO[bytes]], progress: TellTime) -> int:
    count = 0
    for frames, _ in values.parts():
        columns = values.columns(frames)
        plain = (columns.time.view("<i8"), columns.utc, columns.number, columns.missed)
        parts["plain"].write(np.column_stack(plain).astype("<i8").tobytes())
        parts["values"].write(columns.values.astype("<f8").tobytes())
        parts["quality"].write(columns.quality.tobytes())
        count += len(frames)
        progress(float(frames["time"][-1]))
    return count


def _write_arrays(archive: zipfile.ZipFile, part: Path, columns: list[tuple[str, str]], count: int) -> None:
    """Write each column of a file of rows as an array."""
    if not columns:
        return
    kind = f"u{np.dtype(columns[0][1]).itemsize}"
    shape = (count, len(columns))
    rows: Any = np.memmap(part, kind, "r", shape=shape) if count else np.zeros(shape, kind)
    for place, (name, wanted) in enumerate(columns):
        column = np.ascontiguousarray(rows[:, place]).view("<M8[ns]" if name == "utc" else wanted)
        with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
            np.lib.format.write_array(stream, column, allow_pickle=False)


# Parquet ---------------------------------------------------------------------------------------------------


def _write_parquet(values: RecordedValues, file: Path, progress: TellTime) -> int:
    from umo.recording.tables.recording_parquet import write_parquet

    return write_parquet(values, file, progress)

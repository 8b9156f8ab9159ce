"""Every sample of a part of the history as CSV, in pieces: a browser saves them while they are made."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from umo.page.live import HistoryPart
from umo.presentation.in_words import file_form, state_text

PIECE_ROWS = 256
"""Rows of a piece. Longer ones would keep the loop of the server waiting."""


def csv_of(stretch: HistoryPart) -> Iterator[str]:
    """A line of names with units, then a line for each sample: time in s, UTC of a run in real time, numbers in their
    units, names of states; nothing where there is no value."""
    watched, columns = stretch.watched, stretch.columns
    entries = [watched.entries[column] for column in columns]
    utc = watched.utc
    yield _lines([["time [s]", *(["UTC"] if utc is not None else []), *map(_head, entries)]])
    for times, values in watched.history.parts(stretch.start, stretch.stop):
        for first in range(0, len(times), PIECE_ROWS):
            rows = slice(first, first + PIECE_ROWS)
            cells = (_cells(entry, values[column, rows]) for entry, column in zip(entries, columns, strict=True))
            moments = [times[rows].tolist(), *([_moments(times[rows] + utc)] if utc is not None else [])]
            yield _lines(zip(*chain(moments, cells), strict=True))


def _head(entry: dict[str, Any]) -> str:
    unit = entry.get("unit")
    return f"{entry['path']} [{unit}]" if unit and unit != "sampling_period" else str(entry["path"])


def _moments(times: Any) -> list[str]:
    """UTC of some times, such as 2026-11-22T21:30:05.123456Z."""
    return [f"{text}Z" for text in np.datetime_as_string((times * 1e6).astype("datetime64[us]"))]


def _cells(entry: dict[str, Any], values: Any) -> list[str | None]:
    write = partial(state_text, entry) if "one" in entry else file_form(entry).format
    return [None if value != value else write(value) for value in values.tolist()]


def _lines(rows: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()

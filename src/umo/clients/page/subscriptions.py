"""Traces against time for a page: its subscriptions, parts of the history, and every sample as CSV."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import math
import struct
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, ParamSpec, TypeVar

import numpy as np

from umo.clients.page.watched_run import Watched
from umo.objects.presentation.described import Described
from umo.recording.scope.reduction import Points, crossing, measured, measured_state

MAX_TRACES = 64
MAX_WIDTH = 8192
"""Largest width of a drawing in pixels."""
WORKER = ThreadPoolExecutor(1, "history")
"""Thread for long computations of all pages, so that the loop stays free for touches and commands."""
Arguments = ParamSpec("Arguments")
T = TypeVar("T")
PIECE_ROWS = 256
"""Number of rows of a piece of CSV. Longer pieces would delay the loop of the server."""


async def in_worker(work: Callable[Arguments, T], *given: Arguments.args, **named: Arguments.kwargs) -> T:
    """Call a function in the worker thread, and return its result."""
    return await asyncio.get_running_loop().run_in_executor(WORKER, partial(work, *given, **named))


class BadRequest(ValueError):
    """A message of a page that is invalid."""


def columns_of(watched: Watched, paths: Any) -> list[int]:
    """Return the columns of the history with these paths. Raises BadRequest for an unknown path."""
    if not isinstance(paths, list) or len(paths) > MAX_TRACES:
        raise BadRequest(f"give a list of up to {MAX_TRACES} paths")
    for path in paths:
        if not isinstance(path, str) or path not in watched.columns:
            raise BadRequest(f"there is no object or signal {path!r}")
    return [watched.columns[path] for path in paths]


def number(message: dict[str, Any], name: str, default: float = 0.0) -> float:
    """Return a finite number from a message. Raises BadRequest for anything else."""
    value = message.get(name, default)
    with suppress(OverflowError):  # a whole number beyond all floats
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    raise BadRequest(f"{name} must be a number")


def packed(head: dict[str, Any], points: Points) -> bytes:
    """Return a binary message: the length of the JSON (uint32), the JSON padded to a multiple of 8 bytes, then as
    float64 the times, the smallest values of each trace, and, unless `same`, the largest ones."""
    same = points.high is points.low
    text = json.dumps(head | {"count": len(points.times), "traces": len(points.low), "same": same}).encode()
    text += b" " * (-(4 + len(text)) % 8)
    parts = [points.times, points.low] if same else [points.times, points.low, points.high]
    numbers = [part.astype("<f8").tobytes() for part in parts]
    return b"".join([struct.pack("<I", len(text)), text, *numbers])


@dataclass(frozen=True)
class HistoryPart:
    """A part of the history that a page requests. Any thread may compute its answers."""

    watched: Watched
    columns: list[int]
    start: float
    stop: float
    """End of the part in s."""

    @classmethod
    def of(cls, watched: Watched, message: dict[str, Any]) -> HistoryPart:
        start, stop = number(message, "start"), number(message, "stop")
        if stop < start:
            raise BadRequest("stop must not be before start")
        return cls(watched, columns_of(watched, message.get("paths")), start, stop)

    def window(self, head: dict[str, Any], width: int) -> bytes:
        """Return a message with the samples, reduced to `width` pixels."""
        step, history = (self.stop - self.start) / width, self.watched.history
        return packed(head, history.points(self.start, self.stop, self.columns, step, self.watched.period))

    def measured(self, head: dict[str, Any]) -> str:
        """Return a message with the measurements over all samples. If the part of a recording is too long, the message
        has no measurements."""
        if not self.watched.history.is_short(self.start, self.stop):
            return json.dumps(head | {"values": [None] * len(self.columns)})
        times, values = self.watched.history.between(self.start, self.stop, self.columns)
        states = [self.watched.entries[column].is_binary for column in self.columns]
        found = [
            measured_state(row) if state else measured(times, row) for row, state in zip(values, states, strict=True)
        ]
        return json.dumps(head | {"values": found})


def pixels(message: dict[str, Any]) -> int:
    return int(min(max(1.0, number(message, "width", 1.0)), MAX_WIDTH))


class Subscription:
    """One subscription. `next` returns the new data since the last call."""

    def __init__(self, watched: Watched, message: dict[str, Any]) -> None:
        self.id = message.get("id")
        self.columns = columns_of(watched, message.get("paths"))
        self.span = max(0.0, number(message, "span"))
        self.width = pixels(message)
        self._watched = watched
        self._sent = float("-inf")
        """The time of the last point that was sent."""
        self._newest = float("-inf")
        self._jumps = watched.jumps
        self._trigger = Trigger(watched, message["trigger"]) if message.get("trigger") else None

    @property
    def takes_long(self) -> bool:
        """True if `next` will compute the whole span. It is then called in another thread."""
        return self._trigger is not None or self._sent < 0.0

    def next(self) -> bytes | None:
        """Return the new points, or None if there are none. The last point of the previous message is sent again,
        because it may have been incomplete."""
        stop = self._watched.now
        if self._jumps != self._watched.jumps:
            self._jumps, self._sent, self._newest = self._watched.jumps, float("-inf"), float("-inf")
        if stop <= self._newest:
            return None
        if self._trigger is not None:
            return self._triggered(self._trigger, stop)
        self._newest = stop
        first = self._sent < stop - self.span
        start = stop - self.span if first else self._sent
        step, history = self.span / self.width, self._watched.history
        points = history.points(start, stop, self.columns, step, self._watched.period)
        if not len(points.times):
            return None
        self._sent = float(points.times[-1])
        return packed({"id": self.id, "from": -1.0 if first else float(points.times[0])}, points)

    def _triggered(self, trigger: Trigger, stop: float) -> bytes | None:
        """Return the whole span around the trigger, or None as long as the history does not contain the span."""
        moment = trigger.look(self.span)
        if moment is None:
            self._newest = stop
            return None
        start = moment - trigger.before * self.span
        if start + self.span > stop:
            return None
        trigger.done(start + self.span)
        whole = HistoryPart(self._watched, self.columns, start, start + self.span)
        return whole.window({"id": self.id, "from": -1.0, "trigger": moment, "start": start}, self.width)


class Trigger:
    """Waits for an edge or a level of one trace in the history."""

    def __init__(self, watched: Watched, message: Any) -> None:
        if not isinstance(message, dict) or message.get("kind") not in ("rising", "falling", "above", "below"):
            raise BadRequest(
                "a trigger needs a path, a kind (rising, falling, above or below), a level, before and single"
            )
        self.columns = columns_of(watched, [message.get("path")])
        self.kind = str(message["kind"])
        self.level = number(message, "level")
        self.before = min(max(number(message, "before", 0.5), 0.0), 1.0)
        """Share of the span before the trigger."""
        self.single = bool(message.get("single"))
        self._watched = watched
        self._searched = watched.now
        self._moment: float | None = None
        self._armed = True

    def look(self, span: float) -> float | None:
        """Return the time of the trigger, or None if it has not fired."""
        now = self._watched.now
        if self._moment is None and self._armed and now > self._searched:
            times, values = self._watched.history.between(self._searched, now, self.columns)
            self._moment = crossing(times, values[0], self.kind, self.level)
        self._searched = min(self._searched, now) if self._moment is not None else now
        return self._moment

    def done(self, until: float) -> None:
        """Continue to search after this time. A single-shot trigger stops."""
        self._moment = None
        self._searched = until
        self._armed = not self.single


def csv_of(stretch: HistoryPart) -> Iterator[str]:
    """Return CSV: a line of names with units, then a line for each sample. It has the time in s, the UTC if the run was
    in real time, numbers in their units, and names of states. A field without a value is empty."""
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


def _head(entry: Described) -> str:
    return f"{entry.path} [{entry.unit}]" if entry.unit and entry.unit != "sampling_period" else entry.path


def _moments(times: Any) -> list[str]:
    """Return times as text in UTC, such as 2026-11-22T21:30:05.123456Z."""
    return [f"{text}Z" for text in np.datetime_as_string(np.rint(times * 1e6).astype("datetime64[us]"))]


def _cells(entry: Described, values: Any) -> list[str | None]:
    write = entry.state if entry.is_binary else entry.file_form.format
    return [None if value != value else write(value) for value in values.tolist()]


def _lines(rows: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()

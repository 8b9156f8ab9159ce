"""What a page has subscribed to: traces against time, and what of them it has been sent."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from umo.frames.reduction import Points, crossing, reduced
from umo.page.watched import Watched

MOST_TRACES = 64
MOST_WIDTH = 8192
"""Pixels."""
MOST_SAMPLES = 4_000_000
"""Values of an answer that is not reduced."""


class BadRequest(ValueError):
    """A message of a page that has no meaning."""


def columns_of(watched: Watched, paths: Any) -> list[int]:
    """The columns of the history; BadRequest for a path that is none."""
    if not isinstance(paths, list) or len(paths) > MOST_TRACES:
        raise BadRequest(f"give a list of up to {MOST_TRACES} paths")
    for path in paths:
        if not isinstance(path, str) or path not in watched.columns:
            raise BadRequest(f"no object or signal {path!r}")
    return [watched.columns[path] for path in paths]


def number(message: dict[str, Any], name: str, default: float = 0.0) -> float:
    """A finite number of a message; BadRequest otherwise."""
    value = message.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise BadRequest(f"{name} must be a number")
    return float(value)


def packed(head: dict[str, Any], points: Points) -> bytes:
    """A binary message: length of the JSON (uint32), JSON filled up to whole 8 bytes, then float64: times, least values
    of each trace, and greatest ones unless `same`."""
    same = points.high is points.low
    text = json.dumps(head | {"count": len(points.times), "traces": len(points.low), "same": same}).encode()
    text += b" " * (-(4 + len(text)) % 8)
    parts = [points.times, points.low] if same else [points.times, points.low, points.high]
    numbers = [part.astype("<f8").tobytes() for part in parts]
    return b"".join([struct.pack("<I", len(text)), text, *numbers])


def window(watched: Watched, columns: Sequence[int], start: float, stop: float, width: int) -> Points:
    """The history from `start` to `stop` (s), reduced to `width` pixels; every sample if that is 0."""
    times, values = watched.history.between(start, stop, columns)
    if not width:
        most = max(1, MOST_SAMPLES // max(len(columns), 1))
        values = values[:, -most:]
        return Points(times[-most:], values, values)
    return reduced(times, values, (stop - start) / width, watched.period)


class Live:
    """One subscription. `next` gives what is new since the last call."""

    def __init__(self, watched: Watched, message: dict[str, Any]) -> None:
        self.id = message.get("id")
        self.columns = columns_of(watched, message.get("paths"))
        self.span = max(0.0, number(message, "span"))
        self.width = int(min(max(1.0, number(message, "width", 1.0)), MOST_WIDTH))
        self._watched = watched
        self._sent = float("-inf")
        """The time of the last point that was sent."""
        self._newest = float("-inf")
        self._trigger = Trigger(watched, message["trigger"]) if message.get("trigger") else None

    def next(self) -> bytes | None:
        """A message of the points since the last one, which is sent again as it may have been half full; None: nothing
        is new."""
        history = self._watched.history
        if history.stop <= self._newest or not len(history.times):
            return None
        if self._trigger is not None:
            return self._triggered(self._trigger)
        self._newest = history.stop
        if not self.span:
            times, values = history.between(history.stop, history.stop, self.columns)
            return packed({"id": self.id, "from": -1.0}, Points(times, values, values))
        start = max(self._sent, history.stop - self.span)
        first = self._sent < history.stop - self.span
        times, values = history.between(start, history.stop, self.columns)
        points = reduced(times, values, self.span / self.width, self._watched.period)
        self._sent = float(points.times[-1])
        return packed({"id": self.id, "from": -1.0 if first else float(points.times[0])}, points)

    def _triggered(self, trigger: Trigger) -> bytes | None:
        """The whole span around the trigger, once it is in the history."""
        stop = self._watched.history.stop
        moment = trigger.look(self.span)
        if moment is None:
            self._newest = stop
            return None
        start = moment - trigger.before * self.span
        if start + self.span > stop:
            return None
        trigger.done(start + self.span)
        points = window(self._watched, self.columns, start, start + self.span, self.width)
        return packed({"id": self.id, "from": -1.0, "trigger": moment, "start": start}, points)


class Trigger:
    """Waits for an edge or a level of one trace in the history."""

    def __init__(self, watched: Watched, message: Any) -> None:
        if not isinstance(message, dict) or message.get("kind") not in ("rising", "falling", "above", "below"):
            raise BadRequest("a trigger has a path, a kind (rising, falling, above, below), a level, before, single")
        self.columns = columns_of(watched, [message.get("path")])
        self.kind = str(message["kind"])
        self.level = number(message, "level")
        self.before = min(max(number(message, "before", 0.5), 0.0), 1.0)
        """Share of the span before the trigger."""
        self.single = bool(message.get("single"))
        self._history = watched.history
        self._searched = watched.history.stop
        self._moment: float | None = None
        self._armed = True

    def look(self, span: float) -> float | None:
        """When it fired; None while it has not."""
        history = self._history
        if self._moment is None and self._armed and history.stop > self._searched:
            times, values = history.between(self._searched, history.stop, self.columns)
            self._moment = crossing(times, values[0], self.kind, self.level)
            self._searched = history.stop
        return self._moment

    def done(self, until: float) -> None:
        """Search on after this time; never again if it is for a single shot."""
        self._moment = None
        self._searched = until
        self._armed = not self.single

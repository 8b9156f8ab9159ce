"""The tables of runs in Parquet. They have one row for each value of each delta of a fleet, or of each frame of a
recording.

The columns are the same for all stations and all machines, so that one query covers them (docs/decisions/0048). Times
are the UTC of the frames.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from umo.cycle.events import CommandState, Event
from umo.objects import Quality
from umo.process.frames.layout import Layout
from umo.process.frames.machine_items import ItemKind, MachineItem, items_of

UTC = pa.timestamp("us", tz="UTC")
NAME = pa.dictionary(pa.int32(), pa.string())
"""The type of a column with few different strings."""
VALUES = pa.schema(
    [
        ("time", UTC),
        ("time_error", pa.float64()),  # s, the greatest; null: the clock of the machine is not synchronised
        ("run", NAME),
        ("number", pa.int64()),  # of the period
        ("delta", pa.int64()),
        ("path", NAME),
        ("value", pa.float64()),  # null: it has none
        ("state", NAME),  # name of the value; null: it is a number
        ("quality", NAME),
    ]
)
EVENTS = pa.schema(
    [
        ("time", UTC), ("run", NAME), ("number", pa.int64()), ("path", pa.string()), ("text", pa.string()),
        ("who", pa.string()), ("asked", pa.string()), ("state", NAME), ("command", pa.int64()),
    ]
)  # fmt: skip
GAPS = pa.schema(
    [
        ("time", UTC),  # of what came next
        ("run", NAME),
        ("of", NAME),  # "values" or "events"
        ("first", pa.int64()),  # number of the delta, or of the event
        ("last", pa.int64()),
        ("count", pa.int64()),
        ("why", NAME),
    ]
)
OBJECTS = pa.schema(
    [
        ("run", NAME), ("started", UTC), ("wiring", pa.string()), ("path", pa.string()), ("kind", NAME),
        ("unit", pa.string()), ("minimum", pa.float64()), ("maximum", pa.float64()), ("states", pa.string()),
    ]
)  # fmt: skip
SCHEMAS = {"values": VALUES, "events": EVENTS, "gaps": GAPS, "objects": OBJECTS}
QUALITIES = [str(each) for each in Quality]
RUN_ITEMS = ("mode", "missed")
"""The recorded values of the run itself."""


class RunValues:
    """Makes the rows of one run. `layout`: the layout of the run's ring; `only`: the indices of the wanted items in
    `items`."""

    def __init__(self, run: str, layout: Layout, only: Sequence[int] | None = None) -> None:
        self._run, self._dtype = run, layout.dtype
        self._tunables = len(layout.tunables)
        items = [each for each in items_of(layout) if each.kind is not ItemKind.RUN or each.path in RUN_ITEMS]
        self._only = list(range(len(items)) if only is None else only)
        self._items: list[MachineItem] = [items[place] for place in self._only]
        items = self._items
        self._names = [each.name for each in items]
        self._about = layout.about
        states = sorted({name for each in items for name in each.states.values()})
        self._states = states
        places = {name: place for place, name in enumerate(states)}
        self._codes = [
            (column, float(number), places[name])
            for column, each in enumerate(items)
            for number, name in each.states.items()
        ]

    def table(self, frames: Any, utc: Any, deltas: Any, beside: Any) -> pa.Table:
        """Return a table with a row for each value of each frame. For each frame `utc` has the UTC in us since 1970,
        `deltas` the number of the delta, and `beside` the tunable numbers, the mode and the missed periods."""
        count, width = len(frames), len(self._items)
        values = self._numbers(frames, beside)
        errors = np.where(frames["utc_error"] < 0, np.nan, frames["utc_error"] * 1e-9)
        return pa.Table.from_arrays(
            [
                pa.array(np.repeat(utc, width)).cast(UTC),
                pa.array(np.repeat(errors, width), from_pandas=True),
                names(np.zeros(count * width, np.int32), [self._run]),
                pa.array(np.repeat(frames["number"], width)),
                pa.array(np.repeat(deltas, width), pa.int64()),
                names(np.tile(np.arange(width, dtype=np.int32), count), self._names),
                pa.array(values.ravel(), from_pandas=True),
                names(self._states_of(values).ravel(), self._states),
                names(self._qualities(frames, values).ravel(), QUALITIES),
            ],
            schema=VALUES,
        )

    def _numbers(self, frames: Any, beside: Any) -> Any:
        states = [frames[name].astype(np.float64) for name in ("equipment", "axes", "alarms")]
        tunables, run = beside[:, : self._tunables], beside[:, self._tunables :]
        every = np.concatenate((frames["values"], frames["signals"], tunables, *states, run), axis=1)
        return every[:, self._only]

    def _states_of(self, values: Any) -> Any:
        codes = np.full(values.shape, -1, np.int32)
        for column, number, code in self._codes:
            codes[values[:, column] == number, column] = code
        return codes

    def _qualities(self, frames: Any, values: Any) -> Any:
        """Return the quality of each value. Values other than those of objects are always good."""
        codes = np.where(np.isnan(values), np.int32(Quality.BAD), np.int32(Quality.GOOD))
        given = frames["quality"]
        objects = [column for column, place in enumerate(self._only) if place < given.shape[1]]
        places = [self._only[column] for column in objects]
        codes[:, objects] = np.minimum(given[:, places], len(QUALITIES) - 1)
        return codes

    def objects(self) -> pa.Table:
        started = int(float(self._about.get("started", 0.0)) * 1e6)
        rows = [
            (self._run, started, str(self._about.get("wiring") or ""), each.name, each.kind.value, each.unit,
             each.minimum, each.maximum, json.dumps(each.states) if each.states else None)
            for each in self._items
        ]  # fmt: skip
        return table(OBJECTS, rows)


def utc_of(frames: Any) -> Any:
    """Return the UTC of each frame in us since 1970."""
    return (frames["began"] + frames["utc"]) // 1000


def names(codes: Any, texts: Sequence[str]) -> pa.DictionaryArray:
    """Return the strings at these indices; null for an index below 0."""
    return pa.DictionaryArray.from_arrays(pa.array(codes, mask=codes < 0), pa.array(texts, pa.string()))


def events_table(run: str, events: Sequence[tuple[int, int | None, Event]]) -> pa.Table:
    """Return the table of events. Each of `events` has the number, the UTC in us, and the event."""
    rows = [
        (at, run, number, each.path, each.text, each.who, each.asked, str(CommandState(each.state)), each.command)
        for number, at, each in events
    ]
    return table(EVENTS, rows)


def table(schema: pa.Schema, rows: Sequence[tuple[Any, ...]]) -> pa.Table:
    columns = zip(*rows, strict=True) if rows else ((),) * len(schema)
    return pa.Table.from_arrays(
        [pa.array(column, field.type) for column, field in zip(columns, schema, strict=True)], schema=schema
    )

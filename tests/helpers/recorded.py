"""Frames at random, as blocks of a recording; messages of protobuf."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from umo.cycle.events import CommandState, Event
from umo.process.frames import Layout
from umo.process.frames.layout import ENTRY
from umo.process.frames.run_reader import NumberedEvent
from umo.recording.block import Block, TakenCommand


def layout_of(objects: int = 3, signals: int = 2, **about: object) -> Layout:
    facts = {"station": "press", "pid": 7, "started": 1.7e9, "started_monotonic": 5, "period": 0.001, "realtime": True}
    return Layout(
        tuple({"path": f"part{i % 2}.object{i}", "unit": "mm", "kind": "DigitalSensor"} for i in range(objects)),
        ("sample", "update"),
        facts | about,
        tuple({"path": f"part0.signal{i}", "unit": "s"} for i in range(signals)),
    )


def block_at_random(layout: Layout, first: int, count: int, seed: int, *, wild: bool = False) -> Block:
    """`wild`: any bits at all in every field; else numbers as of a run."""
    random = np.random.default_rng(seed)
    frames = np.zeros(count, layout.dtype)
    for name, _, _, _ in layout.columns:
        column = frames[name]
        if wild:
            frames[name] = np.frombuffer(random.bytes(column.size * column.itemsize), column.dtype).reshape(
                column.shape
            )
    numbers = np.arange(first, first + count)
    frames["sequence"] = 2 * numbers.astype(np.uint64) + 2
    frames["checksum"] = frames["entries_checksum"] = 0
    entries = np.zeros(int(random.integers(0, 4)) if count else 0, ENTRY)
    if not wild:
        frames["number"], frames["time"], frames["began"] = numbers + 1, numbers * 0.001, numbers * 1_000_000
        frames["utc"], frames["values"] = 1_700_000_000_000_000_000, random.normal(size=frames["values"].shape)
        frames["raws"] = random.integers(-50, 50, frames["raws"].shape).cumsum(axis=0)
    frames["quality"] %= 4
    frames["time"] = numbers * 0.001
    entries["raw"], entries["time"] = random.integers(-9, 9, len(entries)), np.nan
    commands = [TakenCommand(3, first, b'{"do": "lease"}'), TakenCommand(4, first, b"")]
    event = NumberedEvent(2, Event(0.5, "z", "Größe", "ann", 3, CommandState.DONE, "set"))
    return Block(frames, entries, commands, 0, 1, 0, [event], {"mode": 0, "holder": "ann"})


def decoded(schema: Any, data: bytes) -> Any:
    """A message as its schema in the file says."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(data)

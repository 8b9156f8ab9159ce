"""The channels of a recording for Foxglove, PlotJuggler and Rerun: the machine, its events, alarms, commands and
progress."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2 as pb
from google.protobuf import descriptor_pool, message_factory

from umo.cycle.events import ALARM
from umo.process.frames.layout import Layout
from umo.process.frames.run_reader import progress_of
from umo.recording.block import BlackBox, Block, TakenCommand
from umo.recording.mcap_records import HEAD, MESSAGE, McapChannel, Opcode, Schema, message
from umo.recording.mcap_writer import Messages
from umo.recording.message_tree import PACKAGE, ROOT, UNKNOWN, EvenRun, MessageTree, leaves_of
from umo.recording.recording import ALARMS_TOPIC, BOXES_TOPIC, COMMANDS_TOPIC, EVENTS_TOPIC

MACHINE, EVENTS, ALARMS, COMMANDS, PROGRESS, BLACK_BOXES = range(3, 9)
"""Numbers of the channels."""
MACHINE_SCHEMA, EVENT_SCHEMA, COMMAND_SCHEMA, PROGRESS_SCHEMA, BOX_SCHEMA = range(1, 6)
STRING, DOUBLE, INTEGER = 9, 1, 3
"""Types of protobuf."""
SELDOM = {
    "Event": {
        "number": INTEGER, "time": DOUBLE, "path": STRING, "text": STRING, "who": STRING, "command": INTEGER,
        "state": STRING, "asked": STRING,
    },
    "Command": {"number": INTEGER, "period": INTEGER, "who": STRING, "text": STRING},
    "Progress": {"text": STRING, "done": INTEGER, "total": INTEGER},
    "BlackBox": {
        "first": INTEGER, "periods": INTEGER, "start": DOUBLE, "time": DOUBLE, "reason": STRING, "missed": INTEGER,
        "text": STRING,
    },
}  # fmt: skip
"""The fields of the messages of rare channels."""
BEGIN = HEAD.size + MESSAGE.size
"""Offset of the message within its record."""
HEADS = np.dtype({"names": ["sequence", "log", "publish"], "formats": ["<u4", "<u8", "<u8"], "offsets": [11, 15, 23]})
"""The fields that differ in the heads of records."""
UNITS = "units"
"""Name of the metadata record with unit and range of each number, by path."""
MAX_UNITS = 2000
"""Largest number of numbers whose units are also in the channel's metadata. It is limited because a file contains these
metadata twice, at its beginning and at its end."""


class ProtobufChannels:
    """Makes the messages of these channels. Each run needs a separate object, because the object remembers the last
    messages."""

    def __init__(self, layout: Layout, rate: float = inf) -> None:
        """`rate`: number of messages of the machine per second of its time. Changes of states can add up to as many
        further messages."""
        self._stride = max(round(1 / (rate * (layout.about.get("period") or 1.0))), 1)
        leaves = leaves_of(layout)
        self._tree = MessageTree(leaves)
        self._template = _template(self._tree)
        self._progress: Any = None
        file = _seldom()
        self._kinds = _classes(file)
        seldom = pb.FileDescriptorSet(file=[file]).SerializeToString()
        self.schemas: Sequence[Schema] = [
            Schema(MACHINE_SCHEMA, f"{PACKAGE}.{ROOT}", "protobuf", self._tree.descriptor),
            *(Schema(EVENT_SCHEMA + i, f"{PACKAGE}.{name}", "protobuf", seldom) for i, name in enumerate(SELDOM)),
        ]
        units = {path: leaf.about for path, leaf in leaves if leaf.about}
        self.metadata: Sequence[tuple[str, dict[str, str]]] = [(UNITS, units)] if units else []
        few = units if len(units) <= MAX_UNITS else {"units": f"in the metadata record {UNITS}"}
        self.channels: Sequence[McapChannel] = [
            McapChannel(MACHINE, "machine", "protobuf", MACHINE_SCHEMA, few),
            McapChannel(EVENTS, EVENTS_TOPIC, "protobuf", EVENT_SCHEMA),
            McapChannel(ALARMS, ALARMS_TOPIC, "protobuf", EVENT_SCHEMA),
            McapChannel(COMMANDS, COMMANDS_TOPIC, "protobuf", COMMAND_SCHEMA),
            McapChannel(PROGRESS, "progress", "protobuf", PROGRESS_SCHEMA),
            McapChannel(BLACK_BOXES, BOXES_TOPIC, "protobuf", BOX_SCHEMA),
        ]

    def messages(self, block: Block, times: npt.NDArray[np.int64]) -> list[Messages]:
        """Return the messages of a block. `times`: the UTC of the block's frames in ns since 1970."""
        begun, clock = int(times[0]), float(block.frames["time"][0])
        told = [
            (begun + round((event.time - clock) * 1e9), self._event(number, event)) for number, event in block.events
        ]
        alarms = [each for each, (_, event) in zip(told, block.events, strict=True) if event.asked == ALARM]
        commands = [(int(times[max(each.period - block.first, 0)]), self._command(each)) for each in block.commands]
        boxes = [(begun + round((box.time - clock) * 1e9), self._box(box)) for box in block.boxes]
        progress = self._new_progress(block, times)
        parts = (
            (EVENTS, told), (ALARMS, alarms), (COMMANDS, commands), (PROGRESS, progress), (BLACK_BOXES, boxes),
        )  # fmt: skip
        return [self._machine(block, times), *(_few(channel, each) for channel, each in parts if each)]

    def _machine(self, block: Block, times: npt.NDArray[np.int64]) -> Messages:
        """Return the messages with the values of the machine, for the periods that get a message."""
        frames, runs = block.frames, self._tree.runs
        states = {run: _states(frames[run.column][:, run.places], run) for run in runs if run.states}
        told = self._told(block, list(states.values()))
        times, count, size = times[told], len(told), len(self._template)
        rows = np.tile(self._template, count)
        heads = np.ndarray(count, HEADS, rows, 0, size)
        heads["sequence"] = (block.first + told).astype(np.uint32)
        heads["log"] = heads["publish"] = times
        columns = {name: frames[name][told] for name in {run.column for run in runs}}
        for run in runs:
            kind = np.uint8 if run.states else np.dtype("<f8")
            there = np.ndarray((count, run.count), kind, rows, BEGIN + run.at, (size, run.step))
            there[:] = states[run][told] if run.states else columns[run.column][:, run.places]
        index = np.empty((count, 2), "<u8")
        index[:, 0], index[:, 1] = times, np.arange(count, dtype=np.uint64) * np.uint64(size)
        return Messages(MACHINE, rows.data, index.tobytes(), count, int(times.min()), int(times.max()))

    def _told(self, block: Block, states: Sequence[npt.NDArray[np.uint8]]) -> npt.NDArray[np.int64]:
        """Return the places of the frames that get a message: frames at even distances, the first change of a state
        between two of these, and the first frame of the block."""
        numbers = block.first + np.arange(len(block.frames))
        wanted = numbers % self._stride == 0
        wanted[0] = True
        if self._stride > 1:
            changed = np.zeros(len(numbers), bool)
            for now in states:
                changed[1:] |= (now[1:] != now[:-1]).any(axis=1)
            places = np.flatnonzero(changed & ~wanted)
            wanted[places[np.unique(numbers[places] // self._stride, return_index=True)[1]]] = True
        return np.flatnonzero(wanted)

    def _event(self, number: int, event: Any) -> bytes:
        told = event._asdict() | {"number": number, "state": str(event.state), "command": int(event.command)}
        return bytes(self._kinds["Event"](**told).SerializeToString())

    def _command(self, command: TakenCommand) -> bytes:
        """Return a command as it was received, but without the key of the lease."""
        try:
            told = dict(json.loads(command.data))
            told.pop("key", None)
        except (ValueError, TypeError):
            told = {}
        text = json.dumps(told)
        who = str(told.get("who", "")).encode(errors="replace").decode()  # JSON has texts that are no UTF-8
        made = self._kinds["Command"](number=command.number, period=command.period, who=who, text=text)
        return bytes(made.SerializeToString())

    def _box(self, box: BlackBox) -> bytes:
        return bytes(self._kinds["BlackBox"](**box._asdict()).SerializeToString())

    def _new_progress(self, block: Block, times: npt.NDArray[np.int64]) -> list[tuple[int, bytes]]:
        """Return a message, with its time, for each change of the progress."""
        frames, new = block.frames, []
        steps = [frames[name][1:] != frames[name][:-1] for name in ("progress", "done", "total")]
        for row in [0, *(np.flatnonzero(np.logical_or.reduce(steps)) + 1).tolist()]:
            now = progress_of(frames[row])
            if now != self._progress:
                self._progress = now
                made = self._kinds["Progress"](text=now.text, done=now.done, total=now.total)
                new.append((int(times[row]), bytes(made.SerializeToString())))
        return new


def _states(values: npt.NDArray[Any], run: EvenRun) -> npt.NDArray[np.uint8]:
    """Return the numbers of states, with UNKNOWN for a value that is not a state."""
    if values.dtype == np.uint8:
        return values
    found = np.full(values.shape, UNKNOWN, np.uint8)
    for number in run.states:
        found[values == number] = number
    return found


def _template(tree: MessageTree) -> npt.NDArray[np.uint8]:
    """Return a whole record as bytes. They are needed because numpy would not copy bytes that belong to no field."""
    data = HEAD.pack(Opcode.MESSAGE, MESSAGE.size + len(tree.template))
    data += MESSAGE.pack(MACHINE, 0, 0, 0) + tree.template
    return np.frombuffer(data, np.uint8)


def _few(channel: int, told: Sequence[tuple[int, bytes]]) -> Messages:
    data, rows = bytearray(), []
    for number, (time, content) in enumerate(told):
        rows.append((time, len(data)))
        data += message(channel, number, time, content)
    times = [time for time, _ in told]
    return Messages(channel, data, rows, len(rows), min(times), max(times))


def _seldom() -> Any:
    file = pb.FileDescriptorProto(name="umo.proto", package=PACKAGE, syntax="proto3")
    for name, fields in SELDOM.items():
        made = [
            pb.FieldDescriptorProto(name=each, number=number, label=1, type=kind)
            for number, (each, kind) in enumerate(fields.items(), 1)
        ]
        file.message_type.append(pb.DescriptorProto(name=name, field=made))
    return file


def _classes(file: Any) -> dict[str, Any]:
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{name}")) for name in SELDOM}

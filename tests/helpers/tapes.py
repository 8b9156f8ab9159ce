"""A tape of a run in this process: an observer that copies frames, entries of the journal, and commands."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from umo import connect, drive
from umo.cycle.events import Event
from umo.cycle.stopping import TimeLimit
from umo.process.frames import Reader, published
from umo.process.frames.layout import ENTRY, Layout
from umo.process.frames.run_reader import NumberedEvent
from umo.process.job import Job, Plan
from umo.process.job_facts import job_facts
from umo.process.station import shipped
from umo.recording.block import Block, TakenCommand
from umo.recording.recording_file import RecordingFile
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import replay
from umo.recording.replay.result import Replayed
from umo.wiring import resolve


class MemoryTape:
    """A recorded run in memory (`umo.recording.replay.Tape`)."""

    def __init__(self, layout: Layout, job: Mapping[str, Any]) -> None:
        self.layout, self.job = layout, job
        self.events: list[Event] = []
        self.recorded: list[Block] = []
        self.commands: list[TakenCommand] = []
        """The commands of the block that is being recorded."""

    def blocks(self) -> Iterator[Block]:
        return iter(self.recorded)

    @property
    def frames(self) -> Any:
        return np.concatenate([each.frames for each in self.recorded])


@contextmanager
def taped(connection: connect[Any], job: Mapping[str, Any] | None = None, size: int = 500) -> Iterator[MemoryTape]:
    """Tape what a connected machine does; to be entered within `with connection`. The tape is whole when the
    connection is closed."""
    with published(connection, "taped") as ring:
        tape = MemoryTape(ring.layout, job or {})
        reader = Reader(ring.path)
        journal: list[Any] = []
        frames: list[Any] = []

        def flush() -> None:
            if frames:
                entries = np.concatenate([np.empty(0, ENTRY), *journal])
                tape.recorded.append(Block(np.concatenate(frames), entries, list(tape.commands)))
                tape.commands.clear()
                frames.clear()
                journal.clear()

        def take(frame: Any) -> None:
            new = reader.read()
            frames.append(new)
            places = zip(new["journal"].tolist(), new["entries"].tolist(), strict=True)
            journal.extend(reader.entries(first, first + count)[1] for first, count in places)
            if len(frames) >= size:
                flush()

        def end() -> None:
            tape.events = list(connection.machine.events)
            flush()
            reader.close()

        connection.machine.observers.append(take)
        connection.afterwards.append(end)
        yield tape


@dataclass
class Case:
    """A machine with its wiring and its loop, for a run that is recorded and for its replays."""

    machine: Callable[[], Any]
    wiring: Callable[[Any], Any]
    loop: Callable[[Any], Any]
    options: dict[str, Any] = field(default_factory=dict)

    def record(self) -> MemoryTape:
        """Run it, to its end or its error."""
        machine = self.machine()
        connection = connect(machine, self.wiring(machine), **self.options)
        with suppress(Exception), connection as m, taped(connection) as tape:
            self.loop(m)
        return tape

    def program(self, loop: Callable[[Any], Any] | None = None) -> Program:
        machine = self.machine()
        return Program(machine, resolve(machine, self.wiring(machine)), loop or self.loop)

    def replay(self, tape: MemoryTape, loop: Callable[[Any], Any] | None = None, **options: Any) -> Replayed:
        return replay(tape, self.program(loop), **options)


def recorded(station: str, wiring: str | None = None, stop: float | None = None, **options: Any) -> MemoryTape:
    """A run of a station in virtual time, in this process; to this time in s, or its end."""
    if wiring is not None or stop is not None or options:
        return _recorded(station, wiring, stop, options)
    tape = copy(_whole(station))
    tape.recorded = list(tape.recorded)
    return tape


@cache
def _whole(station: str) -> MemoryTape:
    """Its plain run, once in this process."""
    return _recorded(station, None, None, {})


def _recorded(station: str, wiring: str | None, stop: float | None, options: dict[str, Any]) -> MemoryTape:
    plan = Plan(Job(station, wiring=wiring, options=options))
    connection = connect(plan.machine, plan.wired)
    job = job_facts(plan)
    with suppress(Exception), connection as m, taped(connection, job) as tape:
        if stop is not None:
            connection.machine.observers.append(TimeLimit(stop, connection.stop))
        drive(m, plan.application)
    return tape


def save(tape: MemoryTape, path: Path) -> Path:
    """The tape as a recording."""
    tape.layout.about["job"] = dict(tape.job)
    events = [NumberedEvent(number, event) for number, event in enumerate(tape.events)]
    with closing(RecordingFile(path, tape.layout)) as file:
        for each in tape.recorded:
            file.add([each if each is not tape.recorded[-1] else replace(each, events=events)])
    return path


def changed_conveyor(folder: Path, name: str, before: str, after: str) -> Path:
    """A copy of the conveyor with one change."""
    copy = folder / "conveyor"
    shutil.copytree(shipped()["conveyor"], copy, ignore=shutil.ignore_patterns("__pycache__"))
    text = (copy / name).read_text()
    assert before in text
    (copy / name).write_text(text.replace(before, after))
    return copy


def listen(tape: MemoryTape, clients: Any) -> None:
    """Keep the commands that the clients of a taped machine send."""
    inbox, get = clients.inbox, clients.inbox.get

    def kept() -> Any:
        command = get()
        if command is not None:
            text = {key: value for key, value in vars(command).items() if key != "number"}
            tape.commands.append(TakenCommand(command.number, 0, json.dumps(text).encode()))
        return command

    inbox.get = kept


OVEN = """
from umo import Compound, DigitalActuator, DigitalSensor
class Oven(Compound):
    heater: DigitalActuator
    timer: DigitalSensor
def machine():
    return Oven(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
"""The objects of a station with one actuator."""

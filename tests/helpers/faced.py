"""A face that notes what it is told."""

from __future__ import annotations

from typing import Any

from umo.faces.contract import Changes, Commands, Face
from umo.faces.declaration import Declaration
from umo.frames.reader import NumberedEvent


class Recorder(Face):
    """A face that notes what it is told."""

    proves_users = True

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.machine: Declaration | None = None
        self.commands: Any = None
        self.told: list[Changes] = []
        self.heard: list[NumberedEvent] = []
        self.why = ""

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self.calls.append("begin")
        self.machine, self.commands = machine, commands

    async def frames(self, changes: Changes) -> None:
        self.calls.append("frames")
        self.told.append(changes)

    async def events(self, events: Any) -> None:
        self.calls.append("events")
        self.heard += events

    async def end(self, why: str) -> None:
        self.calls.append("end")
        self.why = why

    def value(self, name: str) -> float:
        assert self.machine is not None
        return float(self.told[-1].values[self.machine.by_name[name].number])

    def quality(self, name: str) -> int:
        assert self.machine is not None
        return int(self.told[-1].quality[self.machine.by_name[name].number])

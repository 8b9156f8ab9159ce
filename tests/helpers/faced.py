"""A host in this process, and a face that notes what it is told."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.face import Changes, Commands, Face
from umo.clients.faces.host import FaceHost
from umo.process.frames.machine_items import Declaration
from umo.process.frames.run_reader import NumberedEvent


@asynccontextmanager
async def hosted(machine: TriedMachine, *faces: Face, read_only: bool = False, **more: Any) -> AsyncIterator[list[str]]:
    """A host with these faces; what it says."""
    said: list[str] = []
    named = [(type(face).__name__.lower(), face) for face in faces]
    host = FaceHost(None, named, rate=100.0, read_only=read_only, say=said.append, find=machine.find, **more)
    serving = asyncio.create_task(host.run())
    try:
        yield said
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


class Recorder(Face):
    """A host in this process, and a face that notes what it is told."""

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

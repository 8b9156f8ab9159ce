"""A face without a protocol, and its client: the conformance kit for faces is tried on it, whole and broken."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan
from typing import Any

from umo import Quality
from umo.clients.faces.conformance import ForeignClient, RefusedByFace, Seen
from umo.clients.faces.conformance.client import Grade
from umo.clients.faces.face import Changes, Face, User
from umo.errors import UmoError
from umo.process.frames.machine_items import Declaration

NOTHING = Seen(None, Grade.NONE)


class Mirror(Face):
    """Shows each item in a dict, as a server shows it to its clients."""

    proves_users = True

    def __init__(self) -> None:
        self.shown: dict[str, Seen] = {}
        self.machine: Declaration | None = None
        self.commands: Any = None

    async def begin(self, machine: Declaration, commands: Any) -> None:
        self.machine, self.commands = machine, commands

    async def frames(self, changes: Changes) -> None:
        assert self.machine is not None
        for place in changes.places:
            item = self.machine.items[place]
            self.shown[item.name] = self.seen(item, changes)

    def seen(self, item: Any, changes: Changes) -> Seen:
        value, quality = float(changes.values[item.number]), changes.quality_of(item.number)
        shown: float | str | None = item.states.get(int(value), value) if item.states and not isnan(value) else value
        return Seen(
            None if quality is Quality.BAD else shown,
            self.grade(quality),
            float(changes.times[item.number]),
            item.unit,
            item.minimum,
            item.maximum,
            item.states,
        )

    def grade(self, quality: Quality) -> Grade:
        if quality is Quality.GOOD:
            return Grade.GOOD
        return Grade.NONE if quality is Quality.BAD else Grade.DOUBTFUL

    async def end(self, why: str) -> None:
        self.shown = {}


class MirrorClient(ForeignClient):
    def __init__(self, face: Mirror, user: str) -> None:
        self._face, self._lives = face, True
        self.user = User(user, proved=True, is_owner=True, is_alive=lambda: self._lives)

    async def read(self, name: str) -> Seen:
        return self._face.shown.get(name, NOTHING)

    async def ask(self, do: str, path: str, **more: Any) -> Any:
        try:
            return await self._face.commands.ask(self.user, do, path, **more)
        except UmoError as error:
            raise RefusedByFace(str(error)) from None

    async def tune(self, path: str, value: Any) -> None:
        await self.ask("tune", path, value=value)

    async def write(self, path: str, value: Any) -> None:
        await self.ask("write", path, value=value)

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        return await self.ask("call", path, arguments=arguments)

    async def mode(self, mode: str) -> None:
        await self.ask("mode", "", value=mode)

    async def close(self) -> None:
        self._lives = False

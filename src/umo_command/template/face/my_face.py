"""The face `my_face`, made by `umo new face`: JSON over TCP. Each change, command and answer is one line.

Replace the lines by the protocol of your clients. The host and the gateway of the face stay the same.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from math import isnan
from typing import Any

from umo import Quality
from umo.errors import UmoError
from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.face import Changes, Commands, Face, User
from umo.process.frames.machine_items import Declaration
from umo.system.peer_account import is_own


class MyFace(Face):
    """Lines of JSON over TCP on this computer: one line for each change, each command and each answer."""

    def __init__(self, port: int = 9500) -> None:
        self._endpoint = Endpoint("127.0.0.1", port)
        self._writers: set[asyncio.StreamWriter] = set()
        self._last: dict[str, bytes] = {}
        self._commands: Commands | None = None

    async def open(self) -> None:
        self._server = await asyncio.start_server(self._serve, sock=self._endpoint.listening())
        self.address = "tcp://{}:{}".format(*self._server.sockets[0].getsockname())

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self._machine, self._commands = machine, commands

    async def frames(self, changes: Changes) -> None:
        for place in changes.places:
            item, value, quality = self._machine.items[place], float(changes.values[place]), changes.quality_of(place)
            shown: float | str | None = item.states.get(int(value), value) if item.states and value == value else value
            if isnan(value) or quality is Quality.BAD:
                shown = None  # JSON has no NaN
            time = None if isnan(changes.times[place]) else float(changes.times[place])
            self._last[item.name] = line(name=item.name, value=shown, unit=item.unit, quality=str(quality), time=time)
            self._tell(self._last[item.name])

    async def end(self, why: str) -> None:
        self._commands, self._last = None, {}
        self._tell(line(ended=why))

    async def close(self) -> None:
        self._server.close()
        for writer in self._writers:
            writer.transport.abort()
        while self._writers:
            await asyncio.sleep(0.01)

    def _tell(self, data: bytes) -> None:
        for writer in self._writers:
            if writer.transport.get_write_buffer_size() > 1_000_000:  # the client does not read
                writer.transport.abort()
            else:
                writer.write(data)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        writer.write(b"".join(self._last.values()))
        asked: set[asyncio.Task[None]] = set()
        with suppress(ConnectionError, ValueError):  # the client has gone, or its line is too long
            while text := await reader.readline():
                task = asyncio.create_task(self._answer(text, writer))  # other commands are answered meanwhile
                asked.add(task)
                task.add_done_callback(asked.discard)
        self._writers.discard(writer)
        writer.close()

    async def _answer(self, text: bytes, writer: asyncio.StreamWriter) -> None:
        number = None
        try:
            command = dict(json.loads(text))
            number, name = command.get("number"), str(command.get("user", "somebody"))
            user = User(name, False, is_own(writer.get_extra_info("socket")), lambda: not writer.is_closing())
            more = {key: command[key] for key in ("value", "arguments") if key in command}
            if self._commands is None:
                raise UmoError("no machine runs")
            done = await self._commands.ask(user, str(command["do"]), str(command.get("path", "")), **more)
            answer = {"done": done}
        except (UmoError, LookupError, TypeError, ValueError) as error:
            answer = {"refused": str(error)}
        writer.write(line(number=number, **answer))


def line(**fields: Any) -> bytes:
    return json.dumps(fields).encode() + b"\n"

"""A gateway of a fleet in this process, and clients of it, on a free port of loopback."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import zenoh

from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.fleet.fleet_commands import FleetUsers
from umo.clients.fleet.fleet_gateway import FleetGateway
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_mirror import find
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.fleet_settings import FleetSettings
from umo.clients.remote.attached import RemoteStation
from umo.errors import FramesError

PLANT = StationKey("cell7", "plant")


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class Fleet:
    """`port`: of the gateway, which listens there."""

    def __init__(self, machine: TriedMachine, port: int) -> None:
        self.machine, self.address = machine, f"tcp/127.0.0.1:{port}"
        self.said: list[str] = []
        self._serving: asyncio.Task[None] | None = None
        self._session: zenoh.Session | None = None
        self._clients: list[RemoteStation] = []

    def _paths(self) -> list[Path]:
        try:
            with self.machine.find() as reader:
                return [reader.path]
        except FramesError:
            return []

    async def begin(self, *, rate: float = 50.0, read_only: bool = False, as_client: bool = False) -> None:
        """Start the gateway. `as_client`: it connects to the address, at which another one listens."""
        network = FleetNetwork(connect=[self.address]) if as_client else FleetNetwork(listen=[self.address])
        session = await asyncio.to_thread(opened, network, "client" if as_client else "peer")
        await self.serve(session, FleetUsers(), rate=rate, read_only=read_only)

    async def serve(self, session: zenoh.Session, users: FleetUsers, **more: Any) -> None:
        """Start the gateway in a session."""
        self._session = session
        gateway = FleetGateway(session, PLANT.site, users, say=self.said.append, find=self._paths, **more)
        self._serving = asyncio.create_task(gateway.run())

    async def end(self) -> None:
        """End the gateway as SIGTERM does."""
        if self._serving is not None and self._session is not None:
            self._serving.cancel()
            await asyncio.gather(self._serving, return_exceptions=True)
            await asyncio.to_thread(self._session.close)  # type: ignore[no-untyped-call]
            self._serving = None

    async def client(self, user: str = "ann") -> RemoteStation:
        """A client of the plant in another session."""
        return await self.client_of(FleetSettings("desk", FleetNetwork(connect=[self.address]), user))

    async def client_of(self, settings: FleetSettings) -> RemoteStation:
        client = RemoteStation(await asyncio.to_thread(find, str(PLANT), settings))
        self._clients.append(client)
        await until(lambda: client.reader.head)
        return client

    async def session(self) -> zenoh.Session:
        """A session of a client that knows Zenoh only; the caller closes it."""
        return await asyncio.to_thread(opened, FleetNetwork(connect=[self.address]), "client")

    async def close(self) -> None:
        for each in self._clients:
            await asyncio.to_thread(each.close)
        await self.end()


@asynccontextmanager
async def fleet_of(machine: TriedMachine, **more: Any) -> AsyncIterator[Fleet]:
    fleet = Fleet(machine, free_port())
    await fleet.begin(**more)
    try:
        yield fleet
    finally:
        await fleet.close()


async def asked(session: zenoh.Session, user: str, **command: Any) -> list[dict[str, Any]]:
    """All answers to a command that is written by hand."""
    now = time.time()
    given = {"id": secrets.token_hex(16), "client": "by hand", "sent": now, "until": now + 20.0, "path": ""} | command
    key = PLANT.key("command", user)

    def get() -> list[dict[str, Any]]:
        replies = session.get(key, payload=json.dumps(given), timeout=20.0, consolidation=zenoh.ConsolidationMode.NONE)
        return [json.loads(bytes(each.ok.payload)) for each in replies if each.ok is not None]

    return await asyncio.to_thread(get)


class Sent:
    """A session, and the deltas that it would send."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []

    def put(self, data: Any) -> None:
        if isinstance(data, bytes):
            self.messages.append(data)

    def __getattr__(self, name: str) -> Any:
        return lambda *args, **options: self

"""An authority of a fleet in a folder with the usual certificates, and a fleet that has them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import zenoh

from helpers.fleets import PLANT, Fleet, free_port
from umo.clients.faces.conformance import TriedMachine
from umo.clients.fleet.fleet_certificates import Authority
from umo.clients.fleet.fleet_commands import FleetUsers
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.fleet_settings import FleetSettings
from umo.clients.remote.attached import RemoteStation

HOST = "localhost"


def authority_in(folder: Path) -> Authority:
    """Router plant, sites cell7 and cell8, users ann, bob, and eve of cell8 only. The certificate of late was valid
    until yesterday."""
    authority = Authority.create(folder)
    authority.issue("router", "plant", [HOST])
    for name in ("cell7", "cell8"):
        authority.issue("site", name, [HOST])
    for name in ("ann", "bob"):
        authority.issue("user", name)
    authority.issue("user", "eve", sites=["cell8"])
    past = Authority(folder, datetime.now(UTC) - timedelta(days=30))
    past.issue("user", "late", days=29)
    return authority


class ProvedFleet(Fleet):
    """A fleet with certificates. `by_router`: a router in this process joins its gateway and its clients; else the
    gateway listens itself."""

    def __init__(self, machine: TriedMachine, authority: Authority, *, by_router: bool = True) -> None:
        super().__init__(machine, free_port())
        self.address = self.address.replace("tcp/", "tls/")
        self.folder, self._by_router = authority.folder, by_router
        self._router: zenoh.Session | None = None

    def network(self, name: str, *, listens: bool = False) -> FleetNetwork:
        """By the certificate of that name."""
        return FleetNetwork(
            connect=[] if listens else [self.address],
            listen=[self.address] if listens else [],
            certificates=self.folder / name,
        )

    async def begin_router(self) -> None:
        self._router = await asyncio.to_thread(opened, self.network("plant", listens=True), "router")

    async def end_router(self) -> None:
        if self._router is not None:
            await asyncio.to_thread(self._router.close)  # type: ignore[no-untyped-call]
            self._router = None

    async def begin(self, *, rate: float = 50.0, read_only: bool = False) -> None:
        if self._by_router and self._router is None:
            await self.begin_router()
        network = self.network(PLANT.site, listens=not self._by_router)
        session = await asyncio.to_thread(opened, network, "client" if self._by_router else "peer")
        await self.serve(session, FleetUsers(is_proved=network.is_proved), rate=rate, read_only=read_only)

    async def client(self, user: str = "ann") -> RemoteStation:
        return await self.client_of(FleetSettings("desk", self.network(user), user))

    async def session(self, name: str = "ann") -> zenoh.Session:
        return await asyncio.to_thread(opened, self.network(name), "client")

    async def close(self) -> None:
        await super().close()
        await self.end_router()


@asynccontextmanager
async def proved_fleet_of(machine: TriedMachine, authority: Authority, **more: Any) -> AsyncIterator[ProvedFleet]:
    fleet = ProvedFleet(machine, authority, **more)
    await fleet.begin()
    try:
        yield fleet
    finally:
        await fleet.close()

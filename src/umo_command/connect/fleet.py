"""`umo connect fleet` and `umo connect router`."""

from __future__ import annotations

import asyncio
import fcntl
import os
import time
from collections.abc import Mapping
from typing import Any

import zenoh

from umo.clients.fleet import fleet_settings
from umo.clients.fleet.fleet_commands import FleetUsers
from umo.clients.fleet.fleet_gateway import FASTEST, SLOWEST, FleetGateway
from umo.clients.fleet.fleet_rules import ROUTER, SITE
from umo.clients.fleet.fleet_session import LOCAL, FleetNetwork, opened
from umo.errors import OptionError
from umo.process.frames.frame_server import folder
from umo_command.background import step_back, until_stopped
from umo_command.connect.fleet_connection import jetstream_server, opened_patiently, tell_connection
from umo_command.console import out, say


def serve_gateway(changes: Mapping[str, Any], *, commands: bool, rate: float, jetstream: str | None = None) -> int:
    """Publish the stations of this computer until Ctrl-C or SIGTERM."""
    if not SLOWEST <= rate <= FASTEST:
        raise OptionError(f"--rate {rate:g} is not from {SLOWEST:g} to {FASTEST:g}")
    settings = fleet_settings.load(changes=changes)
    network = settings.network
    settings.require(SITE)
    if commands and not (network.is_local or network.is_proved):
        raise OptionError("commands from other computers need TLS, whose certificates prove who gives the commands")
    server = None if jetstream is None else jetstream_server(jetstream, settings)
    step_back()
    lock = _alone()
    mode = "client" if network.connect and not network.listen else "peer"
    session = opened_patiently(lambda: opened(network, mode), lambda: False)
    assert session is not None
    history = None
    try:
        if mode == "client":
            tell_connection(session)
        _tell(
            "publishes the stations of", settings.site, network, "reading and commands" if commands else "reading only"
        )

        if server is not None:
            from umo.clients.fleet.jetstream_publisher import JetStreamPublisher

            history = JetStreamPublisher(server, say)

        async def serving() -> None:
            users = FleetUsers(is_proved=network.is_proved)
            gateway = FleetGateway(
                session, settings.site, users, rate=rate, read_only=not commands, say=say, history=history
            )
            await gateway.run()

        asyncio.run(until_stopped(serving()))
    finally:
        if history is not None:
            history.close()
        session.close()
        os.close(lock)
    say("the gateway has ended; running stations continue")
    return 0


def _alone() -> int:
    """Return a lock on the frames of this user, because two gateways would give each command twice. Raises OptionError
    if another gateway has the lock."""
    lock = os.open(folder() / "fleet.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise OptionError("another gateway already publishes the stations of this user") from None
    return lock


def serve_router(changes: Mapping[str, Any]) -> int:
    """Join computers until Ctrl-C or SIGTERM."""
    settings = fleet_settings.load(changes=changes)
    settings.require(ROUTER)
    network = settings.network
    zenoh.init_log_from_env_or("zenoh_link_tls=warn")  # the computers that were refused
    session = opened(network, "router")
    try:
        _tell("routes for", network.identity.name if network.identity else settings.site, network, _who_may(network))
        asyncio.run(until_stopped(asyncio.Event().wait()))
    finally:
        session.close()
    return 0


def _who_may(network: FleetNetwork) -> str:
    if network.is_proved:
        return "clients: those that its rules name"
    if network.is_local:
        return "clients: this computer only"
    return "clients: everybody, reading only, because commands need certificates"


def _tell(does: str, site: str, network: FleetNetwork, may: str) -> None:
    where = ", ".join((*network.listen, *network.connect)) or LOCAL
    out.print(f"{does} {site}: {where}  ({may})", soft_wrap=True, highlight=False, markup=False)
    if (identity := network.identity) is not None and identity.is_soon_over(time.time()):
        say(f"the certificate of {identity} expires on {identity.until}: issue a new one (umo connect certificate)")

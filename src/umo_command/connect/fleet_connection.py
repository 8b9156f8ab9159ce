"""The connection of a gateway or a recorder to its fleet. It waits for the router, and reports when the router is
away."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING

import zenoh

from umo.clients.fleet.fleet_session import FleetAway
from umo.clients.fleet.fleet_settings import FleetSettings
from umo.errors import UmoError
from umo.system.packages import how_to_install
from umo_command.console import say

if TYPE_CHECKING:
    from umo.clients.fleet.jetstream_server import JetStreamServer

RETRY_DELAY = 2.0
"""Time in s until the next attempt to connect."""
LOOK = 0.5
"""Time in s between two checks of the connections."""


def opened_patiently(open: Callable[[], zenoh.Session], stopped: Callable[[], bool]) -> zenoh.Session | None:
    """Return a session as soon as a server answers, or None if the program was stopped before. Raises UmoError for a
    failure that waiting does not change, such as a wrong certificate."""
    told = False
    while not stopped():
        try:
            return open()
        except FleetAway as error:
            if not told:
                say(f"{error}; waiting for it")
                told = True
            until = time.monotonic() + RETRY_DELAY
            while time.monotonic() < until and not stopped():
                time.sleep(0.05)
    return None


def tell_connection(session: zenoh.Session) -> None:
    """Print a line whenever the connection is lost, and whenever it is restored."""
    threading.Thread(target=_tell, args=(session,), name="umo fleet connection", daemon=True).start()


def _tell(session: zenoh.Session) -> None:
    was_there = True
    while not session.is_closed():
        time.sleep(LOOK)
        try:
            is_there = bool(session.info.routers_zid() or session.info.peers_zid())
        except zenoh.ZError:  # it is being closed
            return
        if is_there != was_there:
            say("the fleet can be reached again" if is_there else "the fleet cannot be reached; waiting for it")
        was_there = is_there


def jetstream_server(url: str, settings: FleetSettings) -> JetStreamServer:
    """Return the JetStream of a command line. Raises UmoError if packages that JetStream requires are missing."""
    if find_spec("nats") is None:
        raise UmoError(f"a JetStream needs nats: {how_to_install('fleet-jetstream')}")
    from umo.clients.fleet.jetstream_server import load

    return load(url, settings.network.certificates, settings.jetstream)

"""The connection of a gateway or a recorder to its fleet: it waits for its router, and tells when that is away."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh

from umo.fleet.fleet_session import FleetAway

from .console import say

AGAIN = 2.0
"""Time in s after which it is tried again."""
LOOK = 0.5
"""Time in s from one look at the connections to the next."""


def opened_patiently(open: Callable[[], zenoh.Session], stopped: Callable[[], bool]) -> zenoh.Session | None:
    """A session, as soon as somebody answers; None: it was stopped before. UmoError for what waiting does not change,
    as a wrong certificate."""
    told = False
    while not stopped():
        try:
            return open()
        except FleetAway as error:
            if not told:
                say(f"{error}; it is waited for")
                told = True
            until = time.monotonic() + AGAIN
            while time.monotonic() < until and not stopped():
                time.sleep(0.05)
    return None


def tell_connection(session: zenoh.Session) -> None:
    """Tell from now on when nobody is connected any more, and when somebody is again."""
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
            say("the fleet is reached again" if is_there else "the fleet is away; it is waited for")
        was_there = is_there

"""Commanding a running machine from another program: `umo.attach`, and the queue of commands."""

from umo.remote.attached import RemoteStation, attach
from umo.remote.commander import HeldLease
from umo.remote.live_view import LiveView

__all__ = ["HeldLease", "LiveView", "RemoteStation", "attach"]

"""Commands a running machine from another program: `umo.attach`, and the queue of commands."""

from umo.clients.remote.attached import RemoteStation, attach
from umo.clients.remote.commander import HeldLease
from umo.clients.remote.live_view import LiveView

__all__ = ["HeldLease", "LiveView", "RemoteStation", "attach"]

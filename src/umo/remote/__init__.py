"""Commanding a running machine from another program: `umo.attach`, and the queue of commands."""

from umo.remote.lease import Lease
from umo.remote.station import RemoteStation, attach

__all__ = ["Lease", "RemoteStation", "attach"]

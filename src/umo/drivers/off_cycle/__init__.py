"""Drivers off the cycle: a slow device is served by a process of its own, and meets the image in shared memory."""

from umo.drivers.off_cycle.exchange import NEVER, Exchange
from umo.drivers.off_cycle.proxy import OffCycle
from umo.drivers.off_cycle.server import Server

__all__ = ["NEVER", "Exchange", "OffCycle", "Server"]

"""Drivers off the cycle: a separate process serves a slow device, and exchanges values with the image in shared
memory."""

from umo.drivers.off_cycle.device_server import DeviceServer
from umo.drivers.off_cycle.proxy import OffCycle
from umo.drivers.off_cycle.shared_memory import NO_TIME, Exchange

__all__ = ["NO_TIME", "DeviceServer", "Exchange", "OffCycle"]

"""The drivers of interface circuits, and their contract with umo. A driver transfers raw integers of channels. It has
no knowledge of the machine's objects.

This package contains the names that a driver needs. The checks of options are in `umo.drivers.option_checks`.
"""

from umo.drivers.contract import UNREAD, Channel, Direction, Driver, IntArray
from umo.drivers.optional import (
    EndsWait,
    HasShortForm,
    HasWatchdog,
    Inspects,
    KnowsAges,
    KnowsScale,
    Looks,
    MovesInC,
    PhysicalScale,
    Reports,
    TransferInC,
    WaitEnded,
)
from umo.errors import ChannelError, ChannelsFailed, DeviceTimeout, DriverError, WiringError

__all__ = [
    "UNREAD",
    "Channel",
    "ChannelError",
    "ChannelsFailed",
    "DeviceTimeout",
    "Direction",
    "Driver",
    "DriverError",
    "EndsWait",
    "HasShortForm",
    "HasWatchdog",
    "Inspects",
    "IntArray",
    "KnowsAges",
    "KnowsScale",
    "Looks",
    "MovesInC",
    "PhysicalScale",
    "Reports",
    "TransferInC",
    "WaitEnded",
    "WiringError",
]

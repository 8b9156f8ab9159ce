"""Drivers: one module per interface circuit, behind one contract."""

from umo.drivers.contract import Channel, Direction, Driver, IntArray

__all__ = ["Channel", "Direction", "Driver", "IntArray"]

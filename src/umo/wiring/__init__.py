"""Wiring: which object is on which driver's channel."""

from umo.wiring.resolve import check, resolve
from umo.wiring.run_options import distribute_options, driver_options
from umo.wiring.wired import Parameter, ProcessSettings, Wire, Wired

__all__ = ["Parameter", "ProcessSettings", "Wire", "Wired", "check", "distribute_options", "driver_options", "resolve"]

"""Wiring: which object is on which driver's channel."""

from umo.wiring.options import driver_options, share
from umo.wiring.resolve import check, resolve
from umo.wiring.resolved import Parameter, Process, Wire, Wired

__all__ = ["Parameter", "Process", "Wire", "Wired", "check", "driver_options", "resolve", "share"]

"""The wiring file: functions that read and check it, and resolve it into objects with drivers and channels. The drivers
and the handling of channels are in `umo.drivers`."""

from umo.wiring.resolve import check, resolve
from umo.wiring.run_options import distribute_options, driver_options
from umo.wiring.wired import Parameter, ProcessSettings, Wire, Wired

__all__ = ["Parameter", "ProcessSettings", "Wire", "Wired", "check", "distribute_options", "driver_options", "resolve"]

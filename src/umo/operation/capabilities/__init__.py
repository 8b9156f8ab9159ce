"""The capabilities that ship with umo: parts that work on the whole machine (the contract: `umo.cycle.capability`)."""

from umo.operation.capabilities.attached_part import AttachedPart
from umo.operation.capabilities.hour_meters import HourMeters
from umo.operation.capabilities.write_trace import WriteTrace

__all__ = ["AttachedPart", "HourMeters", "WriteTrace"]

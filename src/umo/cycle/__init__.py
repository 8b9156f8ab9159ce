"""The cycle: the process image, the sampling period, connecting and leaving."""

from umo.cycle.connect import connect
from umo.cycle.frame import Frame, Observer
from umo.cycle.run import drive, run

__all__ = ["Frame", "Observer", "connect", "drive", "run"]

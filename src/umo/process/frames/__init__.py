"""Frames: one for each finished period, in a ring in shared memory that all processes of the same user can read."""

from umo.cycle.stage import Stage
from umo.process.frames.frame_server import rings
from umo.process.frames.layout import Layout
from umo.process.frames.publish import published
from umo.process.frames.reader import Reader
from umo.process.frames.ring import Ring
from umo.process.frames.run_reader import RunReader

__all__ = ["Layout", "Reader", "Ring", "RunReader", "Stage", "published", "rings"]

"""Frames: one for each finished period, in a ring in shared memory that all processes of the same user can read."""

from umo.cycle.stage import Stage
from umo.frames.frame_server import rings
from umo.frames.layout import Layout
from umo.frames.publish import published
from umo.frames.reader import Reader
from umo.frames.ring import Ring

__all__ = ["Layout", "Reader", "Ring", "Stage", "published", "rings"]

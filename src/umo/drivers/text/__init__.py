"""Line protocols that the wiring declares."""

from umo.drivers.text.driver import Text

__all__ = ["Text"]

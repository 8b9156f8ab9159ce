"""The lines of a GPIO chip."""

from umo.drivers.gpio.driver import Gpio

__all__ = ["Gpio"]

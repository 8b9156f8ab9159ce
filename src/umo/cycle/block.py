"""Neighbouring slots of the process image that one driver moves in one transfer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from umo.drivers.contract import UNREAD, Channel, Driver
from umo.objects.scaling import IntArray


class Block:
    """Neighbouring slots that one driver moves in one transfer."""

    def __init__(
        self, driver: Driver[Any], channels: tuple[Channel, ...], start: int, raws: IntArray, inputs: bool
    ) -> None:
        self.driver = driver
        self.channels = channels
        self.start = start
        self.stop = start + len(channels)
        self.slots = slice(start, self.stop)
        self.count = len(channels)
        self.raws = raws
        self.buffer = self.raws.view()
        """What the driver is given: of inputs to fill, of outputs to read."""
        self.buffer.flags.writeable = inputs
        self.view = self.buffer.data
        """The same as a memoryview: between two of these a copy takes a third of numpy's time."""
        self.unread = np.full(self.count, UNREAD).data
        """Inputs: what the buffer has before a transfer."""
        self.transfer: Callable[[Any, IntArray], None]
        """The driver's block transfer, as the transfer stage calls it."""
        self.convert: Callable[[float], list[tuple[int, float]]]
        """Inputs: takes the buffer to raws, values and, with the time given in s, times of the image. If any values are
        out of bounds, their (slot, value) pairs are returned and not kept, and the times are left to the caller."""
        self.give: Callable[[float, float], None]
        """Outputs: fills the buffer with what is to be sent: what is pending, at the time given in s, as far as rates
        allow in the time of this period, in s (0: since the last step)."""
        self.commit: Callable[[float], None]
        """Outputs: what was given is at the hardware since the time given in s."""
        self.unsettled: set[int] = set()
        """Slots whose quality differs from the normal one."""

"""A timer in virtual time, such as a plant's tick or the simulated timer, whose pace is set by the real-time clock."""

from __future__ import annotations

from typing import Any

from umo.drivers.contract import Channel, Driver
from umo.drivers.timerfd import TimerFd


class PacedTimer(TimerFd):
    """A timer channel of a driver that runs in virtual time, slowed down to real time (the option `realtime` of a run).

    `read` reads the timer channel of the driver, so that one period passes in the plant. Then it waits for the wall
    clock like `TimerFd`, so that the computing time of the plant does not delay the period. If the wall clock has
    missed periods, they also pass in the plant. `read` returns the number of periods that the wall clock has missed. On
    the timer's wire this object takes the place of the driver, but does not open or close it.
    """

    def __init__(self, timer: Driver[Any]) -> None:
        super().__init__()
        self.timer = timer
        self.period, self.timeout = timer.period, timer.timeout

    def channel(self, text: str) -> Channel:
        channel: Channel = self.timer.channel(text)
        return channel

    def initialize(self, channel: Channel, default: int | None) -> None:
        self.timer.initialize(channel, default)
        super().initialize(channel, default)

    def finalize(self, channel: Channel) -> None:
        super().finalize(channel)
        self.timer.finalize(channel)

    def reset(self, channel: Channel, default: int | None) -> None:
        self.timer.reset(channel, default)

    def read(self, channel: Channel) -> int:
        self.timer.read(channel)
        missed = super().read(channel)
        for _ in range(missed - 1):
            self.timer.read(channel)
        return missed

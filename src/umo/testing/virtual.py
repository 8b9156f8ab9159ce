"""Virtual time: a timer that never waits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from umo.cycle.stopping import request_stop
from umo.drivers.contract import Channel, Direction, Driver


class VirtualTimer(Driver):
    """A timer with one channel, the tick, in virtual time. `read` returns immediately.

        VirtualTimer()                        every period on time
        VirtualTimer(missed=[0, 0, 3])        the third read finds 3 ticks passed, then on time again
        VirtualTimer(end_after=1000)          in period 1000 the machine is asked to stop, like by SIGTERM

    `on_period(number)` is called at the start of each period; periods are counted from 1. The timer can also be used in
    a TOML file, as `type = "umo.testing:VirtualTimer"` with the options `missed` and `end_after`.
    """

    def __init__(
        self,
        missed: Sequence[int] = (),
        end_after: int | None = None,
        on_period: Callable[[int], object] | None = None,
    ) -> None:
        self._missed = iter(missed)
        self._end_after = end_after
        self._on_period = on_period
        self.reads = 0
        """Number of periods that have begun."""

    def channel(self, text: str) -> Channel:
        return Channel("tick", Direction.INPUT, 63)

    def read(self, channel: Channel) -> int:
        self.reads += 1
        if self.reads == self._end_after:
            request_stop()
        if self._on_period is not None:
            self._on_period(self.reads)
        return next(self._missed, 0)

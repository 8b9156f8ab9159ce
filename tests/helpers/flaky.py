"""A circuit that fails at random, and a loop that goes on all the same."""

from __future__ import annotations

from contextlib import suppress
from random import Random
from typing import Any

from umo.drivers import Looks
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError
from umo.testing import Scripted, periods


class Flaky(Scripted, Looks):
    """A circuit whose readings are random, and whose calls fail at random."""

    def __init__(self, seed: int, share: float = 0.1) -> None:
        super().__init__()
        self.random, self.share, self.quiet = Random(seed), share, True

    def _call(self, segment: str, channels: Any = (), raws: Any = ()) -> Any:
        random = self.random
        if not self.quiet and random.random() < self.share:
            failed = random.sample([channel.text for channel in channels], min(len(channels), 1))
            raise random.choice(
                [DriverError("dead"), DeviceTimeout("slow"), ChannelsFailed(dict.fromkeys(failed, "cut")), OSError()]
            )
        return super()._call(segment, channels, raws)

    def _reading(self, channel: Any, replaced: Any) -> Any:
        return self.random.randrange(2 if channel.text.endswith(("limit", "door")) else 250)

    def look(self) -> bool | None:
        return self.random.choice([True, False, None])


def loop(count: int) -> Any:
    def run(m: Any) -> None:
        for _ in range(count):
            with suppress(DriverError):  # the next period follows
                periods(m)

    return run

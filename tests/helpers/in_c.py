"""Drivers of tests whose transfers are made in C: functions that call the driver in Python, and decline at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, POINTER, c_int32, c_int64, c_void_p, cast
from random import Random
from typing import Any

import numpy as np

from helpers.generating import Fragile
from umo.drivers import Channel, MovesInC, TransferInC
from umo.testing import VirtualTimer

TRANSFER = CFUNCTYPE(c_int32, c_void_p, POINTER(c_int64), c_int32)
DECLINED = 1


def transfer(call: Callable[[Any], object], declines: Callable[[], bool]) -> TransferInC:
    """A function in C that fills, or takes, the raw integers by a function of Python; what that raises is a refusal."""

    def made(_: object, raws: Any, count: int) -> int:
        if declines():
            return DECLINED
        try:
            call(np.ctypeslib.as_array(raws, (count,)))
        except OSError:
            return DECLINED
        return 0

    function = TRANSFER(made)
    return TransferInC(cast(function, c_void_p).value or 0, 0, function)


class FragileInC(Fragile, MovesInC):
    """`declined`: the share of its transfers that are left to Python."""

    random, declined = Random(1), 0.0

    def in_c(self, channels: Sequence[Channel], write: bool) -> TransferInC | str:
        def call(raws: Any) -> None:
            self.moved_in_c += 1
            (self.write_many if write else self.read_many)(channels, raws)

        return transfer(call, lambda: self.random.random() < self.declined)

    moved_in_c = 0
    """Transfers in C."""


class TimerInC(VirtualTimer, MovesInC):
    random, declined = Random(2), 0.0

    def in_c(self, channels: Sequence[Channel], write: bool) -> TransferInC | str:
        def call(raws: Any) -> None:
            raws[0] = self.read(channels[0])

        return transfer(call, lambda: self.random.random() < self.declined)

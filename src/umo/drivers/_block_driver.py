"""The common parts of drivers that transfer blocks: the plans of the blocks, and the steps of a transfer, each of which
can fail."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Generic, TypeVar

import numpy as np

from umo.drivers.contract import C, Driver, IntArray
from umo.errors import ChannelsFailed, DriverError

_MAX_PLANS = 256
K = TypeVar("K", bound=Hashable)
P = TypeVar("P")
S = TypeVar("S")


class Plans(Generic[K, P]):
    """The plans of groups of channels, each made once. A machine has few groups. Other callers can have many, so the
    number of plans is limited."""

    def __init__(self, make: Callable[[tuple[K, ...]], P]) -> None:
        self._make = make
        self._known: dict[tuple[K, ...], P] = {}
        self._channels: Sequence[K] | None = None
        self.last: P | None = None
        """The plan that was requested last."""

    def clear(self) -> None:
        """Discard all plans, so that they are made again."""
        self._known.clear()
        self._channels = self.last = None

    def of(self, channels: Sequence[K]) -> P:
        if channels is self._channels and self.last is not None:
            return self.last
        key = tuple(channels)
        plan = self._known.get(key)
        if plan is None:
            plan = self._make(key)
            if len(self._known) >= _MAX_PLANS:
                self._known.clear()
            self._known[key] = plan
        self._channels, self.last = key, plan
        return plan


class BlockDriver(Driver[C]):
    """A driver that transfers blocks of channels; a single channel is a block of one."""

    def read(self, channel: C) -> int:
        out = np.empty(1, np.int64)
        self.read_many((channel,), out)
        return int(out[0])

    def write(self, channel: C, raw: int) -> None:
        self._write((channel,), [raw])

    def write_many(self, channels: Sequence[C], raws: IntArray) -> None:
        self._write(channels, raws.tolist())

    @abstractmethod
    def _write(self, channels: Sequence[C], raws: list[int]) -> None:
        """Write the channels of a block; every value is checked before the first is sent."""


def in_turn(
    steps: Sequence[S],
    carry_out: Callable[[S], object],
    texts_of: Callable[[S], Iterable[str]],
    is_last: Callable[[DriverError], bool] = lambda error: False,
) -> None:
    """Carry out the steps of a block one after another. Errors are raised at the end.

    A step that fails does not stop the others: ChannelsFailed then contains the texts of its channels. If `is_last` is
    true for an error, such as a lost connection, all later steps also fail with this error. The error itself is raised
    if all steps fail with it. It is raised immediately if it is a timeout, or if there is only one step.
    """
    if len(steps) == 1:
        carry_out(steps[0])
        return
    failed: dict[str, str] = {}
    for i, step in enumerate(steps):
        try:
            carry_out(step)
        except ChannelsFailed as error:
            failed.update(error.causes)
        except DriverError as error:
            ends = is_last(error)
            if isinstance(error, TimeoutError) or (ends and i == 0):
                raise
            for each in steps[i:] if ends else (step,):
                failed.update(dict.fromkeys(texts_of(each), str(error)))
            if ends:
                break
    if failed:
        raise ChannelsFailed(failed)

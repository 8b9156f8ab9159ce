"""The plans of a driver's block transfers."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

_MOST = 256
C = TypeVar("C", bound=Hashable)
P = TypeVar("P")


class Plans(Generic[C, P]):
    """The plan of each group of channels, made once. A machine has few groups; others may have many, so the number of
    plans is limited."""

    def __init__(self, make: Callable[[tuple[C, ...]], P]) -> None:
        self._make = make
        self._known: dict[tuple[C, ...], P] = {}
        self._last: tuple[tuple[C, ...], P] | None = None

    def __len__(self) -> int:
        return len(self._known)

    def of(self, channels: Sequence[C]) -> P:
        if self._last is not None and channels is self._last[0]:
            return self._last[1]
        key = tuple(channels)
        plan = self._known.get(key)
        if plan is None:
            plan = self._make(key)
            if len(self._known) >= _MOST:
                self._known.clear()
            self._known[key] = plan
        self._last = key, plan
        return plan

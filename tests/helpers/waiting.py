"""Waiting for what another thread or process does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def until(condition: Callable[[], T], patience: float = 30.0) -> T:
    """What the condition returns once it is true; it is asked each 5 ms for up to `patience` s."""
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)
    return found

"""Waiting for what another thread or process does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def until(condition: Callable[[], T]) -> T:
    """What the condition returns once it is true; it is asked each 5 ms. The limit is that of the test (`LIMITS` in
    conftest.py): on a busy computer a process takes its time to begin."""
    while not (found := condition()):
        time.sleep(0.005)
    return found

"""A station that is commanded, as its lease and its members see it (`umo.remote.attached`)."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Protocol

from umo.cycle.client_control import DEAD_MAN_TIME
from umo.frames import Reader


class Commanded(Protocol):
    """A running station: its frames, and the commands to it."""

    reader: Reader
    held_lease: Any
    """The lease that this program holds; None: it holds none."""

    @property
    def running(self) -> bool: ...
    def ask(self, do: str, path: str = "", **more: Any) -> Any:
        """Send a command and wait for its answer."""

    def sign(self, lease: int, *paths: str) -> None:
        """A sign of life for these paths."""

    def holding(self, path: str, lasts: float = DEAD_MAN_TIME) -> AbstractContextManager[None]:
        """Hold what is begun in the block from then on."""

    def let_go(self, path: str) -> None:
        """Release what was held at this path."""

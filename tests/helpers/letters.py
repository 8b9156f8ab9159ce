"""The other end of the clients of a machine, filled by a test."""

from __future__ import annotations

from collections import deque

from umo.operation.commands.client_commands import ClientCommand


class Letters:
    """An inbox that a test fills, and the levels of its clients."""

    def __init__(self) -> None:
        self.waiting: deque[ClientCommand] = deque()
        self.taken = self.dropped = 0
        self.stop: tuple[int, str] | None = None
        self.asked = [0]
        self.signs: dict[str, tuple[int, float]] = {}
        """The lease of whom, and when, by path."""

    def signed(self, path: str, lease: int) -> float:
        number, seen = self.signs.get(path, (0, 0.0))
        return seen if number == lease else 0.0

    def get(self) -> ClientCommand | None:
        self.taken += bool(self.waiting)
        return self.waiting.popleft() if self.waiting else None

"""Exchanges on a line: how answers are spoiled, and what is under way between a driver and its device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Change = Callable[[bytes], bytes]
"""Makes what the driver gets out of what the device answered; nothing: no answer."""


@dataclass(frozen=True)
class AnswerMode:
    """What happens to answers; by default they pass."""

    change: Change | None = None
    hangup: bool = False
    """After a changed answer the connection is closed."""
    holding: bool = False
    """They are kept, to be delivered late."""
    splitting: bool = False
    """Each comes in three pieces."""
    step: float = 0.0
    """s between the bytes of an answer that trickles."""
    endless: float = 0.0
    """s between bytes that come without an end, in place of an answer."""

    @property
    def spoils(self) -> bool:
        return self != PASSING


PASSING, HOLDING = AnswerMode(), AnswerMode(holding=True)


class Traffic:
    """The bytes that passed a tap in both directions within a block."""

    def __init__(self) -> None:
        self.requests: list[bytes] = []
        """Pieces that the driver sent: each is what was there when the tap looked."""
        self.answer = b""
        """What the device sent."""

    @property
    def asked(self) -> int:
        """Bytes that the driver sent."""
        return sum(map(len, self.requests))


class Tapped:
    """A driver and its device: two descriptors, and the present exchange."""

    def __init__(self, driver: int, device: int) -> None:
        self.driver, self.device = driver, device
        self.request, self.answer = b"", b""
        self.held = b""
        """Late answers."""
        self.due: float | None = None
        """When the answer counts as complete."""
        self.trickle = b""
        """The rest of an answer that is delivered byte by byte."""
        self.next = 0.0
        """When the next byte of it is due."""

"""Exchanges on a line: how answers are spoiled, and what is under way between a driver and its device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Change = Callable[[bytes], bytes]
"""Function that makes what the driver gets out of what the device answered; nothing: no answer."""


@dataclass(frozen=True)
class AnswerMode:
    """Treatment of answers; by default they pass."""

    change: Change | None = None
    hangup: bool = False
    """Whether the connection is closed after a changed answer."""
    holding: bool = False
    """Whether they are kept, to be delivered late."""
    splitting: bool = False
    """Whether each comes in three pieces."""
    step: float = 0.0
    """Time in s between the bytes of an answer that trickles."""
    endless: float = 0.0
    """Time in s between bytes that come without an end, in place of an answer."""

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
        """Bytes that the device sent."""

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
        """Time at which the answer counts as complete."""
        self.trickle = b""
        """The rest of an answer that is delivered byte by byte."""
        self.next_due = 0.0
        """Time at which the next byte is due."""

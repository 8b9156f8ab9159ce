"""The rules of a conversation in lines."""

from __future__ import annotations

from dataclasses import dataclass

from umo.drivers.text.channel import Query
from umo.drivers.text.pattern import Pattern


@dataclass(frozen=True)
class LinkSettings:
    """Rules of the conversation: the options of the driver that are not about a channel."""

    terminator: str
    answer_terminator: str
    encoding: str
    errors: tuple[Pattern, ...]
    identify: Query | None
    startup: tuple[str, ...]
    acknowledge: Pattern | None
    confirm: Query | None
    greeting: Pattern | None
    echo: bool
    pause: float
    quiet: float
    boot_time: float
    starts_always: bool
    """Whether each new connection starts the device; else only the first one does."""
    longest_answer: int

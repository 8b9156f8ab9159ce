"""The rules of a conversation in lines."""

from __future__ import annotations

from dataclasses import dataclass

from umo.drivers.text.channel import Ends, Query
from umo.drivers.text.pattern import LINE_BLANKS, Pattern


@dataclass(frozen=True)
class LinkSettings:
    """The rules of the conversation: the options of the driver that do not concern a single channel."""

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
    """True if each new connection starts the device; otherwise only the first connection does."""
    longest_answer: int
    skip_empty_lines: bool

    def encoded(self, request: str, ends: Ends) -> bytes:
        """Return the bytes of a request with its terminator."""
        terminator = self.terminator if ends.request is None else ends.request
        return (request + terminator).encode(self.encoding)

    def end(self, ends: Ends) -> bytes:
        """Return the bytes that end the answer to a request."""
        return (ends.answer or self.answer_terminator).encode(self.encoding)


def is_blank(line: bytes) -> bool:
    """Return True if a line has blanks only."""
    return not line.strip(LINE_BLANKS.encode())

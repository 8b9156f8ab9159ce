"""The user who gives a command: the name in events and leases."""

from __future__ import annotations

from umo.process.frames.layout import NAME
from umo.text import printable

UNVERIFIED = ", unverified"
"""Suffix of a name that is not proved, before the way in brackets."""


def is_unverified(who: str) -> bool:
    """True if a text of `who_text` tells that the name is not proved."""
    return f"{UNVERIFIED} (" in who


def who_text(name: str, ending: str) -> str:
    """A user as events and leases tell them, in `NAME` bytes at most. The name is cut, never the ending, which tells by
    which way the command came and whether the name is proved."""
    given = printable(" ".join(name.split())) or "nobody"
    return given.encode()[: max(0, NAME - len(ending.encode()))].decode(errors="ignore") + ending

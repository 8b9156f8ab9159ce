"""The user who gives a command: the name in events and leases."""

from __future__ import annotations

from umo.process.frames.layout import NAME
from umo.text import printable

UNVERIFIED = ", unverified"
"""Suffix of a name that is not proved, before the way in brackets."""


def is_unverified(who: str) -> bool:
    """True if a text of `who_text` marks the name as not proved."""
    return f"{UNVERIFIED} (" in who


def who_text(name: str, ending: str) -> str:
    """A user as shown in events and leases, in at most `NAME` bytes. The name is cut, but never the ending, which shows
    by which way the command came and whether the name is proved."""
    given = printable(" ".join(name.split())) or "nobody"
    return given.encode()[: max(0, NAME - len(ending.encode()))].decode(errors="ignore") + ending
